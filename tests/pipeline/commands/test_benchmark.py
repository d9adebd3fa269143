"""`vlnpe benchmark`: one table of several evaluations."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.collectors.test_replay import make_episode
from tests.support.runs.work import InlineWorkers
from tests.support.scenes.rooms import write_two_rooms
from vlnpe.formats.vlnce.files import read_episodes, write_episodes
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.execution import settings as executors
from vlnpe.pipeline.inputs.benchmark_sets import SETS, episodes_digest, paths_digest
from vlnpe.pipeline.inputs.builtin import parse_builtin
from vlnpe.trajectory_sampler.presets import choose_seen, plan_quotas

pytestmark = pytest.mark.chain


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run folder with a scene and two episodes in two splits."""
    monkeypatch.setattr(executors, "Workers", InlineWorkers)
    run = tmp_path / "run"
    bundle = write_two_rooms(run / "scenes" / "two_rooms")
    (run / "episodes").mkdir()
    for k, split in enumerate(("val_seen", "val_unseen")):
        episode = make_episode(bundle, (2.6, 2.0), (5.4, 2.0), name=f"e{k}")
        instructed = replace(episode, split=split, instruction="Go through the door.")
        write_episodes(run / "episodes" / f"{split}.json.gz", [instructed])
    return run


def test_every_policy_meets_every_robot_that_its_controller_can_drive(run, capsys) -> None:
    call = ["benchmark", str(run), "--policy", "stop,forward", "--robot", "aliengo,vlnce"]
    call += ["--workers", "1"]
    # What an earlier call asked for is not evaluated again.
    assert main([*call, "--controller", "flash", "--split", "val_seen"]) == 0
    call += ["--split", "val_unseen"]
    assert main([*call, "--controller", "flash", "--json"]) == 0
    value = json.loads(capsys.readouterr().out.splitlines()[-1])
    cells = [(c["controller"], c["robot"], c["policy"], c["count"]) for c in value["cells"]]
    assert cells == [
        ("flash", robot, policy, 1)
        for robot in ("aliengo", "vlnce")
        for policy in ("stop", "forward")
    ]
    assert value["episodes"] == {"val_unseen": 1} and len(value["lock_sha256"]) == 64
    page = (run / "benchmark" / "benchmark.md").read_text()
    assert page.count("| flash |") == 4 and "1 of 1 val_unseen" in page
    stop = value["cells"][0]["summary"]
    assert stop["TL"]["mean"] == 0.0 and stop["SR"]["mean"] == 100.0  # 2.8 m from the goal


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--policy", "guess"], "policy 'guess'"),
        (["--controller", "path"], "controller of a benchmark 'path'"),
        (["--split", "test"], "split 'test'"),
        (["--out", "elsewhere"], "--out elsewhere: results of a run go to its own benchmark/"),
        (["--policy", "stop,"], "contains an empty name"),
    ],
)
def test_bad_input_is_refused(run, capsys, options, message) -> None:
    assert main(["benchmark", str(run), "--robot", "vlnce", *options]) == 2
    error = capsys.readouterr().err
    assert message in error and "Traceback" not in error


def test_vlnpe_10_has_ten_scenes_of_two_kinds_three_of_them_trained_in() -> None:
    known = SETS["vlnpe-10"]
    buildings = parse_builtin(known.scene, 0)
    assert len(buildings) == 10 and {b.kind for b in buildings} == {"apartment", "house"}
    names = [building.name for building in buildings]
    seen = choose_seen(known.splits, names, known.train_scenes)
    quotas = plan_quotas(known.splits, names, seen)
    assert seen == names[:3]
    assert {tuple(quota) for quota in quotas.values()} == {("train", "val_seen"), ("val_unseen",)}
    assert all(quota["val_unseen"] == 12 for name, quota in quotas.items() if name not in seen)


def test_the_digest_holds_what_is_asked_and_nothing_else(run) -> None:
    (episode,) = read_episodes(run / "episodes" / "val_seen.json.gz")
    same = replace(episode, extra={"note": 1})
    path = episode.reference_path_world_m + 1e-9
    assert episodes_digest([episode]) == episodes_digest([same])
    assert episodes_digest([episode]) == episodes_digest(
        [replace(episode, reference_path_world_m=path)]
    )
    moved = episode.reference_path_world_m + np.array([0.02, 0.0, 0.0])
    for other in (
        replace(episode, reference_path_world_m=moved),
        replace(episode, instruction="Stop."),
        replace(episode, scene_id="other"),
    ):
        assert episodes_digest([other]) != episodes_digest([episode])
        retold = other.instruction != episode.instruction
        assert (paths_digest([other]) == paths_digest([episode])) == retold
    both = [episode, replace(episode, episode_id="other")]
    assert episodes_digest(both) == episodes_digest(both[::-1])
