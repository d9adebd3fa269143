"""Film strips of the report: which episode of a dataset they show."""

import logging
from pathlib import Path

import pytest

from vlnpe.pipeline.engine.ledger import Ledger
from vlnpe.pipeline.engine.rows import Row
from vlnpe.pipeline.engine.run_folder import RunFolder
from vlnpe.pipeline.report.items import strip_items

EGO, CHASE = "ego-64x64", "chase-64x64"


@pytest.fixture
def ledger(tmp_path: Path) -> Ledger:
    """Two walks of one robot, rendered by two cameras."""
    ledger = Ledger(tmp_path)
    for episode in "ab":
        facts = {"episode": episode, "robot": "h1", "scene": "home"}
        out = f"rollouts/h1/path/{episode}.mcap"
        ledger.add(Row("replay", f"h1/path/{episode}", "k", "done", outputs=(out,), facts=facts))
        for view in (EGO, CHASE):
            name = f"h1/path/{view}/{episode}"
            ledger.add(Row("render", name, f"key of {name}", "done", outputs=(f"frames/{name}",)))
            (tmp_path / "frames" / name).mkdir(parents=True)
    return ledger


def shown(ledger: Ledger) -> dict[str, str]:
    """Return the episode that each dataset's strip shows."""
    items = strip_items(RunFolder(ledger.root), ledger, ledger.rows("replay"))
    return {name: item.job.frames.name for name, item in items.items()}  # type: ignore[attr-defined]


@pytest.mark.parametrize("gone", ["a", "b", "ab"])
def test_frames_deleted_by_hand_stop_no_other_camera(
    ledger: Ledger, gone: str, caplog: pytest.LogCaptureFixture
) -> None:
    whole = shown(ledger)
    assert whole == {f"h1-path-{EGO}": "a", f"h1-path-{CHASE}": "a"}
    for episode in gone:
        (ledger.root / "frames/h1/path" / EGO / episode).rmdir()
    left = [episode for episode in "ab" if episode not in gone]
    expected = {f"h1-path-{CHASE}": "a"} | ({f"h1-path-{EGO}": left[0]} if left else {})
    assert shown(ledger) == expected
    assert (f"h1-path-{EGO}: its frames are gone" in caplog.text) == (not left)


def test_a_strip_drawn_before_its_frames_were_deleted_stays(
    ledger: Ledger, caplog: pytest.LogCaptureFixture
) -> None:
    items = strip_items(RunFolder(ledger.root), ledger, ledger.rows("replay"))
    item = items[f"h1-path-{EGO}"]
    item.outputs[0].parent.mkdir(parents=True)
    item.outputs[0].touch()
    ledger.add(Row("pictures", item.name, item.key, "done", outputs=("report/strips/x.jpg",)))
    for episode in "ab":
        (ledger.root / "frames/h1/path" / EGO / episode).rmdir()
    with caplog.at_level(logging.WARNING):
        assert shown(ledger)[f"h1-path-{EGO}"] == "a"
    assert not caplog.text
