"""Checkpoints that come with vlnpe are small, whole, and drive the robot by their names."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.collectors.test_replay import make_episode
from tests.learning.conftest import Walks
from vlnpe.evaluation.policies.registry import resolve_policy, shipped_policies
from vlnpe.formats.core.atomic import file_digest
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.errors import InputError
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.learning import pretrained, weights
from vlnpe.learning.card import card_path, read_card
from vlnpe.learning.checkpoint import load_checkpoint
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.collect.evaluation import _warn_of_other_training

RESULTS = Path(__file__).resolve().parents[2] / "benchmarks" / "evidence" / "results"
LARGEST_BYTES = 2_000_000


# Which results measured them, and which row, test and seed; or which evaluation.
CELLS = {
    "cma": ("evidence", "CMA on bodyless walks, 3 times the steps", "no body", "2"),
    "cma-h1": ("evidence", "CMA on H1", "H1", "0"),
    "cma-robots": ("senses", "small_house, h1, pretrained"),
    "cma-robots-32px": ("mixtures", "CMA on H1 + Aliengo + Jetbot, equal passes", "Aliengo", "0"),
}


def test_every_shipped_checkpoint_is_one_that_was_measured() -> None:
    assert shipped_policies().keys() == CELLS.keys()
    for name, (file, *cell) in CELLS.items():
        results = json.loads((RESULTS / f"{file}.json").read_text())
        if len(cell) == 1:
            measured = results[cell[0]]["setting"]["policy_version"].split()[1]
        else:
            row, test, seed = cell
            (found,) = (r for r in results["rows"] if (r["row"], r["test"]) == (row, test))
            measured = found["seeds"][seed]["checkpoint_sha256"]
        assert file_digest(shipped_policies()[name]) == measured


@pytest.mark.parametrize("name", CELLS)
def test_a_shipped_checkpoint_is_small_and_whole(name: str) -> None:
    path = shipped_policies()[name]
    assert path.stat().st_size + card_path(path).stat().st_size < LARGEST_BYTES
    checkpoint = load_checkpoint(path)
    assert checkpoint.card.config.model.name == "cma"
    assert "/" not in "".join(d for s in checkpoint.card.data for d in s["datasets"])


def test_unfamiliar_settings_are_warned_of(
    two_rooms: SceneBundle, caplog: pytest.LogCaptureFixture
) -> None:
    level = make_episode(two_rooms, (0.9, 2.3), (6.0, 2.0))

    def warn(policy: str, robot: str, controller: str, *episodes: Episode) -> None:
        card, _ = read_card(shipped_policies()[policy])
        test = {"robot": robot, "controller": controller, "light": "baked"}
        _warn_of_other_training(policy, card, test, episodes or [level])

    for policy, robot, controller in (
        ("cma", "vlnce", "flash"),
        ("cma-h1", "h1", "speed"),
        *(
            (policy, robot, "speed")
            for policy in ("cma-robots", "cma-robots-32px")
            for robot in ("h1", "aliengo", "jetbot")
        ),
    ):
        warn(policy, robot, controller)
    assert not caplog.records
    warn("cma", "aliengo", "speed")
    assert "cma was trained on robot vlnce, not on aliengo" in caplog.text
    assert "cma was trained on controller flash, not on speed" in caplog.text
    upstairs = replace(level, extra={"staircases": [0], "levels": [level.level, 1]})
    warn("cma-robots", "aliengo", "speed", level, upstairs)
    assert "cma-robots was trained on no stairs, and 1 of 2 paths take some" in caplog.text
    assert "was trained in" not in caplog.text
    home = replace(level, scene_id="apartment-0")
    warn("cma-robots", "aliengo", "speed", level, home, replace(home, scene_id="exact-villa-0"))
    assert "cma-robots was trained in apartment-0, villa-0, where 2 of 3 paths are" in caplog.text


def test_one_with_pretrained_encoders_says_which_extra_it_needs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(weights, "find_spec", lambda name: None)
    pretrained._kept.cache_clear()
    with pytest.raises(InputError, match="EXTRA=pretrained"):
        resolve_policy("cma-robots").identity()
    assert resolve_policy("cma-robots-32px").identity()


@pytest.mark.usefixtures("inline")
def test_it_is_evaluated_by_name_and_sees_through_its_own_camera(
    walks: Walks, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ["evaluate", str(run), "--policy", "cma", "--robot", "vlnce", "--workers", "1"]
    assert main([*call, "--json"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["setting"]["policy_version"] == resolve_policy("cma").identity()
    assert "128x128" in result["setting"]["view"] and not result["quarantined"]
    (results,) = run.glob("evaluations/*/results.json")
    outcomes = json.loads(results.read_text())["episodes"]
    assert len(outcomes) == len(walks.episodes)
