"""A stage's bar while one item takes long: it advances by what the item's worker tells."""

from pathlib import Path

import pytest

from tests.support.runs import work
from vlnpe.formats.core.atomic import sweep_beside
from vlnpe.formats.process import progress
from vlnpe.pipeline.engine.ledger import Ledger
from vlnpe.pipeline.engine.work import WorkItem
from vlnpe.pipeline.execution import parts
from vlnpe.pipeline.execution.runner import Context, run_stage


def test_a_bar_advances_while_its_items_are_being_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "SHORT_S", 0.0)
    monkeypatch.setattr(parts, "READ_EVERY_S", 0.01)
    paths = [tmp_path / "first.mp4", tmp_path / "second.mp4"]
    items = [
        WorkItem(path.stem, "k", (path,), work.Call(work.tell, (path, part, 1.0)))
        for path, part in zip(paths, (0.5, 0.75), strict=True)
    ]
    summary = run_stage(Context(Ledger(tmp_path), work.InlineWorkers(1)), "video", items)
    assert summary.done == 2
    counts = [line.split()[2] for line in capsys.readouterr().err.splitlines()]
    assert counts[0] == "0/2" and counts[-1] == "2/2" and "0.5/2" in counts
    assert sorted(p.name for p in tmp_path.glob("*.mp4")) == ["first.mp4", "second.mp4"]
    assert not [p for p in tmp_path.iterdir() if "part" in p.name]


def test_what_is_told_goes_with_the_worker_and_never_leads_a_bar_back(tmp_path: Path) -> None:
    out = tmp_path / "a.walk.mp4"
    item = WorkItem("a", "k", (out,), work.Call(work.write, (out, "")))
    with progress.progress_bar("video", 1, show=False) as bar:
        looked = parts.Watch(bar, [item])
        with parts.telling(out) as tell:
            tell(0.4)
            tell(0.9)  # within the same second
            looked.refresh()
            assert bar.n == 0.4
            sweep_beside([out])  # as after a worker that was killed
            assert list(tmp_path.iterdir()) == []
            looked.refresh()
            assert bar.n == 0.4
        looked.count(item, "")
        looked.refresh()
        assert bar.n == 1


@pytest.mark.parametrize("text", ["", "nan", "half", "7"])
def test_what_cannot_be_read_is_no_more_than_all(tmp_path: Path, text: str) -> None:
    out = tmp_path / "a.mp4"
    with parts.telling(out) as tell:
        tell(0.5)
        (written,) = tmp_path.iterdir()
        written.write_text(text)
        assert 0.0 <= parts.part_done(out) <= 1.0
