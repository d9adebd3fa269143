"""`vlnpe ablate`: trains and walks for real on two rooms, and does nothing twice."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from tests.collectors.test_replay import make_episode
from tests.learning.conftest import Walks
from tests.learning.test_closed_loop import RECIPE, SMALL
from vlnpe.datasets.mixture.recipe import recipe_of
from vlnpe.formats.core.atomic import file_digest
from vlnpe.formats.vlnce.files import write_episodes
from vlnpe.learning.checkpoint import load_checkpoint
from vlnpe.learning.training.curves import TrainingLog
from vlnpe.pipeline.ablation.cells import TRAININGS, train
from vlnpe.pipeline.ablation.plan import CACHE, plan_ablation
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.options.training import Ablate

GOALS = ((2.6, 2.0), (1.0, 0.6), (2.4, 0.8), (0.9, 1.6), (2.0, 1.8), (1.8, 0.7))


@pytest.fixture
def run(run: Path, walks: Walks) -> Path:
    unseen = [
        replace(make_episode(walks.scene, (0.9, 2.3), goal, name=f"u{k}"), split="val_unseen")
        for k, goal in enumerate(GOALS)
    ]
    write_episodes(run / "episodes" / "val_unseen.json.gz", unseen)
    return run


def recipe(**comparison: Any) -> dict[str, Any]:
    train = {**RECIPE["train"], "steps": 4, "checkpoint_every": 2, "seeds": 2, "model": SMALL}
    rows = {
        "all senses": {"mixture": "walks"},
        "vision-blind": {"mixture": "walks", "train": {"model": {"inputs": ["instruction"]}}},
        "forward": {"policy": "forward"},
    }
    claims = [{"text": "Vision helps", "more": "all senses", "less": "vision-blind"}]
    tests = {"no body": {"robot": "vlnce", "controller": "flash"}}
    given = {"tests": tests, "rows": rows, "claims": claims, "walks": 6} | comparison
    return {**RECIPE, "title": "Tiny", "train": train, "comparison": given}


def options(walks: Walks, run: Path, tmp_path: Path, **more: Any) -> Ablate:
    return Ablate("recipe", data=walks.root, run=run, out=tmp_path / "out", **more)


def planned(walks: Walks, run: Path, tmp_path: Path, value: Mapping[str, Any], **more: Any) -> Any:
    return plan_ablation(options(walks, run, tmp_path, **more), recipe_of(value), "")


@pytest.mark.slow
def test_from_recipe_to_answer_and_again_without_training_or_walking(
    walks: Walks, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "recipe.yaml", tmp_path / "out"
    path.write_text(json.dumps(recipe()))
    call = ["ablate", str(path), "--data", str(walks.root), "--run", str(run), "--out", str(out)]
    call += ["--threads", "1", "--workers", "1", "--json"]
    assert main(call) == 0
    value = json.loads(capsys.readouterr().out.splitlines()[-1])
    rows = {row["row"]: row for row in value["rows"]}
    assert {name: len(row["seeds"]) for name, row in rows.items()} == {
        "all senses": 2,
        "vision-blind": 2,
        "forward": 1,  # always walks the same
    }
    assert len(value["episodes"]) == 6 and {e[0] for e in value["episodes"]} == {"val_unseen"}
    shas = {c["checkpoint_sha256"] for row in rows.values() for c in row["seeds"].values()}
    assert len(shas) == 5 and None in shas
    for row in rows.values():
        for cell in row["seeds"].values():
            assert all(len(walk) == len(value["metrics"]) for walk in cell["values"])
            assert not cell["failed"]
    (judged,) = value["judged"]
    assert judged["verdict"] in {"shown", "not shown", "the opposite is shown"}
    report = (out / "report.md").read_text()
    assert "Vision helps" in report and "| forward | – | 1 |" in report
    assert "<svg" in (out / "rates.svg").read_text()

    files = [p for p in out.rglob("*") if p.name in ("done", "results.json") or p.suffix == ".mcap"]
    times = {p: p.stat().st_mtime_ns for p in files if p.parent != out and "walks" not in p.parts}
    walked = {p: p.stat().st_mtime_ns for p in out.rglob("*.mcap")}
    assert len(walked) == 5 * 6
    assert main(call) == 0
    again = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert again == value
    assert {p: p.stat().st_mtime_ns for p in times} == times
    assert {p: p.stat().st_mtime_ns for p in walked} == walked

    other = tmp_path / "other"
    call[call.index(str(out))] = str(other)
    call += ["--trainings", str(out), "--rows", "all senses", "--walks", "2"]
    assert main(call) == 0
    (row,) = json.loads(capsys.readouterr().out.splitlines()[-1])["rows"]
    assert {cell["checkpoint_sha256"] for cell in row["seeds"].values()} <= shas
    assert not (other / TRAININGS).exists() and not (other / CACHE).exists()
    call[call.index("--trainings") + 1] = str(tmp_path / "mistyped")
    assert main(call) == 2
    assert "mistyped: no such folder" in capsys.readouterr().err


def test_a_killed_training_ends_as_if_it_had_not_been(
    walks: Walks, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = train(planned(walks, run, tmp_path, recipe()), "all senses", 0, tmp_path / "whole")
    ablation, out = planned(walks, run, tmp_path, recipe()), tmp_path / "killed"
    step = TrainingLog.step

    def killed(self: TrainingLog, done: int, loss: float | None, bar: Any) -> None:
        step(self, done, loss, bar)
        if done == 3:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(TrainingLog, "step", killed)
        with pytest.raises(KeyboardInterrupt):
            train(ablation, "all senses", 0, out)
    (folder,) = (out / TRAININGS).iterdir()
    # Weights of an earlier step are there, but the cell is not finished.
    assert list(folder.glob("*.safetensors")) and not (folder / "done").exists()
    resumed = train(ablation, "all senses", 0, out)
    assert resumed.parent == folder and (folder / "done").is_file()
    pair = [load_checkpoint(path).model.state_dict() for path in (whole, resumed)]
    assert all(torch.equal(value, pair[1][name]) for name, value in pair[0].items())
    before = resumed.stat().st_mtime_ns
    assert train(ablation, "all senses", 0, out) == resumed
    assert resumed.stat().st_mtime_ns == before
    # Rows that are trained in the same way share the training; other seeds and inputs do not.
    assert train(ablation, "all senses", 1, out) != resumed
    twin = recipe(
        rows={"all senses": {"mixture": "walks"}, "twin": {"mixture": "walks"}}, claims=[]
    )
    assert train(planned(walks, run, tmp_path, twin), "twin", 0, out) == resumed
    assert file_digest(whole) == file_digest(resumed)


def test_only_episodes_that_no_row_is_trained_on_are_walked(
    walks: Walks, run: Path, tmp_path: Path
) -> None:
    ablation = planned(walks, run, tmp_path, recipe())
    trained = set(ablation.trainings["all senses"].planned.plan.sources[0].selection.trajectories())
    assert len(trained) == 2
    walked = {f"{e.scene_id}/{e.trajectory_id}" for e in ablation.episodes}
    assert len(walked) == 6 and not walked & trained
    # Held out by path: one of the two is trained on, the other is walked.
    by_path = planned(walks, run, tmp_path, recipe() | {"holdout": "trajectory"}, split="train")
    (trained_path,) = (
        by_path.trainings["vision-blind"].planned.plan.sources[0].selection.trajectories()
    )
    (episode,) = by_path.episodes
    assert f"{episode.scene_id}/{episode.trajectory_id}" in trained - {trained_path}


def test_rows_without_data_are_left_out_with_a_warning(
    walks: Walks, run: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    value = recipe()
    value["sources"] = {**value["sources"], "h1": {"robots": ["h1"]}}
    value["mixtures"] = {**value["mixtures"], "both": ["walks", "h1"]}
    value["comparison"]["rows"]["both"] = {"mixture": "both"}
    ablation = planned(walks, run, tmp_path, value)
    assert set(ablation.missing) == {"both"} and "row 'both' is not measured" in caplog.text
    assert set(ablation.trainings) == {"all senses", "vision-blind"}


def test_steps_of_the_command_keep_the_ratio_of_rows(
    walks: Walks, run: Path, tmp_path: Path
) -> None:
    value = recipe()
    value["comparison"]["rows"]["longer"] = {"mixture": "walks", "train": {"steps": 8}}
    ablation = planned(walks, run, tmp_path, value, steps=10, seeds=3)
    steps = {name: t.planned.config.steps for name, t in ablation.trainings.items()}
    assert steps == {"all senses": 10, "vision-blind": 10, "longer": 20}
    assert ablation.seeds == (0, 1, 2)


@pytest.mark.parametrize(
    ("change", "more", "message"),
    [
        ({"tests": {"x": {"robot": "h2"}}}, [], "unknown robot 'h2'"),
        ({"tests": {"x": {"robot": "h1", "controller": "path"}}}, [], "controller 'path'"),
        ({"rows": {"x": {"policy": "randm"}}, "claims": []}, [], "'randm'"),
        ({}, ["--rows", "all sense"], "unknown row 'all sense' (did you mean all senses?)"),
        ({}, ["--walks", "0"], "--walks 0; valid: 1 or more"),
        ({}, ["--split", "test"], "unknown split 'test'; valid: train, val_unseen"),
        ({}, ["--split", "train"], "none of its 2 episodes is held out"),
    ],
)
def test_mistakes_are_named_before_anything_is_trained(
    walks: Walks,
    run: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: dict[str, Any],
    more: list[str],
    message: str,
) -> None:
    path, out = tmp_path / "recipe.yaml", tmp_path / "out"
    path.write_text(json.dumps(recipe(**change)))
    call = ["ablate", str(path), "--data", str(walks.root), "--run", str(run), "--out", str(out)]
    assert main([*call, *more]) == 2
    assert message in capsys.readouterr().err and not out.exists()
