"""LeRobot's evaluation of our environment, against `vlnpe evaluate` on the same episodes."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
import torch
from lerobot.processor import PolicyProcessorPipeline
from lerobot.scripts.lerobot_eval import rollout

from tests.collectors.test_replay import make_episode
from tests.pipeline.commands.test_evaluate import evaluated, served
from tests.support.lerobot_data import load, write_unit
from tests.support.rollouts import make_rollout
from tests.support.runs.work import InlineWorkers
from tests.support.scenes.rooms import write_two_rooms
from vlnpe.evaluation.lerobot.config import VlnpeEnv
from vlnpe.evaluation.lerobot.env import MOST_STEPS, LeRobotEnv
from vlnpe.formats.core.errors import InputError
from vlnpe.formats.lerobot import assemble_dataset
from vlnpe.formats.rendered.table import build_frame_table
from vlnpe.formats.vlnce.files import write_episodes
from vlnpe.rendering.camera.rollout_frames import RolloutFrames
from vlnpe.rendering.registry import make_renderer

pytestmark = pytest.mark.chain
CAMERA = "ego:96x64"
STEP_M = 0.12
# An instruction tells the scripted policy how many steps to walk; a stop counts within 3 m.
EPISODES = {"far": 36, "early": 4, "near": 0}
REACHED = {"far": True, "early": False, "near": True}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder with a scene, three episodes, and one that starts in the table."""
    run = tmp_path_factory.mktemp("lerobot-eval") / "run"
    bundle = write_two_rooms(run / "scenes" / "two_rooms")
    across = make_episode(bundle, (1.0, 2.0), (7.0, 2.0))
    near = make_episode(bundle, (5.0, 2.0), (6.6, 2.6))
    table = replace(near, start_position_world_m=np.array([0.9, 3.3, 0.0]))
    starts = {"far": across, "early": across, "near": near}
    episodes = [
        replace(starts[name], episode_id=name, trajectory_id=name, instruction=str(steps))
        for name, steps in EPISODES.items()
    ]
    (run / "episodes").mkdir()
    write_episodes(run / "episodes" / "val.json.gz", episodes)
    blocked = replace(table, episode_id="table", instruction="1")
    write_episodes(run / "table.json.gz", [blocked])
    return run


def config(run: Path, **options: Any) -> VlnpeEnv:
    given = {"episodes": run / "episodes" / "val.json.gz", "scenes": run / "scenes"}
    return VlnpeEnv(**{**given, "camera": CAMERA, **options})


class Script(torch.nn.Module):
    """Walks as many steps as the instruction says, and stands."""

    def reset(self) -> None:
        self.count = 0

    def select_action(self, observation: dict[str, Any]) -> torch.Tensor:
        assert observation["observation.images.rgb"].shape[1:] == (3, 64, 96)
        assert observation["observation.state"].shape[1:] == (13,)
        self.count += 1
        walks = [self.count <= int(text) for text in observation["task"]]
        return torch.tensor([[STEP_M * walk, 0.0, 0.0] for walk in walks])


# The same for `vlnpe evaluate`; it stops at the second action without motion.
SERVED = f"""
from vlnpe.evaluation.server import serve

class Policy:
    version = "script"
    def reset(self, episode):
        self.left = int(episode["instruction"])
    def act(self, observation):
        self.left -= 1
        if self.left < -1:
            return 0
        return [{STEP_M / 0.25} if self.left >= 0 else 0.0, 0.0, 0.0]

serve(Policy, port=0)
"""


def successes(vector: Any, seeds: list[int]) -> list[bool]:
    """Success of the scripted policy, as LeRobot counts it."""
    pipes = [PolicyProcessorPipeline(steps=[]) for _ in range(2)]
    plain: Any = [lambda observation: observation, lambda action: action]
    done = rollout(vector, Script(), *pipes, *plain, seeds=seeds)  # type: ignore[arg-type]
    return done["success"].any(dim=1).tolist()


@pytest.fixture(scope="module")
def ours(run: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bool]:
    """Success of each episode by `vlnpe evaluate` with the scripted policy."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vlnpe.pipeline.execution.settings.Workers", InlineWorkers)
        out = tmp_path_factory.mktemp("ours")
        with served(SERVED) as address:
            options = ("--policy", address, "--actions", "velocity", "--camera", CAMERA)
            results = evaluated(run, *options, "--out", str(out))
    return {e["episode"]: bool(e["metrics"]["success"]) for e in results["episodes"]}


@pytest.mark.parametrize(
    ("batch", "asynchronous"), [(1, False), (2, False), (2, True)], ids=["one", "two", "processes"]
)
def test_success_is_that_of_vlnpe_evaluate(run, ours, batch: int, asynchronous: bool) -> None:
    assert ours == REACHED
    (vector,) = config(run).create_envs(batch, asynchronous)["vlnpe"].values()
    names = list(EPISODES)
    try:
        for first in range(0, 3, batch):
            seeds = list(range(3000 + first, 3000 + first + batch))
            asked = [names[seed % 3] for seed in seeds]
            assert successes(vector, seeds) == [REACHED[name] for name in asked]
    finally:
        vector.close()


def test_observations_are_the_datas_bit_for_bit(run: Path) -> None:
    (vector,) = config(run).create_envs(1)["vlnpe"].values()
    env = vector.envs[0].unwrapped  # type: ignore[attr-defined]
    assert isinstance(env, LeRobotEnv)
    seen, info = env.reset(seed=0)
    assert info == {"is_success": False, "episode": "train/two_rooms/far"}
    assert env.task_description == "36" and env.observation_space.contains(seen)
    shown, over = [seen], False
    turn = np.array([0.02, 0.0, 0.3])  # past 180°, where the quaternion's sign could jump
    while not over:
        move = turn if len(shown) < 16 else np.zeros(3)
        seen, _, over, cut, info = env.step(move.astype(np.float32))
        assert not cut and np.array_equal(env.render(), seen["pixels"]["rgb"])
        shown.append(seen)
    assert info["end_reason"] == "stopped_far" and info["is_success"] is False
    inner = env._env
    assert inner is not None and inner.rollout is not None
    walked, robot = inner.rollout, inner.world.robot
    samples = walked.frame_samples(4)[: len(shown) - 1]
    renderer = make_renderer(inner.world.bundle)
    frames = RolloutFrames.plan(renderer, walked, env._view, samples, robot)
    arrays = {
        "sample_index": samples,
        "camera_position_world_m": np.zeros((len(samples), 3)),
        "camera_quat_wxyz": np.tile([1.0, 0, 0, 0], (len(samples), 1)),
    }
    state = build_frame_table(walked, arrays, 4).columns["observation.state"]
    assert state[-1, 3] < 0  # it did turn past 180°
    for k, (rgb, _) in enumerate(frames.render(renderer)):
        np.testing.assert_array_equal(shown[k]["agent_pos"], state[k])
        np.testing.assert_array_equal(shown[k]["pixels"]["rgb"], rgb)
    vector.close()


def test_an_episode_that_starts_in_an_obstacle_fails(run: Path) -> None:
    (vector,) = config(run, episodes=run / "table.json.gz").create_envs(1)["vlnpe"].values()
    assert successes(vector, [0]) == [False]
    vector.close()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"episodes": None}, "--env.episodes and --env.scenes"),
        ({"scenes": Path("nowhere")}, "nowhere/two_rooms: no such scene"),
        ({"fps": 10}, "--env.fps 10; valid: 4"),
        ({"camera": "chase"}, "--env.camera chase; valid: ego"),
        ({"robot": "vlnce"}, "speed"),
        ({"robot": "robby"}, "robby"),
    ],
)
def test_what_cannot_be_is_said(run: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        config(run, **options).create_envs(1)


def command(name: str, cwd: Path, options: dict[str, object]) -> str:
    """Run a command of LeRobot without network; return what it printed."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith("HF_")}
    done = subprocess.run(
        [
            str(Path(sys.executable).with_name(name)),
            *(f"--{key}={value}" for key, value in options.items()),
        ],
        cwd=cwd,
        env={**clean, "HF_HOME": str(cwd / "hf"), "HF_HUB_OFFLINE": "1", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def act(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An ACT policy that `lerobot-train` made of robots that stand, and so stops at once."""
    folder = tmp_path_factory.mktemp("act")
    walk = make_rollout(4.0)
    still = {
        name: np.tile(getattr(walk, name)[:1], (len(walk.time_s), 1))
        for name in ("position_world_m", "quat_wxyz")
    }
    units = [write_unit(folder, replace(walk, **still), number) for number in range(2)]
    assemble_dataset(units, folder / "set", provenance={}, licence="mit", title="Still")
    features = {
        "observation.images.rgb": {"type": "VISUAL", "shape": [3, 64, 96]},
        "observation.state": {"type": "STATE", "shape": [13]},
    }
    sizes = {"dim_model": 32, "n_heads": 2, "dim_feedforward": 32, "n_encoder_layers": 1}
    policy = {
        **{"type": "act", "device": "cpu", "push_to_hub": "false", "chunk_size": 8},
        **{"n_action_steps": 8, "pretrained_backbone_weights": "null", **sizes},
        "input_features": json.dumps(features),
        "output_features": json.dumps({"action": {"type": "ACTION", "shape": [3]}}),
    }
    options = {
        **{"dataset.repo_id": "vlnpe/still", "dataset.root": folder / "set"},
        **{"dataset.video_backend": "pyav", "batch_size": 2, "steps": 3, "num_workers": 0},
        **{f"policy.{key}": value for key, value in policy.items()},
        "output_dir": folder / "out",
    }
    command("lerobot-train", folder, options)
    return folder / "out" / "checkpoints" / "last" / "pretrained_model"


@pytest.mark.slow
@pytest.mark.parametrize("batch", [1, 2])
def test_lerobot_eval_runs_an_act_policy_with_videos(run, act, tmp_path, batch: int) -> None:
    options = {
        "policy.path": act,
        "env.type": "vlnpe",
        "env.discover_packages_path": "vlnpe.evaluation.lerobot",
        "env.episodes": run / "episodes" / "val.json.gz",
        "env.scenes": run / "scenes",
        "env.camera": CAMERA,
        "eval.n_episodes": 3,
        "eval.batch_size": batch,
        "seed": 0,
        "output_dir": tmp_path / "out",
    }
    command("lerobot-eval", tmp_path, options)
    info = json.loads((tmp_path / "out" / "eval_info.json").read_text())
    # It stops after two actions: within 3 m of the goal only where it starts there.
    assert info["per_task"][0]["metrics"]["successes"] == [False, False, True]
    assert info["overall"]["pc_success"] == pytest.approx(100 / 3)
    videos = sorted((tmp_path / "out" / "videos").rglob("*.mp4"))
    assert len(videos) == -(-3 // batch) * batch  # it also films what it does not count
    for video in videos:
        with av.open(str(video)) as opened:
            sizes = [(frame.width, frame.height) for frame in opened.decode(video=0)]
            assert sizes == [(96, 64)] * 2
    if batch == 1:
        return
    # LeRobot records the episodes; their actions lead `vlnpe evaluate` to the same success.
    options |= {"eval.recording": "true", "eval.n_episodes": 2, "output_dir": tmp_path / "again"}
    command("lerobot-eval", tmp_path, options)
    roots = [path.parents[1] for path in (tmp_path / "again").rglob("info.json")]
    assert len(roots) == 2
    for root in roots:
        recorded = load(root, video_backend="pyav")
        assert np.abs(recorded[0]["action"]).max() < 0.03 and len(recorded) == 2
        assert recorded[0]["agent_pos"].shape == (13,)
    assert MOST_STEPS == 501
