"""`vlnpe train` from a recipe file to a policy that `vlnpe evaluate` takes."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from tests.learning.conftest import Walks
from tests.learning.test_closed_loop import RECIPE, SMALL
from vlnpe.formats.vlnce.files import write_episodes
from vlnpe.learning.card import read_card
from vlnpe.pipeline.cli import main


@pytest.fixture
def run(walks: Walks, tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    (folder / "episodes").mkdir(parents=True)
    (folder / "scenes").mkdir()
    (folder / "scenes" / "two_rooms").symlink_to(walks.scene.root)
    write_episodes(folder / "episodes" / "train.json.gz", walks.episodes)
    return folder


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
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["checkpoint"] == str(out / "cma.safetensors") and told["step"] in (2, 4)
    rows = list(csv.DictReader((out / "curves.csv").open()))
    assert [row["step"] for row in rows] == ["2", "4"]
    assert {"loss", "train action", "train constant", "SR", "OS"} <= set(rows[0])
    card, _ = read_card(out / "cma.safetensors")
    assert card.steps == told["step"] and card.recipe["mixture"] == "walks"
    assert card.view.camera("ego") == "ego:48x48:90"
    assert card.data[0]["episodes"] == 2 and card.controllers == ("flash",)
    before = (out / "cma.safetensors").stat().st_mtime_ns
    assert main(call) == 0  # finished: nothing is trained again
    assert (out / "cma.safetensors").stat().st_mtime_ns == before


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--model", "cms"], "cma"),
        (["--inputs", "rgb,smell"], "instruction"),
        (["--validate", "3"], "--run"),
        (["--mixture", "other"], "walks"),
        (["--start", "nowhere.safetensors"], "nowhere"),
        (["--steps", "0"], "1 or more"),
    ],
)
def test_wrong_options_are_answered_with_the_valid_ones(
    options: list[str],
    told: str,
    walks: Walks,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    call = ["train", recipe(tmp_path), "--data", str(walks.root), "--out", str(out), *options]
    assert main(call) == 2
    assert told in capsys.readouterr().err
    assert not list(out.glob("*"))
