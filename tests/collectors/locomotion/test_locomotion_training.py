"""Training of gaits: a tiny run really learns, stops, goes on and exports what it learned."""

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rsl_rl", reason="extra `train` is not installed")

import torch
from tensordict import TensorDict

from vlnpe.collectors.locomotion.runtime import GaitPolicy
from vlnpe.collectors.locomotion.runtime.network import Mlp, decode_layers
from vlnpe.collectors.locomotion.runtime.observation import layout
from vlnpe.collectors.locomotion.training import train
from vlnpe.collectors.locomotion.training.config import PHASES, TrainingConfig
from vlnpe.collectors.locomotion.training.derived import derived_gait
from vlnpe.collectors.locomotion.training.env import GaitEnv
from vlnpe.collectors.locomotion.training.export import encode_actor
from vlnpe.collectors.locomotion.training.gaits import GAITS
from vlnpe.collectors.locomotion.training.mirror import (
    Symmetry,
    mirror_joints,
    mirror_observation,
    mirrored,
)
from vlnpe.collectors.locomotion.training.randomize import sample_commands
from vlnpe.collectors.locomotion.training.recipes import recipe
from vlnpe.collectors.locomotion.trials import evaluate
from vlnpe.collectors.locomotion.trials.aim import command_bounds
from vlnpe.collectors.locomotion.trials.terrain import Terrain, noise_terrain, rough_terrain
from vlnpe.collectors.robots import RobotSpec, get_robot
from vlnpe.collectors.robots.folder.export import export_robot
from vlnpe.collectors.robots.parts import StepRhythm
from vlnpe.formats.core.errors import FileFormatError, InputError


def tiny(robot: RobotSpec, terrain: str = "flat") -> TrainingConfig:
    """The robot's first phase of training with eight simulations."""
    return replace(PHASES[robot.name][0][0], envs=8, steps=6, terrain=terrain)


def planned(monkeypatch, robot: RobotSpec, *phases: tuple[TrainingConfig, int]) -> None:
    """Let the robot be trained in these phases."""
    monkeypatch.setattr(train, "recipe", lambda _: replace(recipe(robot), phases=phases))


@pytest.fixture(params=["aliengo", "h1", "g1"])
def robot(request):
    return get_robot(request.param)


def test_tiny_training_writes_resumes_and_exports(robot, tmp_path: Path, monkeypatch):
    arguments = train.Arguments(robot.name, threads=1)
    planned(monkeypatch, robot, (tiny(robot), 2))
    train.train(robot, tmp_path, arguments)
    first = (tmp_path / f"{robot.name}.safetensors").read_bytes()
    assert GaitPolicy.load(robot, tmp_path).card.training["iterations"] == 2
    planned(monkeypatch, robot, (tiny(robot), 2), (tiny(robot, "rough"), 1))
    train.train(robot, tmp_path, arguments)
    card = GaitPolicy.load(robot, tmp_path).card
    assert card.training["iterations"] == 3
    assert card.training["samples"] == 3 * 8 * 6
    assert (tmp_path / f"{robot.name}.safetensors").read_bytes() != first
    with (tmp_path / "curve.csv").open() as file:
        assert [int(row["iteration"]) for row in csv.DictReader(file)] == [2, 3]
    # Nothing is left to do: a third call changes nothing.
    before = (tmp_path / "checkpoint.pt").stat().st_mtime_ns
    train.train(robot, tmp_path, arguments)
    assert (tmp_path / "checkpoint.pt").stat().st_mtime_ns == before


def trained_actor(robot: RobotSpec) -> tuple[Any, TensorDict]:
    from rsl_rl.models import MLPModel

    outputs = robot.policy_joints
    inputs = sum(width for _, width in layout(outputs))
    observation = TensorDict({"policy": torch.randn(64, inputs)}, batch_size=[64])
    actor = MLPModel(
        observation,
        {"actor": ["policy"]},
        "actor",
        outputs,
        (32, 32),
        "elu",
        obs_normalization=True,
    )
    actor.train()
    actor.update_normalization(TensorDict({"policy": 3 * torch.randn(500, inputs) + 2}, [500]))
    actor.eval()
    return actor, observation


def act(content: bytes, observation: np.ndarray) -> np.ndarray:
    network = Mlp(*decode_layers(Path("policy.safetensors"), content))
    action = np.zeros((len(observation), network.outputs), np.float32)
    network.run(observation, action)
    return action


def test_exported_network_is_the_trained_one(robot):
    actor, observation = trained_actor(robot)
    expected = actor(observation).detach().numpy()
    actions = act(encode_actor(actor), observation["policy"].numpy())
    np.testing.assert_allclose(actions, expected, atol=2e-5)


def test_exported_with_its_mirror_image_it_is_symmetric(robot):
    actor, observation = trained_actor(robot)
    seen, seen_signs = mirror_observation(robot)
    done, done_signs = mirror_joints(robot)
    observed = observation["policy"].numpy()
    other = observed[:, seen] * np.asarray(seen_signs, dtype=np.float32)
    content = encode_actor(actor, Symmetry.of(robot))
    actions, opposite = act(content, observed), act(content, other)
    np.testing.assert_allclose(opposite[:, done] * done_signs, actions, atol=2e-5)
    # It is the mean of the plain network here and its mirror image.
    plain = encode_actor(actor)
    mean = 0.5 * (act(plain, observed) + act(plain, other)[:, done] * done_signs)
    np.testing.assert_allclose(actions, mean, atol=2e-5)


def test_the_command_of_make_train_gait(tmp_path: Path, monkeypatch, capsys):
    planned(monkeypatch, get_robot("h1"), (tiny(get_robot("h1")), 1))
    monkeypatch.setattr("sys.argv", ["train", "h1", "--out", str(tmp_path), "--threads", "1"])
    train.main()
    assert (tmp_path / "h1.safetensors").is_file()
    monkeypatch.setattr(train, "recipe", recipe)
    monkeypatch.setattr("sys.argv", ["train", "jetbot", "--out", str(tmp_path)])
    with pytest.raises(SystemExit, match=r"jetbot has 0 joints for a policy.*valid for training"):
        train.main()


def test_mirroring_twice_is_nothing(robot):
    for order, signs in (mirror_observation(robot), mirror_joints(robot)):
        vector = np.arange(1.0, len(order) + 1)
        once = vector[order] * signs
        assert not np.array_equal(once, vector)
        np.testing.assert_array_equal(once[order] * signs, vector)


def test_the_stepping_reference_is_symmetric(robot):
    gait = GAITS[robot.name]
    order, signs = mirror_joints(robot)
    count = robot.policy_joints
    command = np.array([[0.7, 0.2, -0.5]])
    moving = np.array([True])
    for phase in (0.0, 0.13, 0.4, 0.77):
        here = gait.reference(np.array([phase]), moving, command)
        opposite = gait.reference(np.array([phase + 0.5]), moving, command * (1, -1, -1))
        np.testing.assert_allclose(opposite[:, :count], here[:, order] * signs, atol=1e-12)


def test_mirrored_batches_are_appended(robot):
    env = GaitEnv(robot, tiny(robot), Terrain(), np.random.default_rng(0), threads=1)
    observation = env.get_observations()
    both, actions = mirrored(env, observation, torch.ones(8, robot.policy_joints))
    assert both is not None and actions is not None
    assert both["policy"].shape == (16, observation["policy"].shape[1])
    assert torch.equal(both["policy"][:8], observation["policy"])
    # The first joint, abduction or hip yaw, changes sides; a G1's hip pitch does not.
    sign = 1.0 if "pitch" in robot.joint_names[0] else -1.0
    assert actions[8:, 0].tolist() == [sign] * 8


def test_the_critic_knows_the_next_command_before_it_comes(robot):
    config = replace(tiny(robot), command_s=(0.1, 0.3))
    env = GaitEnv(robot, config, Terrain(), np.random.default_rng(0), threads=1)
    future = slice(-16, -9)  # present command, next command times nearness, nearness
    came = 0
    before = env.get_observations()["privileged"].numpy()[:, future]
    for _ in range(40):
        _, _, done, _ = env.step(torch.zeros(8, robot.policy_joints))
        now = env.get_observations()["privileged"].numpy()[:, future]
        changed = ~done.numpy() & (now[:, :3] != before[:, :3]).any(axis=1)
        np.testing.assert_allclose(
            now[changed, :3], before[changed, 3:6] / before[changed, 6:], atol=1e-4
        )
        came += int(changed.sum())
        before = now
    assert came > 10


@pytest.mark.parametrize("terrain", ["flat", "rough"])
def test_environment_rewards_standing_over_falling(robot, terrain: str):
    rng = np.random.default_rng(1)
    ground = Terrain() if terrain == "flat" else rough_terrain(rng)
    env = GaitEnv(robot, tiny(robot), ground, rng, threads=1)
    fell = 0
    # Legs pulled up: it must drop below its threshold and restart.
    pulls = {"thigh": 4.0, "calf": -4.0, "pitch": -8.0, "knee": 8.0}
    parts = [name.split("_")[-2] for name in robot.policy_joint_names]
    up = torch.tensor([[pulls.get(part, 0.0) for part in parts]]).repeat(8, 1)
    for _ in range(60):
        observation, reward, done, extras = env.step(up)
        fell += int((done & ~extras["time_outs"]).sum())
        assert torch.isfinite(reward).all()
        assert torch.isfinite(observation["policy"]).all()
    assert fell >= 8


def test_randomised_bodies_differ(robot):
    env = GaitEnv(robot, tiny(robot), Terrain(), np.random.default_rng(2), threads=1)
    masses = env.batch.expand("body_mass").sum(axis=1)
    low, high = tiny(robot).mass_scale
    assert len(np.unique(masses.round(6))) == 8
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


@pytest.mark.parametrize("name", ["aliengo", "h1", "g1"])
def test_a_gait_that_is_derived_from_the_model_is_close_to_the_one_made_by_hand(name: str):
    robot, made = get_robot(name), GAITS[name]
    rhythm = StepRhythm(
        frequency_hz=made.frequency_hz, foot_offsets=made.foot_offsets, swing_height_m=0.08
    )
    gait = derived_gait(replace(robot, rhythm=rhythm))
    legs = slice(robot.policy_joints)
    for motion in ("swing_rad", "forward_rad", "left_rad", "turn_rad"):
        ours = np.array(getattr(gait, motion) or np.zeros(1))[..., legs]
        hand = np.array(getattr(made, motion) or np.zeros(1))[..., legs]
        assert np.abs(ours - hand).max() < 0.32, motion
        assert np.sum(ours * hand) >= 0.7 * np.sum(hand**2), motion
    np.testing.assert_allclose(gait.foot_xy_m, made.foot_xy_m, atol=0.11)


@pytest.fixture
def own_dog(tmp_path: Path) -> Path:
    """The Aliengo as a folder without a gait, with a rhythm, under other joint names."""
    dog = tmp_path / "dog"
    export_robot(get_robot("aliengo"), dog, None)
    for path in (dog / "robot.toml", dog / "model.xml"):
        text = path.read_text()
        for leg, other in {"FL": "a", "FR": "b", "RL": "c", "RR": "d"}.items():
            text = text.replace(f"{leg}_", f"{other}_")
        path.write_text(text)
    facts = dog / "robot.toml"
    facts.write_text(facts.read_text() + RHYTHM)
    return dog


RHYTHM = "\n[gait]\nfrequency_hz = 2.0\nfoot_offsets = [0, 0.5, 0.5, 0]\n"


def test_a_robot_of_ones_own_is_trained_and_installed_in_its_folder(
    own_dog: Path, monkeypatch, capsys
):
    robot = get_robot(str(own_dog))
    with pytest.raises(FileFormatError, match=r"policy\.json.*make train-gait"):
        GaitPolicy.load(robot)
    phase = replace(recipe(robot).phases[0][0], envs=8, steps=6)
    planned(monkeypatch, robot, (phase, 1))
    out = own_dog.parent / "out"
    monkeypatch.setattr(evaluate, "evaluation_table", lambda policy, scale: {})
    monkeypatch.setattr(evaluate, "calibrated", lambda policy: policy)
    arguments = ["train", str(own_dog), "--out", str(out), "--threads", "1", "--publish"]
    monkeypatch.setattr("sys.argv", arguments)
    train.main()
    trained = GaitPolicy.load(get_robot(str(own_dog)))
    assert trained.card.robot == "dog" and trained.card.gait.frequency_hz == 2.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (RHYTHM, "", r"does not say how it steps; valid: a table \[gait\]"),
        ("[0, 0.5, 0.5, 0]", "[0, 0.5]", r"foot_offsets has 2 phases; valid: .*4 feet"),
        ("[0, 0.5, 0.5, 0]", "[0, 0.5, 0.5, 1]", r"gait.foot_offsets .*valid: a phase from 0"),
        ("frequency_hz = 2.0", "frequency_hz = 0", r"gait.frequency_hz is 0"),
        ("frequency_hz", "speed_hz", r"frequency_hz is missing"),
    ],
)
def test_what_is_wrong_with_a_rhythm_is_said(
    own_dog: Path, old: str, new: str, message: str, monkeypatch
):
    facts = own_dog / "robot.toml"
    assert old in facts.read_text()
    facts.write_text(facts.read_text().replace(old, new))
    monkeypatch.setattr("sys.argv", ["train", str(own_dog)])
    with pytest.raises(SystemExit, match=message):
        train.main()


def test_a_robot_without_symmetry_is_refused(own_dog: Path):
    model = own_dog / "model.xml"
    text = model.read_text()
    model.write_text(text.replace('name="a_hip" pos="0.2399', 'name="a_hip" pos="0.2799', 1))
    with pytest.raises(InputError, match=r"a_hip_joint has no mirror image"):
        mirror_joints(get_robot(str(own_dog)))
