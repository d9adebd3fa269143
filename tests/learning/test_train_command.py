"""`vlnpe train` from a recipe file to a policy that `vlnpe evaluate` takes."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.learning.conftest import Walks
from tests.learning.test_closed_loop import RECIPE, SMALL
from vlnpe.datasets.selection import select_all
from vlnpe.datasets.sequences import EpisodeSequences, SequenceConfig
from vlnpe.formats.core.atomic import file_digest
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.formats.vlnce.files import read_episodes, write_episodes
from vlnpe.learning.card import read_card
from vlnpe.pipeline.cli import main
from vlnpe.trajectory_sampler.config import SampleConfig
from vlnpe.trajectory_sampler.similarity import path_gap

pytestmark = pytest.mark.usefixtures("inline")


def recipe(tmp_path: Path, **train: object) -> str:
    path = tmp_path / "recipe.yaml"
    settings = {**RECIPE["train"], "steps": 4, "checkpoint_every": 2, "model": SMALL, **train}
    path.write_text(json.dumps({**RECIPE, "train": settings}))
    return str(path)


def test_from_recipe_to_checkpoint_chosen_in_closed_loop(
    walks: Walks, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    call = ["train", recipe(tmp_path), "--data", str(walks.root), "--out", str(out)]
    call += ["--threads", "1", "--run", str(run), "--validate", "1", "--json"]
    assert main(call) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["checkpoint"] == str(out / "cma.safetensors") and result["step"] in (2, 4)
    rows = list(csv.DictReader((out / "curves.csv").open()))
    assert [row["step"] for row in rows] == ["2", "4"]
    assert {"loss", "train action", "train constant", "SR", "OS"} <= set(rows[0])
    card, _ = read_card(out / "cma.safetensors")
    assert card.steps == result["step"] and card.recipe["mixture"] == "walks"
    assert card.view.camera == "ego:48x48:90"
    assert card.data[0]["episodes"] == 2 and card.controllers == ("flash",)
    before = (out / "cma.safetensors").stat().st_mtime_ns
    assert main(call) == 0  # finished: nothing is trained again
    assert (out / "cma.safetensors").stat().st_mtime_ns == before


def test_dagger_goes_on_with_what_the_expert_says_of_executed_actions(
    walks: Walks, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    call = ["train", recipe(tmp_path, steps=2), "--data", str(walks.root), "--out", str(out)]
    call += ["--threads", "1", "--run", str(run), "--dagger", "2", "--dagger-episodes", "2"]
    assert main([*call, "--json"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["checkpoint"] == str(out / "dagger-2" / "cma.safetensors")
    card, _ = read_card(out / "dagger-2" / "cma.safetensors")
    assert card.data[-1]["source"] == "dagger" and card.data[-1]["episodes"] == 4
    assert card.data[-1]["share"] == 0.5
    assert card.start == file_digest(out / "dagger-1" / "cma.safetensors")
    first = out / "dagger-1" / "walks"
    (dataset,) = (first / "lerobot").iterdir()
    config = SequenceConfig(24, future=8)
    item = EpisodeSequences(select_all([dataset]), card.tokens, config)[0]
    rollout = read_rollout(first / "vlnce" / "dagger" / "corner.mcap")
    assert item["uid"].endswith("/corner") and not item["waypoint_valid"].any()
    taken = [int(span.action) for span in rollout.actions]
    steps = len(taken)
    # Frames in which the robot comes to rest have the last action before STOP.
    assert item["action"][: steps - 1].tolist() == [int(a) for a in rollout.labels[:-1]]
    assert item["previous_action"][1:steps].tolist() == [1 + a for a in taken[:-1]]
    assert item["previous_action"][0] == 0
    assert item["previous_action"][1:].tolist() != (1 + item["action"][:-1]).tolist()
    # Done again, nothing is walked or trained again.
    times = [p.stat().st_mtime_ns for p in finished(out)]
    assert main([*call, "--json"]) == 0
    assert times == [p.stat().st_mtime_ns for p in finished(out)]
    # A dataset of an older version says what to do.
    info = json.loads((dataset / "meta" / "info.json").read_text())
    del info["features"]["action.executed"]
    (dataset / "meta" / "info.json").write_text(json.dumps(info))
    with pytest.raises(FileFormatError, match=r"lacks action.executed.*vlnpe dagger"):
        EpisodeSequences(select_all([dataset]), card.tokens, config)


def finished(out: Path) -> list[Path]:
    """Return what the rounds wrote last."""
    return [*sorted(out.rglob("*.mcap")), out / "dagger-2" / "cma.json"]


def test_a_recipe_trains_on_a_run_of_dagger(
    walks: Walks, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    walked = ["dagger", str(run), "--policy", "random", "--beta", "0.7", "--robot", "vlnce"]
    walked += ["--camera", "ego:48x48", "--controller", "flash", "--out", str(tmp_path / "round")]
    assert main([*walked, "--workers", "1"]) in (0, 1)
    sources = {"round": {"controllers": ["dagger"], "outcomes": []}}
    settings = {**RECIPE["train"], "steps": 2, "model": SMALL}
    path = tmp_path / "recipe.yaml"
    mixed = {"sources": sources, "mixtures": {"round": ["round"]}, "train": settings}
    path.write_text(json.dumps({**RECIPE, **mixed, "holdout": "none"}))
    call = ["train", str(path), "--data", str(tmp_path / "round"), "--threads", "1"]
    assert main([*call, "--out", str(tmp_path / "out")]) == 0
    card, _ = read_card(tmp_path / "out" / "cma.safetensors")
    assert card.controllers == ("dagger",) and card.data[0]["episodes"] == 2


def test_augmentation_trains_on_further_walks_away_from_held_out_ones(
    walks: Walks, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    held = replace(walks.episodes[0], split="val_seen", episode_id="held", trajectory_id="held")
    write_episodes(run / "episodes" / "val_seen.json.gz", [held])
    call = ["train", recipe(tmp_path, steps=2), "--data", str(walks.root), "--out", str(out)]
    call += ["--threads", "1", "--run", str(run), "--augment", "3", "--json"]
    assert main(call) == 0
    card, _ = read_card(out / "cma.safetensors")
    episodes = read_episodes(out / "augmented" / "episodes.json.gz")
    (dataset,) = (out / "augmented" / "walks" / "lerobot").iterdir()
    walked = select_all([dataset])
    assert 0 < len(walked) <= len(episodes) <= 3
    added = card.data[-1]
    arrived = [row.end_reason == "success" for row in map(walked.entry, range(len(walked)))]
    assert added["source"] == "augmented" and added["episodes"] == sum(arrived)
    assert added["share"] == pytest.approx(sum(arrived) / (sum(arrived) + 2), abs=1e-6)
    for episode in episodes:
        assert episode.instruction and len(episode.extra["instructions"]) == 3
        for path in (held.reference_path_world_m, held.reference_path_world_m[::-1]):
            assert path_gap(episode.reference_path_world_m, path) >= SampleConfig.family_gap_m
    # The walk follows the expert to the goal.
    number = arrived.index(True)
    item = EpisodeSequences(walked, card.tokens, SequenceConfig(24, future=8))[number]
    assert int(item["action"][-1]) == 0 and (item["action"][:-1] > 0).all()
    assert (item["previous_action"][1:] == item["action"][:-1] + 1).all()
    (episode,) = (e for e in episodes if item["uid"].endswith(f"/{e.episode_id}"))
    goal, start = episode.goal_position_world_m[:2], episode.start_position_world_m[:2]
    walked_m = float(np.linalg.norm(item["pose"][-1, :2].numpy()))
    assert abs(walked_m - float(np.linalg.norm(goal - start))) < 0.5
    # The same command makes nothing again; another number is refused.
    before = [path.stat().st_mtime_ns for path in sorted((out / "augmented").rglob("*.mcap"))]
    assert before and main(call) == 0
    after = [path.stat().st_mtime_ns for path in sorted((out / "augmented").rglob("*.mcap"))]
    assert after == before
    capsys.readouterr()
    assert main([*call[:-2], "2"]) == 2
    assert "other settings" in capsys.readouterr().err
    # A model that cannot be started from is told before any path is walked.
    elsewhere = [str(tmp_path / "elsewhere") if a == str(out) else a for a in call]
    assert main([*elsewhere, "--start", str(tmp_path / "none.safetensors")]) == 2
    assert "none.safetensors" in capsys.readouterr().err
    assert not (tmp_path / "elsewhere" / "augmented").exists()


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--model", "cms"], "cma"),
        (["--inputs", "rgb,smell"], "instruction"),
        (["--validate", "3"], "--run"),
        (["--dagger", "1"], "--run"),
        (["--augment", "1"], "--run"),
        (["--augment", "-1"], "0 or more"),
        (["--mixture", "other"], "walks"),
        (["--start", "nowhere.safetensors"], "nowhere"),
        (["--steps", "0"], "1 or more"),
    ],
)
def test_wrong_options_are_answered_with_the_valid_ones(
    options: list[str],
    reason: str,
    walks: Walks,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    call = ["train", recipe(tmp_path), "--data", str(walks.root), "--out", str(out), *options]
    assert main(call) == 2
    assert reason in capsys.readouterr().err
    assert not list(out.glob("*"))


@pytest.mark.parametrize("flag", ["--augment", "--dagger"])
def test_walks_of_actions_are_refused_for_a_model_of_waypoints(
    flag: str, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ["train", recipe(tmp_path, steps=2), "--data", str(tmp_path), "--model", "rdp"]
    assert main([*call, "--out", str(tmp_path / "o"), "--run", str(run), flag, "1"]) == 2
    error = capsys.readouterr().err
    assert f"{flag}: rdp predicts waypoints" in error and "valid: --model cma" in error
    assert not (tmp_path / "o").exists()
