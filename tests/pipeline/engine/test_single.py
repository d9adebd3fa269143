"""Commands that run one stage: its ledger lies beside the output."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from vlnpe.formats.core.atomic import write_bytes
from vlnpe.formats.core.errors import InputError
from vlnpe.pipeline.context import LEDGERS, open_single, run_single
from vlnpe.pipeline.engine.work import ItemResult, WorkItem

pytestmark = pytest.mark.usefixtures("inline")


@dataclass(frozen=True)
class Count:
    """Write how often this has run."""

    out: Path
    counter: Path
    fail: bool = False

    def run(self) -> ItemResult:
        times = int(self.counter.read_text()) + 1 if self.counter.exists() else 1
        self.counter.write_text(str(times))
        if self.fail:
            raise InputError(f"{self.out}: bad input")
        write_bytes(self.out, f"run {times}".encode())
        return ItemResult({"times": times})


def once(folder: Path, key: str = "a", stage: str = "count", fail: bool = False) -> int:
    out = folder / "out.txt"
    job = Count(out, folder / "counter", fail)
    return run_single(out, stage, WorkItem("one", key, (out,), job)).facts["times"]


def test_an_unchanged_output_is_not_made_again(tmp_path: Path):
    assert [once(tmp_path), once(tmp_path)] == [1, 1]
    assert once(tmp_path, key="b") == 2


def test_an_output_that_somebody_changed_is_made_again(tmp_path: Path):
    once(tmp_path)
    (tmp_path / "out.txt").write_text("edited")
    assert once(tmp_path) == 2
    assert (tmp_path / "out.txt").read_text() == "run 2"
    (tmp_path / "out.txt").unlink()
    assert once(tmp_path) == 3


def test_two_stages_may_write_the_same_output_in_turn(tmp_path: Path):
    assert [once(tmp_path, s, s) for s in ("filter", "align", "filter")] == [1, 2, 3]


def test_a_failure_keeps_the_earlier_output_and_runs_again(tmp_path: Path):
    once(tmp_path)
    with pytest.raises(InputError, match="bad input"):
        once(tmp_path, key="b", fail=True)
    assert (tmp_path / "out.txt").read_text() == "run 1"
    assert once(tmp_path) == 3


def test_a_first_failure_leaves_nothing(tmp_path: Path):
    with pytest.raises(InputError, match="bad input"):
        once(tmp_path, fail=True)
    assert [path.name for path in tmp_path.iterdir()] == ["counter"]


def test_unfinished_folders_of_this_output_alone_are_removed(tmp_path: Path):
    own, other = tmp_path / ".vlnpe-tmp-out.txt.abc", tmp_path / ".vlnpe-tmp-other.abc"
    own.mkdir()
    other.mkdir()
    once(tmp_path)
    assert not own.exists()
    assert other.exists()


def test_a_bad_number_of_workers_writes_nothing(tmp_path: Path):
    with pytest.raises(InputError, match="--workers -1"), open_single(tmp_path / "out", -1):
        pass
    assert not (tmp_path / LEDGERS).exists()
