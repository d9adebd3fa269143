"""Work in threads gives what it gives in one, in order."""

import threading
import time
from collections.abc import Iterator

import pytest

from vlnpe.formats.process.threads import allow_threads, beside, in_order, made_ahead


@pytest.mark.parametrize("count", [1, 2, 4])
@pytest.mark.parametrize("busy", [False, True])
def test_results_come_in_the_order_of_their_items(count: int, busy: bool) -> None:
    def late(item: int) -> int:
        time.sleep(0.01 * (item % 3 == 0))
        return item * item

    with allow_threads(count):
        assert list(in_order(late, range(20), busy)) == [item * item for item in range(20)]


def test_no_more_threads_work_than_are_allowed() -> None:
    seen: set[int] = set()

    def note(_: int) -> None:
        seen.add(threading.get_ident())
        time.sleep(0.005)

    list(in_order(note, range(8)))
    assert seen == {threading.get_ident()}
    with allow_threads(3):
        list(in_order(note, range(20)))
    assert len(seen - {threading.get_ident()}) == 3


def test_threads_start_no_threads() -> None:
    def nested(_: int) -> set[int]:
        return set(in_order(lambda _: threading.get_ident(), range(6)))

    with allow_threads(4):
        assert all(len(idents) == 1 for idents in in_order(nested, range(6)))


def test_items_are_drawn_only_a_few_ahead() -> None:
    taken: list[int] = []

    def items() -> Iterator[int]:
        for item in range(100):
            taken.append(item)
            yield item

    with allow_threads(2):
        results = in_order(lambda item: item, items())
        next(results)
        assert len(taken) <= 4
        results.close()


def test_errors_reach_the_caller() -> None:
    def fail(item: int) -> int:
        if item == 3:
            raise ValueError("the third")
        return item

    for count in (1, 3):
        with allow_threads(count):
            with pytest.raises(ValueError, match="the third"):
                list(in_order(fail, range(6)))
            with pytest.raises(ValueError, match="the third"), beside(lambda: fail(3)) as failed:
                failed()


def test_what_is_begun_works_beside_the_caller() -> None:
    with allow_threads(2), beside(threading.get_ident) as other:
        assert other() != threading.get_ident()
    with beside(threading.get_ident) as other:
        assert other() == threading.get_ident()


def test_an_error_beside_waits_for_what_was_begun() -> None:
    ended: list[bool] = []

    def slowly() -> None:
        time.sleep(0.05)
        ended.append(True)

    with allow_threads(2), pytest.raises(ValueError, match="meanwhile"), beside(slowly):
        raise ValueError("meanwhile")
    assert ended


def test_the_next_item_is_made_while_the_caller_works() -> None:
    begun: list[int] = []
    second = threading.Event()

    def items() -> Iterator[int]:
        for item in range(5):
            begun.append(item)
            if item == 1:
                second.set()
            yield item

    waits: list[float] = []
    results = made_ahead(items(), waits.append)
    assert next(results) == 0
    assert second.wait(5), "the caller has the first item alone"
    results.close()  # the thread ends with it
    assert begun == [0, 1] and len(waits) == 1
    assert list(made_ahead(iter(range(50)))) == list(range(50))


def test_an_error_comes_after_the_items_before_it() -> None:
    def items() -> Iterator[int]:
        yield 1
        time.sleep(0.05)
        raise ValueError("the second")

    waits: list[float] = []
    results = made_ahead(items(), waits.append)
    assert next(results) == 1
    with pytest.raises(ValueError, match="the second"):
        next(results)
    slow = made_ahead((time.sleep(0.05) for _ in range(2)), waits.append)
    list(slow)
    assert max(waits) >= 0.04
