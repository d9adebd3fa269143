"""`vlnpe convert` to the layout and from it."""

import json
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.formats.internnav.layouts import (
    loader_data,
    loader_keys,
    make_foreign,
)
from tests.formats.internnav.test_damage import break_layout
from tests.formats.mcap.test_episode import decode
from tests.support.lerobot_data import write_foreign_dataset, write_unit
from tests.support.rollouts import make_rollout
from vlnpe.formats.convert.dataset import open_dataset
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.internnav.foreign import Assumptions
from vlnpe.formats.internnav.tokens import read_vocabulary
from vlnpe.formats.lerobot import assemble_dataset
from vlnpe.pipeline import cli
from vlnpe.pipeline.engine.ledger import Ledger
from vlnpe.pipeline.stages.convert.source import Options, detect, unit_items


def test_the_command_converts_to_the_layout_and_back(
    units: list[Path],
    tmp_path: Path,
    inline: None,
    caplog: pytest.LogCaptureFixture,
) -> None:
    assemble_dataset(units, tmp_path / "set", provenance={"a": 1}, licence="mit", title="Set")
    words = tmp_path / "train.json"
    words.write_text(
        json.dumps({"instruction_vocab": {"word_list": ["<pad>", "<unk>", "sofa", "walk", "."]}})
    )
    call = [
        "convert",
        str(tmp_path / "set"),
        "--to",
        "n1",
        "--out",
        str(tmp_path / "there"),
        "--every-frame",
    ]
    assert cli.main([*call, "--vocabulary", str(words), "--scan", "r2r_flash"]) == 0
    root = tmp_path / "there" / "n1" / "set"
    tasks = [t for key in loader_keys(root, ["r2r_flash"]) for t in loader_data(root, key)["tasks"]]
    assert tasks[0]["instruction_tokens"][:3] == [3, 1, 1]
    assert cli.main(["verify", str(tmp_path / "there")]) == 0
    back = ["convert", str(root), "--to", "lerobot", "--out", str(tmp_path / "back")]
    assert cli.main(back) == 0
    assert cli.main(["verify", str(tmp_path / "back")]) == 0
    break_layout(root / "r2r_flash" / "two-rooms", "cut colour")
    assert cli.main(["verify", str(tmp_path / "there")]) == 1
    assert open_dataset(tmp_path / "back/lerobot/set").facts == open_dataset(tmp_path / "set").facts
    assert "images are 96 × 64 px" in caplog.text
    with pytest.raises(FileFormatError, match="no instruction_vocab"):
        read_vocabulary(tmp_path / "set" / "meta" / "info.json")


def test_the_command_converts_theirs_and_quarantines_what_is_damaged(
    layout: Path,
    tmp_path: Path,
    inline: None,
    caplog: pytest.LogCaptureFixture,
) -> None:
    scene = make_foreign(layout) / "r2r" / "two-rooms"
    break_layout(scene, "cut colour")
    out = tmp_path / "out"
    call = ["convert", str(layout), "--to", "lerobot", "--out", str(out), "--max-failed", "1"]
    assert cli.main([*call, "--licence", "cc-by-nc-sa-4.0"]) == 0
    (bad,) = [r for r in Ledger(out).rows() if r.status == "quarantined"]
    assert "episode_000000.npy" in bad.error["reason"]
    opened = open_dataset(out / "lerobot" / "n1")
    assert opened.episodes == (0, 1) and opened.facts.licence == "cc-by-nc-sa-4.0"
    converted = opened.facts.provenance["converted"]
    assert converted["assumed"]["hfov_deg"] == 90.0 and "goal" in converted["missing"]
    assert "2 episodes declare 30 frames/s" in caplog.text
    call = ["convert", str(layout), "--to", "mcap", "--out", str(tmp_path / "m")]
    assert cli.main([*call, "--max-failed", "1"]) == 0
    made = sorted((tmp_path / "m" / "mcap" / "n1").iterdir())
    assert [p.name for p in made] == ["r2r-two-rooms-000001.mcap", "r2r-two-rooms-000002.mcap"]
    topics = decode(made[0])
    assert "/imu" not in topics and len(topics["/camera/rgb"]) == 13


@pytest.mark.parametrize(
    "name",
    ["info.json", "tasks.jsonl", "episodes.jsonl", "episodes_stats.jsonl", "vlnpe_episodes.jsonl"],
)
def test_changed_metadata_is_converted_again(layout: Path, tmp_path: Path, name: str) -> None:
    def keys() -> list[str]:
        (items,) = unit_items(
            detect(layout), tmp_path, Options("mit", None, Assumptions())
        ).values()
        return [item.key for item in items]

    before = keys()
    assert before == keys()
    path = layout / "r2r" / "two-rooms" / "meta" / name
    path.write_text(path.read_text() + "\n")
    assert not set(before) & set(keys())


def test_other_frame_rates_have_steps_but_no_actions(tmp_path: Path, inline: None) -> None:
    unit = write_unit(tmp_path, make_rollout(1.0), frames_per_second=10)
    assemble_dataset([unit], tmp_path / "set", provenance={}, licence="mit", title="Set")
    out = tmp_path / "out"
    call = ["convert", str(tmp_path / "set"), "--to", "n1", "--out", str(out)]
    assert cli.main(call) == 0
    assert cli.main([*call, "--every-frame"]) == 1
    (bad,) = [r for r in Ledger(out).rows() if r.status == "quarantined"]
    assert "no action.discrete at 10 frames/s; valid: 4" in bad.error["reason"]


@pytest.mark.parametrize("version", ["v2.1", "v2.0", "v1.6", "v4.0", None, 3])
@pytest.mark.parametrize("place", [".", "unitree/g1", "a/b/c"])
def test_other_versions_of_lerobot_are_named(
    version: object, place: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    write_foreign_dataset(tmp_path / "in" / place, version)
    call = ["convert", str(tmp_path / "in"), "--to", "mcap", "--out", str(tmp_path / "out")]
    assert cli.main(call) == 2
    said = capfd.readouterr().err
    old = str(version).startswith(("v1", "v2"))
    assert "valid: LeRobot v3.0" in said and ("convert_dataset_v21_to_v30" in said) == old
    assert f"LeRobot {version if isinstance(version, str) else f'version {version}'}" in said
    assert not (tmp_path / "out").exists()


def test_the_named_script_is_the_one_that_lerobot_has() -> None:
    assert find_spec("lerobot.scripts.convert_dataset_v21_to_v30") is not None
