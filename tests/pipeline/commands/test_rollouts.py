"""`vlnpe replay`, `render` and `export` of a run folder: in the run's own scenes."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from tests.collectors.test_replay import make_episode
from tests.support.runs.work import InlineWorkers
from tests.support.scenes.rooms import write_two_rooms
from vlnpe.formats.vlnce.files import write_episodes
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.engine.ledger import Ledger
from vlnpe.pipeline.execution import settings as executors


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a scene, and two splits whose episodes have the same id."""
    monkeypatch.setattr(executors, "Workers", InlineWorkers)
    run = tmp_path / "run"
    bundle = write_two_rooms(run / "scenes" / "two_rooms")
    episode = make_episode(bundle, (2.6, 2.0), (3.4, 2.0), name="e")
    (run / "episodes").mkdir()
    for split in ("train", "val_unseen"):
        told = replace(episode, split=split, instruction="Walk on.")
        write_episodes(run / "episodes" / f"{split}.json.gz", [told])
    return run


def called(command: str, given: Path, out: Path, *options: str) -> int:
    return main([command, str(given), "--out", str(out), "--workers", "1", *options])


@pytest.mark.chain
def test_the_stages_after_episodes_take_the_scenes_of_the_run(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert called("replay", run, out, "--robot", "vlnce") == 0
    walked = [row.item for row in Ledger.existing(out).rows("replay")]
    assert walked == ["vlnce/flash/train-e", "vlnce/flash/val_unseen-e"]
    assert (
        called("replay", run / "episodes" / "train.json.gz", tmp_path / "one", "--robot", "vlnce")
        == 0
    )
    capsys.readouterr()
    for command in ("render", "export"):
        assert called(command, out, tmp_path / "no") == 2
        assert (
            capsys.readouterr()
            .err.strip()
            .endswith(f"{out}: contains no scenes/; give it with --scenes FOLDER")
        )
    shutil.copytree(run / "scenes", out / "scenes")
    assert called("render", out, out, "--camera", "ego:64x48") == 0
    assert called("export", out, tmp_path / "data") == 0
    assert len(list((tmp_path / "data" / "mcap").rglob("*.mcap"))) == 2


@pytest.mark.chain
def test_the_rigs_of_a_preset_come_from_one_walk_and_are_what_each_alone_is(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, alone = tmp_path / "out", tmp_path / "alone"
    episodes = run / "episodes" / "train.json.gz"
    assert called("replay", episodes, out, "--robot", "jetbot") == 0
    walked = {path: path.stat().st_mtime_ns for path in out.rglob("*.mcap")}
    assert len(walked) == 1
    scenes = ("--scenes", str(run / "scenes"))
    assert called("render", out, out, *scenes, "--camera", "rig:n1:32x32") == 0
    assert walked == {path: path.stat().st_mtime_ns for path in walked}
    assert len(Ledger.existing(out).rows("render")) == 5
    assert called("render", out, alone, *scenes, "--camera", "rig:60cm_15deg:32x32") == 0
    (folder,) = alone.glob("jetbot/path/rig-60cm_15deg-32x32-90deg-baked/e")
    files = [folder / name for name in ("rgb.mp4", "depth.mp4", "frames.npz", "meta.json")]
    for file in files:
        assert file.read_bytes() == (out / file.relative_to(alone)).read_bytes()
    before = [file.stat().st_mtime_ns for file in files]
    same = ("--camera", "ego:32x32", "--camera-height", "0.6", "--camera-pitch", "15")
    assert called("render", out, alone, *scenes, *same) == 0
    assert before == [file.stat().st_mtime_ns for file in files]  # the same rig: nothing is done
    capsys.readouterr()
    for wrong in ("rig:n3", "rig:900cm_0deg", "rig:60cm_120deg"):
        assert called("render", out, tmp_path / "no", *scenes, "--camera", wrong) == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert "valid: " in line and not (tmp_path / "no").exists()
