"""`vlnpe train` from a recipe file to a policy that `vlnpe evaluate` takes."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.learning.conftest import Walks
from tests.learning.test_closed_loop import RECIPE, SMALL
from vlnpe.datasets.selection import select_all
from vlnpe.datasets.sequences import EpisodeSequences, SequenceConfig
from vlnpe.formats.core.atomic import file_digest
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.vlnce.files import read_episodes, write_episodes
from vlnpe.learning.card import read_card
from vlnpe.learning.training.corrections import CorrectedEpisodes
from vlnpe.pipeline.cli import main
from vlnpe.trajectory_sampler.config import SampleConfig
from vlnpe.trajectory_sampler.similarity import path_gap


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


def test_dagger_goes_on_with_corrected_walks(
    walks: Walks, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    call = ["train", recipe(tmp_path, steps=2), "--data", str(walks.root), "--out", str(out)]
    call += ["--threads", "1", "--run", str(run), "--dagger", "2", "--dagger-episodes", "2"]
    assert main([*call, "--json"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["checkpoint"] == str(out / "dagger-2" / "cma.safetensors")
    card, _ = read_card(out / "dagger-2" / "cma.safetensors")
    assert card.data[-1]["source"] == "corrections" and card.data[-1]["episodes"] == 4
    assert card.start == file_digest(out / "dagger-1" / "cma.safetensors")
    files = sorted((out / "dagger-1" / "walks").glob("*.npz"))
    item = CorrectedEpisodes(files, card.tokens, card.config)[0]
    plain = EpisodeSequences(
        select_all([walks.root / "lerobot" / "vlnce"]), card.tokens, SequenceConfig(24, future=8)
    )[0]
    assert item.keys() == plain.keys()
    for key, value in plain.items():
        if torch.is_tensor(value):
            assert item[key].dtype == value.dtype and item[key].shape[1:] == value.shape[1:], key
    # Both start at the same place: the same view, up to the codec, and the same advice.
    assert (item["rgb"][0].float() - plain["rgb"][0].float()).abs().mean() < 4
    assert item["action"][0] == plain["action"][0] and item["previous_action"][0] == 0
    assert int(item["length"]) > 1 and float(item["progress"].min()) >= 0
    # Killed between its walks, the same command makes the missing one alone, and the same.
    times = [path.stat().st_mtime_ns for path in files]
    content = files[1].read_bytes()
    files[1].unlink()
    (files[1].parent / "done").unlink()
    assert main([*call, "--json"]) == 0
    assert files[0].stat().st_mtime_ns == times[0] and files[1].read_bytes() == content
    capsys.readouterr()
    # Another number of walks would be other walks of the same names.
    assert main([*call[:-1], "1"]) == 2
    assert "other settings" in capsys.readouterr().err
    files[0].write_bytes(b"no walk")
    with pytest.raises(FileFormatError, match="0000"):
        CorrectedEpisodes(files, card.tokens, card.config)[0]


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
    files = sorted((out / "augmented").glob("*.npz"))
    assert 0 < len(files) <= len(episodes) <= 3
    added = card.data[-1]
    assert added["source"] == "augmented" and added["episodes"] == len(files)
    assert added["share"] == pytest.approx(len(files) / (len(files) + 2), abs=1e-6)
    for episode in episodes:
        assert episode.instruction and len(episode.extra["instructions"]) == 3
        for path in (held.reference_path_world_m, held.reference_path_world_m[::-1]):
            assert path_gap(episode.reference_path_world_m, path) >= SampleConfig.family_gap_m
    # The walk follows the expert to the goal.
    item = CorrectedEpisodes(files, card.tokens, card.config)[0]
    assert int(item["action"][-1]) == 0 and (item["action"][:-1] > 0).all()
    assert (item["previous_action"][1:] == item["action"][:-1] + 1).all()
    goal = episodes[int(files[0].stem)].goal_position_world_m[:2]
    start = episodes[int(files[0].stem)].start_position_world_m[:2]
    walked = float(np.linalg.norm(item["pose"][-1, :2].numpy()))
    assert abs(walked - float(np.linalg.norm(goal - start))) < 0.5
    # The same command makes nothing again; another number is refused.
    before = [path.stat().st_mtime_ns for path in files]
    assert main(call) == 0
    assert [path.stat().st_mtime_ns for path in files] == before
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
