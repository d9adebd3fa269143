"""A robot's log becomes training data beside simulated walks, as guides/real-robot.md shows it."""

import json
from pathlib import Path

import pytest

from tests.support.pages import ROOT, blocks
from tests.support.training_data import write_dataset
from vlnpe.formats.ros2.topic_map import read_topic_map
from vlnpe.pipeline.cli import main

pytestmark = [pytest.mark.slow, pytest.mark.chain]


def run(*words: str) -> None:
    assert main(list(words)) == 0, words


def test_a_recipe_mixes_simulated_and_recorded_walks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    topics, recipe = blocks(ROOT / "docs" / "guides" / "real-robot.md", "yaml")
    Path("topics.yaml").write_text(topics)
    assert read_topic_map(Path("topics.yaml")).odometry == "/utlidar/robot_odom"
    Path("mine.yaml").write_text(recipe)
    simulated = write_dataset(
        tmp_path / "runs" / "apartment-0", "aliengo", [3.0 + n for n in range(4)]
    )
    run("convert", str(simulated), "--to", "ros2", "--out", "bags")
    (bags,) = Path("bags/ros2").iterdir()
    assert len([path for path in bags.iterdir() if path.is_dir()]) == 4
    run("convert", str(bags), "--robot", "aliengo", "--out", "converted")
    capsys.readouterr()
    run("mix", "mine.yaml", "--data", ".", "--out", "chosen.json")
    shares = capsys.readouterr().out
    assert "simulated" in shares and "recorded" in shares
    chosen = Path("chosen.json").read_text()
    assert "runs/apartment-0/lerobot" in chosen and "converted/lerobot" in chosen
    run("train", "mine.yaml", "--data", ".", "--steps", "3", "--out", "trained")
    assert json.loads(Path("trained/cma.json").read_text())
