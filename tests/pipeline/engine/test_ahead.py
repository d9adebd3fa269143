"""Chains of items on real worker processes."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.support.runs import work
from vlnpe.formats.core.errors import InputError
from vlnpe.pipeline.engine.ledger import Ledger
from vlnpe.pipeline.engine.work import WorkItem
from vlnpe.pipeline.execution.ahead import run_ahead
from vlnpe.pipeline.execution.attempts import Link
from vlnpe.pipeline.execution.processes import Workers
from vlnpe.pipeline.execution.runner import Context, run_stage

pytestmark = pytest.mark.chain


@pytest.fixture(scope="module")
def workers():
    with Workers(2) as pool:
        yield pool


def context(root: Path, workers: Workers, *, retry: bool = False) -> Context:
    return Context(Ledger(root), workers, progress=False, retry_quarantined=retry)


def link(
    root: Path, stage: str, name: str, call: work.Call | None = None, *, wants_success: bool = False
) -> Link:
    path = root / f"{stage}-{name}.txt"
    call = call or work.Call(work.write, (path, f"{stage} {name}"))
    needed = stage != "last"
    return Link(stage, WorkItem(name, "k", (path,), call), needed, wants_success)


def chain(root: Path, name: str, first: work.Call | None = None) -> list[Link]:
    return [
        link(root, "first", name, first),
        link(root, "second", name),
        link(root, "last", name, wants_success=True),
    ]


def stage(now: Context, name: str, chains: list[list[Link]]):
    return run_stage(now, name, [k.item for one in chains for k in one if k.stage == name])


def test_stages_find_the_items_of_chains_done(tmp_path, workers):
    now = context(tmp_path, workers)
    chains = [chain(tmp_path, "a"), chain(tmp_path, "b")]
    run_ahead(now, chains, "")
    stamps = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.txt")}
    assert len(stamps) == 6
    summaries = [stage(now, name, chains) for name in ("first", "second", "last")]
    assert [(s.done, s.reused) for s in summaries] == [(2, 0)] * 3
    assert all(summary.seconds > 0 for summary in summaries)
    assert stamps == {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.txt")}
    again = context(tmp_path, workers)
    run_ahead(again, chains, "")
    assert stage(again, "second", chains).reused == 2


def test_a_chain_goes_on_from_what_is_done(tmp_path, workers):
    chains = [chain(tmp_path, "a")]
    stage(context(tmp_path, workers), "first", chains)
    stamp = (tmp_path / "first-a.txt").stat().st_mtime_ns
    now = context(tmp_path, workers)
    run_ahead(now, chains, "")
    assert stage(now, "first", chains).reused == 1
    assert stage(now, "last", chains).done == 1
    assert (tmp_path / "first-a.txt").stat().st_mtime_ns == stamp


def test_a_failure_ends_its_chain_and_no_other(tmp_path, workers):
    chains = [
        chain(tmp_path, "bad", work.Call(work.refuse, (tmp_path / "bad",))),
        chain(tmp_path, "good"),
    ]
    now = context(tmp_path, workers, retry=True)
    run_ahead(now, chains, "")
    assert sorted(p.name for p in tmp_path.glob("*.txt")) == [
        "first-good.txt",
        "last-good.txt",
        "second-good.txt",
    ]
    found = stage(now, "first", chains)  # asked to retry, but not what has just been tried
    assert (found.done, found.quarantined) == (1, 1)
    # What is quarantined stays so, and nothing is made of it.
    later = context(tmp_path, workers)
    run_ahead(later, chains, "")
    assert not (tmp_path / "second-bad.txt").exists()


def test_only_successes_go_on_where_that_is_asked_for(tmp_path, workers):
    fell = work.Call(work.write, (tmp_path / "first-a.txt", "fell"))
    chains = [chain(tmp_path, "a", fell)]
    now = context(tmp_path, workers)
    for _ in range(2):  # when it falls, and when it has fallen
        run_ahead(now, chains, "")
        assert (tmp_path / "second-a.txt").exists() and not (tmp_path / "last-a.txt").exists()


def test_chains_lost_with_a_dying_worker_are_left_to_the_stages(tmp_path):
    chains = [
        chain(tmp_path, "bad", work.Call(work.die, (tmp_path / "bad",))),
        *(chain(tmp_path, name) for name in "abc"),
    ]
    with Workers(2) as pool:
        now = context(tmp_path, pool)
        run_ahead(now, chains, "")
        found = stage(now, "first", chains)
        assert (found.done, found.quarantined) == (3, 1)
        good = [one for one in chains if one[0].item.name != "bad"]
        assert stage(now, "second", good).done == 3


def test_a_full_disk_ends_the_run_and_keeps_what_is_done(tmp_path):
    chains = [
        chain(tmp_path, "a"),
        chain(tmp_path, "full", work.Call(work.fill_disk, (tmp_path / "x",))),
    ]
    with Workers(1) as pool, pytest.raises(InputError, match="No space left"):
        run_ahead(context(tmp_path, pool), chains, "")
    assert {(row.stage, row.item) for row in Ledger(tmp_path).rows()} == {
        ("first", "a"),
        ("second", "a"),
        ("last", "a"),
    }


def test_outputs_of_earlier_options_are_kept_where_a_chain_ends_before_them(tmp_path, workers):
    run_ahead(context(tmp_path, workers), [chain(tmp_path, "a")], "")
    refused = work.Call(work.refuse, (tmp_path / "a",))
    other = [replace(k, item=replace(k.item, key="other")) for k in chain(tmp_path, "a", refused)]
    run_ahead(context(tmp_path, workers), [other], "")
    ledger = Ledger(tmp_path)
    assert [row.status for row in ledger.rows("first")] == ["quarantined"]
    assert [row.key for row in ledger.rows("second")] == ["k"]
    assert ledger.records(ledger.rows("second")[0])
