"""Training of gaits: a tiny run really learns, stops, goes on and exports what it learned."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rsl_rl", reason="extra `train` is not installed")

import torch
from tensordict import TensorDict

from vlnpe.collectors.locomotion import GaitPolicy, train
from vlnpe.collectors.locomotion.commands import command_bounds, sample_commands
from vlnpe.collectors.locomotion.export import actor_to_onnx
from vlnpe.collectors.locomotion.gaits import GAITS
from vlnpe.collectors.locomotion.mirror import mirror_joints, mirror_observation, mirrored
from vlnpe.collectors.locomotion.policy import _session
from vlnpe.collectors.locomotion.terrain import Terrain, noise_terrain, rough_terrain
from vlnpe.collectors.locomotion.training_config import TrainingConfig
from vlnpe.collectors.locomotion.training_env import GaitEnv
from vlnpe.collectors.robots import get_robot

TINY = TrainingConfig(envs=8, steps=6)


@pytest.fixture
def robot():
    return get_robot("aliengo")


def test_tiny_training_writes_resumes_and_exports(robot, tmp_path: Path, monkeypatch):
    monkeypatch.setattr(train, "PHASES", {"aliengo": ((TINY, 2),)})
    train.train(robot, tmp_path, seed=0, threads=1)
    first = (tmp_path / "aliengo.onnx").read_bytes()
    assert GaitPolicy.load(robot, tmp_path).card.training["iterations"] == 2
    monkeypatch.setattr(
        train, "PHASES", {"aliengo": ((TINY, 2), (TrainingConfig(8, 6, "rough"), 1))}
    )
    train.train(robot, tmp_path, seed=0, threads=1)
    card = GaitPolicy.load(robot, tmp_path).card
    assert card.training["iterations"] == 3
    assert card.training["samples"] == 3 * 8 * 6
    assert (tmp_path / "aliengo.onnx").read_bytes() != first
    with (tmp_path / "curve.csv").open() as file:
        assert [int(row["iteration"]) for row in csv.DictReader(file)] == [2, 3]
    # Nothing is left to do: a third call changes nothing.
    before = (tmp_path / "checkpoint.pt").stat().st_mtime_ns
    train.train(robot, tmp_path, seed=0, threads=1)
    assert (tmp_path / "checkpoint.pt").stat().st_mtime_ns == before


def test_exported_network_is_the_trained_one():
    from rsl_rl.models import MLPModel

    observation = TensorDict({"policy": torch.randn(64, 50)}, batch_size=[64])
    actor = MLPModel(
        observation, {"actor": ["policy"]}, "actor", 12, (32, 32), "elu", obs_normalization=True
    )
    actor.train()
    actor.update_normalization(TensorDict({"policy": 3 * torch.randn(500, 50) + 2}, [500]))
    actor.eval()
    expected = actor(observation).detach().numpy()
    (given,) = _session(actor_to_onnx(actor)).run(
        None, {"observation": observation["policy"].numpy()}
    )
    np.testing.assert_allclose(given, expected, atol=2e-5)


def test_mirroring_twice_is_nothing(robot):
    for order, signs in (mirror_observation(robot), mirror_joints(robot)):
        vector = np.arange(1.0, len(order) + 1)
        once = vector[order] * signs
        assert not np.array_equal(once, vector)
        np.testing.assert_array_equal(once[order] * signs, vector)


def test_the_stepping_reference_is_symmetric(robot):
    gait = GAITS["aliengo"]
    order, signs = mirror_joints(robot)
    command = np.array([[0.7, 0.2, -0.5]])
    moving = np.array([True])
    for phase in (0.0, 0.13, 0.4, 0.77):
        here = gait.reference(np.array([phase]), moving, command)
        there = gait.reference(np.array([phase + 0.5]), moving, command * (1, -1, -1))
        np.testing.assert_allclose(there, here[:, order] * signs, atol=1e-12)


def test_mirrored_batches_are_appended(robot):
    env = GaitEnv(robot, TINY, Terrain(), np.random.default_rng(0), threads=1)
    observation = env.get_observations()
    both, actions = mirrored(env, observation, torch.ones(8, 12))
    assert both is not None and actions is not None
    assert both["policy"].shape == (16, observation["policy"].shape[1])
    assert torch.equal(both["policy"][:8], observation["policy"])
    assert actions[8:, 0].tolist() == [-1.0] * 8  # abduction changes sides


@pytest.mark.parametrize("terrain", ["flat", "rough"])
def test_environment_rewards_standing_over_falling(robot, terrain: str):
    rng = np.random.default_rng(1)
    ground = Terrain() if terrain == "flat" else rough_terrain(rng)
    env = GaitEnv(robot, TINY, ground, rng, threads=1)
    fell = 0
    for _ in range(40):
        # Legs pulled up: it must drop below its threshold and start anew.
        up = torch.tensor([[0.0, 4.0, -4.0] * 4]).repeat(8, 1)
        observation, reward, done, extras = env.step(up)
        fell += int((done & ~extras["time_outs"]).sum())
        assert torch.isfinite(reward).all()
        assert torch.isfinite(observation["policy"]).all()
    assert fell >= 8


def test_randomised_bodies_differ(robot):
    env = GaitEnv(robot, TINY, Terrain(), np.random.default_rng(2), threads=1)
    masses = env.batch.expand("body_mass").sum(axis=1)
    low, high = TINY.mass_scale
    assert len(np.unique(masses.round(6))) == TINY.envs
    assert np.all((masses > low * robot.mass_kg) & (masses < high * robot.mass_kg))


def test_commands_stay_in_their_limits(robot):
    commands = sample_commands(np.random.default_rng(3), 2000, command_bounds(robot.command_limits))
    np.testing.assert_array_equal(robot.command_limits.clip(commands), commands)
    assert 0.08 < np.mean(~commands.any(axis=1)) < 0.2  # standing is practised too


def test_terrain_lookup_matches_the_compiled_height_field(robot):
    import mujoco

    ground = noise_terrain(np.random.default_rng(4), 0.06, size_m=4.0)
    assert ground.height_m is not None
    spec = mujoco.MjSpec()
    ground.add_to(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    hit = np.zeros(1, dtype=np.int32)
    for x, y in np.random.default_rng(5).uniform(-1.8, 1.8, (40, 2)):
        down = mujoco.mj_ray(model, data, [x, y, 1.0], [0, 0, -1.0], None, 1, -1, hit)
        assert 1.0 - down == pytest.approx(float(ground.at(np.array([x, y]))), abs=0.02)
    assert ground.height_m.max() == pytest.approx(0.06)
