"""Gaits on stairs: the ground, the footing that follows it, flights, and training on them."""

import csv
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np
import pytest

from vlnpe.collectors.locomotion.runtime.card import PolicyMismatchError, load_card, save_card
from vlnpe.collectors.locomotion.runtime.footholds import _height
from vlnpe.collectors.locomotion.runtime.footing import POWERS, Footing
from vlnpe.collectors.locomotion.runtime.network import encode_layers
from vlnpe.collectors.locomotion.runtime.observation import layout
from vlnpe.collectors.locomotion.runtime.policy import (
    GaitPolicy,
    climbs,
    policy_files,
    stairs_files,
)
from vlnpe.collectors.locomotion.runtime.sensors import Simulation
from vlnpe.collectors.locomotion.runtime.step import GaitStep
from vlnpe.collectors.locomotion.training.derived import Stance
from vlnpe.collectors.locomotion.training.export import install
from vlnpe.collectors.locomotion.training.stairs.reach import footing
from vlnpe.collectors.locomotion.trials.evaluate import climbed
from vlnpe.collectors.locomotion.trials.flights import climb
from vlnpe.collectors.locomotion.trials.terrain import Terrain, stairs_terrain
from vlnpe.collectors.locomotion.trials.trial import Conditions, Trial, levelled
from vlnpe.collectors.robots import RobotHandles, get_robot
from vlnpe.formats.core.errors import FileFormatError, InputError, VlnpeError

ALIENGO = get_robot("aliengo")


@pytest.fixture(scope="module")
def footed() -> GaitPolicy:
    """The installed gait, without what it learned on stairs."""
    installed = GaitPolicy.load(ALIENGO)
    return GaitPolicy(ALIENGO, installed.card, installed.network)


@pytest.fixture(scope="module")
def plain(footed: GaitPolicy) -> GaitPolicy:
    return footed.changed(ALIENGO, replace(footed.card, footing=None))


def test_the_installed_gait_has_the_footing_of_its_legs(footed: GaitPolicy):
    assert footed.card.footing == footing(ALIENGO, footed.card.gait)
    assert {name: climbs(get_robot(name)) for name in ("aliengo", "h1", "jetbot", "vlnce")} == {
        "aliengo": True, "h1": False, "jetbot": False, "vlnce": True,
    }  # fmt: skip


def ray_heights(terrain: Terrain, xy: np.ndarray) -> np.ndarray:
    """What a ray from above hits in the compiled model."""
    spec = mujoco.MjSpec()
    terrain.add_to(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    down = np.array([0.0, 0.0, -1.0])
    hit = np.zeros(1, np.int32)
    return np.array(
        [
            9.0 - mujoco.mj_ray(model, data, np.array([x, y, 9.0]), down, None, 1, -1, hit)
            for x, y in xy
        ]
    )


def test_stairs_are_boxes_of_the_heights_that_are_looked_up():
    terrain = stairs_terrain((0.08, 0.17), (0.25, 0.31), steps=6, hills=2)
    lane = terrain.lanes[1]
    # Every tread of a flight, 3 cm and more from its edges.
    tread = np.arange(-1, 6)
    x = lane.foot_m[1] + (tread + 0.5) * lane.going_m
    on = np.column_stack([x, np.full(7, lane.y_m)])
    np.testing.assert_allclose(terrain.at(on), 0.17 * (tread + 1), atol=1e-9)
    rng = np.random.default_rng(0)
    xy = rng.uniform(-0.5 * terrain.size_m, 0.5 * terrain.size_m, (400, 2))
    low, high = (terrain.at(xy + shift) for shift in ((-0.03, -0.03), (0.03, 0.03)))
    flat = low == high
    assert flat.mean() > 0.6
    np.testing.assert_allclose(ray_heights(terrain, xy[flat]), terrain.at(xy)[flat], atol=1e-9)


def test_pitch_counts_against_the_slope_of_stairs():
    terrain = stairs_terrain((0.17,), (0.29,), steps=8, hills=1)
    middle = terrain.lanes[0].foot_m[0] + 3.5 * 0.29
    slope = np.arctan2(0.17, 0.29)
    pose = np.array([[middle, 0.0, 0.0], [middle, 0.0, np.pi]])
    # Nose up along the flight, and nose down along it in the other direction.
    gravity = np.array([[-np.sin(slope), 0, -np.cos(slope)], [np.sin(slope), 0, -np.cos(slope)]])
    np.testing.assert_allclose(levelled(gravity, ALIENGO, terrain, pose)[:, 0], 0.0, atol=0.05)
    np.testing.assert_array_equal(levelled(gravity, ALIENGO, Terrain(), pose), gravity)
    # A humanoid stays upright on stairs, too.
    np.testing.assert_array_equal(levelled(gravity, get_robot("h1"), terrain, pose), gravity)


@pytest.mark.parametrize(
    ("ahead", "above"), [(0.12, 0.05), (-0.2, -0.03), (0.0, 0.2), (-0.1, 0.15)]
)
def test_joint_offsets_put_feet_where_they_shall_be(
    footed: GaitPolicy, ahead: float, above: float
) -> None:
    plan = footed.card.footing
    assert plan is not None
    reach = np.array(plan.reach_rad).reshape(4, len(POWERS), 12)
    stance = Stance(ALIENGO)
    data, joints = stance.data, stance.handles.joint_qpos
    terms = np.prod(np.array([ahead, above]) ** np.array(POWERS), axis=1)
    data.qpos[joints] += np.einsum("k,fkj->j", terms, reach)
    mujoco.mj_kinematics(stance.model, data)
    soles = data.geom_xpos[stance.handles.sole_geoms[:, 0]]
    soles = soles - (0.0, 0.0, stance.handles.sole_radius_m[0, 0])
    moved = soles - [leg.place_m for leg in stance.legs]
    np.testing.assert_allclose(moved, np.tile((ahead, 0.0, above), (4, 1)), atol=0.006)


def learned_on_stairs(footed: GaitPolicy, folder: Path, **changes: Any) -> GaitPolicy:
    """The gait with a network that adds 0.1 wherever it acts; its files are in the folder."""
    seen = layout(ALIENGO.policy_joints, footed.card.past, footed.card.footing)
    width = sum(count for _, count in seen)
    content = encode_layers([np.zeros((12, width))], [np.full(12, 0.1)])
    base = {"base": footed.card.network_sha256}
    card = replace(footed.card, observation=seen, training=base, **changes)
    install(content, card, stairs_files(ALIENGO, folder))
    return footed.with_stairs(folder)


def test_on_level_ground_a_footing_changes_nothing(
    plain: GaitPolicy, footed: GaitPolicy, tmp_path: Path
):
    rng, robots = np.random.default_rng(1), 3
    terrain = stairs_terrain((0.15,), (0.28,), steps=6, hills=1)
    before = np.array([terrain.lanes[0].foot_m[0] - 2.4, 0.0]) + np.zeros((robots, 2))
    learned = learned_on_stairs(footed, tmp_path)
    trials = [
        Trial(
            policy, Conditions(terrain, friction=0.8), before, np.zeros(robots),
            np.random.default_rng(2),
        )
        for policy in (plain, footed, learned)
    ]  # fmt: skip
    for _ in range(100):
        command = rng.uniform(-0.5, 0.5, (robots, 3))
        for trial in trials:
            trial.step(command)
        np.testing.assert_array_equal(trials[0].qpos, trials[1].qpos)
        np.testing.assert_array_equal(trials[0].qpos, trials[2].qpos)


def test_a_gait_learned_on_stairs_acts_where_the_ground_is_uneven(
    footed: GaitPolicy, tmp_path: Path
):
    terrain = stairs_terrain((0.04, 0.05), (0.28, 0.28), steps=1, hills=1)
    policy = learned_on_stairs(footed, tmp_path)
    # Before a step of 4 cm, before one of 5 cm, and out of its sight.
    foot = terrain.lanes[1].foot_m[0]
    xy = np.array([(foot - 0.5, lane.y_m) for lane in terrain.lanes] + [(foot - 0.7, 1.5)])
    model = ALIENGO.build_model()
    handles = RobotHandles.find(ALIENGO, model)
    qpos = np.tile(model.qpos0, (3, 1))
    qpos[:, handles.root_qpos : handles.root_qpos + 2] = xy
    state = np.zeros((3, model.nv)), np.zeros((3, model.nsensordata)), np.zeros((3, model.nu))
    outputs = []
    for each in (footed, policy):
        step = each.steps(Simulation(qpos, *state), model, handles, None, terrain)
        outputs.append(np.zeros((3, 12), np.float32))
        each.run(step, np.zeros((3, 3)), outputs[-1])
    np.testing.assert_array_equal(outputs[1][[0, 2]], outputs[0][[0, 2]])
    np.testing.assert_allclose(outputs[1][1] - outputs[0][1], 0.1, atol=1e-5)


def test_what_was_learned_on_stairs_belongs_to_one_gait(footed: GaitPolicy, tmp_path: Path):
    for path in policy_files(ALIENGO):
        shutil.copy(path, tmp_path / path.name)
    assert GaitPolicy.load(ALIENGO, tmp_path).stairs is None
    learned_on_stairs(footed, tmp_path)
    assert GaitPolicy.load(ALIENGO, tmp_path).stairs is not None
    card = load_card(stairs_files(ALIENGO, tmp_path)[1])
    for changed, reason in (
        (replace(card, observation=footed.card.observation), "takes .* numbers"),
        (replace(card, footing=None), "observation layout"),
        (replace(card, action_clip=1.0), "its action_clip"),
        (replace(card, training={"base": "0"}), "on top of another gait"),
    ):
        save_card(changed, stairs_files(ALIENGO, tmp_path)[1])
        with pytest.raises(PolicyMismatchError, match=f"aliengo-stairs.*{reason}"):
            GaitPolicy.load(ALIENGO, tmp_path)


def test_feet_are_put_flat_on_treads(footed: GaitPolicy):
    """A robot is moved along a flight by hand; its feet's next places lie on treads."""
    terrain = stairs_terrain((0.15,), (0.28,), steps=10, hills=1)
    model = ALIENGO.build_model()
    handles, plan = RobotHandles.find(ALIENGO, model), footed.card.footing
    data = mujoco.MjData(model)
    handles.spawn(data)
    qpos, qvel = data.qpos[None].copy(), np.zeros((1, model.nv))
    step = GaitStep(
        qpos, qvel, handles, footed.card.gait, ALIENGO.command_limits,
        past=footed.card.past, footing=plan, ground=terrain, sees_ground=False,
    )  # fmt: skip
    chosen = []
    for k in range(200):
        qpos[0, 0] = terrain.lanes[0].foot_m[0] + 0.4 + 0.008 * k
        step.observe(np.array([[0.4, 0.0, 0.0]]))
        if step.clock.moving[0] and k > 20:
            chosen.append(step.footholds.feet[0, :, 1].copy())
    heights = np.array(chosen)
    assert len(heights) > 150
    # Each is the height of a tread, and all of the way up are used.
    treads = heights / 0.15
    np.testing.assert_allclose(treads, treads.round(), atol=1e-6)
    assert set(range(3, 8)) <= set(treads.round().astype(int).ravel().tolist())
    assert abs(np.arctan(step.footholds.slope[0]) - np.arctan2(0.15, 0.28)) < 0.06


@pytest.mark.slow
@pytest.mark.parametrize("hard", (False, True))
def test_the_installed_gait_climbs_stairs_of_houses(hard: bool):
    row = climb(GaitPolicy.load(ALIENGO), 0.17, 8, np.random.default_rng(3), hard=hard)
    assert min(row["up_arrived"], row["down_arrived"]) >= 0.8


@pytest.mark.chain
def test_a_footing_alone_climbs_where_the_plain_gait_does_not(
    plain: GaitPolicy, footed: GaitPolicy
):
    with_it = climb(footed, 0.10, 6, np.random.default_rng(11))
    without = climb(plain, 0.10, 6, np.random.default_rng(11))
    assert min(with_it["up_arrived"], with_it["down_arrived"]) >= 5 / 6
    assert with_it["up_falls"] + with_it["down_falls"] <= 1
    assert without["down_arrived"] <= 0.5
    text = climbed({"flights_10cm": with_it, "paths_flat": {}})
    assert text.startswith(" 10cm  up") and "6 flights each" in text
    assert len(text.splitlines()) == 1


def test_a_card_keeps_its_footing_and_refuses_a_broken_one(footed: GaitPolicy, tmp_path: Path):
    path = tmp_path / "aliengo.json"
    save_card(footed.card, path)
    card = load_card(path)
    assert card.footing == footed.card.footing
    card.check(ALIENGO, path)
    values: dict[str, Any] = json.loads(path.read_text())
    for change, error in (
        ({"reach_rad": values["footing"]["reach_rad"][:-1]}, PolicyMismatchError),
        ({"scan_x_m": [0.0]}, PolicyMismatchError),
        ({"clearance_m": float("nan")}, FileFormatError),
        ({"pace": 1}, FileFormatError),
    ):
        path.write_text(json.dumps(values | {"footing": values["footing"] | change}))
        with pytest.raises(error, match=r"footing|pace"):
            load_card(path).check(ALIENGO, path)


def on_two_legs(name: str) -> GaitPolicy:
    """The installed gait of a robot whose trunk stays upright, with a footing."""
    robot = get_robot(name)
    gait = GaitPolicy.load(robot)
    return gait.changed(robot, replace(gait.card, footing=footing(robot, gait.card.gait)))


@pytest.mark.parametrize("name", ("h1", "g1"))
def test_two_legs_with_a_footing_bend_under_an_upright_trunk(name: str):
    policy = on_two_legs(name)
    plan, robot = policy.card.footing, policy.robot
    assert plan is not None and plan.lean == 0.0 and not robot.leans
    foot, ankle_m = robot.build_model(floor=False), plan.leg_m[0]
    assert 0.5 < ankle_m / float(foot.body(robot.root_body).pos[2]) < 0.85
    terms = [0.1**i * 0.15**j for i, j in POWERS]
    bend = np.array(terms) @ np.array(plan.reach_rad)[: len(POWERS)]
    joints = dict(zip(robot.joint_names, bend, strict=True))
    # A sole that is put ahead and up is level: hip, knee and ankle cancel.
    turned = [
        value for key, value in joints.items() if re.match(r"left_(hip_pitch|knee|ankle)", key)
    ]
    assert abs(sum(turned)) < 0.06 and max(turned) > 0.4
    # The knee that bears the robot gives way: it has to aim at less of a bend.
    weight = np.array(terms) @ np.array(plan.bear_rad)[: len(POWERS)]
    assert weight[robot.joint_names.index("left_knee_joint")] < -0.1


@pytest.mark.chain
def test_a_humanoid_comes_down_steps_on_its_footing():
    policy = on_two_legs("h1")
    plain = policy.changed(policy.robot, replace(policy.card, footing=None))
    rows = [climb(gait, 0.10, 8, np.random.default_rng(77)) for gait in (policy, plain)]
    assert rows[0]["down_arrived"] >= 0.6 > 0.5 >= rows[1]["down_arrived"]


@pytest.mark.parametrize("sole_m", (0.0, 0.11))
def test_a_foot_beyond_the_scan_stands_on_its_first_or_last_row(footed: GaitPolicy, sole_m: float):
    assert footed.card.footing is not None
    tables = replace(footed.card.footing, sole_m=sole_m).tables(footed.card.gait)
    level = np.arange(27.0)
    rows, height = round(sole_m / 0.04), cast(Any, _height).py_func
    assert [height(tables, level, x) for x in (-0.44, -0.52, -0.9)] == [rows] * 3
    assert [height(tables, level, x) for x in (0.6, 0.9)] == [26.0] * 2


def test_a_scan_turns_with_the_robot():
    terrain = stairs_terrain((0.1,), (0.3,), steps=5, hills=1)
    plan = Footing((-0.4, 0.0, 0.4), (-0.1, 0.1), 0.36, 0.1, 0.07, (0.4, 0.1, 0.5), ())
    foot = terrain.lanes[0].foot_m[0] - 0.2
    up, back = plan.scan(terrain, np.array([[foot, 0.0, 0.0], [foot, 0.0, np.pi]]))
    np.testing.assert_allclose(up, [[0.0, 0.0, 0.1]] * 2)
    np.testing.assert_allclose(back, [[0.1, 0.0, 0.0]] * 2)


@pytest.fixture
def training():
    pytest.importorskip("rsl_rl", reason="extra `train` is not installed")
    from vlnpe.collectors.locomotion.training import train

    return train


def stairs_phase(training: Any, **changes: int) -> Any:
    level = training.recipe(ALIENGO).phases
    return replace(training.stairs_phases(level, ALIENGO.leans)[0][0], **changes)


@pytest.mark.chain
def test_training_on_stairs_adds_to_the_gait_goes_on_and_exports(
    training: Any, plain: GaitPolicy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    phase = stairs_phase(training, envs=12, steps=6)
    monkeypatch.setattr(training, "stairs_phases", lambda *_: ((phase, 2),))
    arguments = training.Arguments("aliengo", terrain="stairs", threads=1)
    training.train(ALIENGO, tmp_path, arguments)
    policy = plain.changed(ALIENGO, replace(plain.card, footing=footing(ALIENGO, plain.card.gait)))
    learned = policy.with_stairs(tmp_path).stairs
    assert learned is not None and learned.card.training["samples"] == 2 * 12 * 6
    # Two steps of learning from zero add little to the gait that it was trained on.
    seen = np.random.default_rng(0).normal(0, 0.3, (20, learned.network.inputs))
    added = learned.infer(seen)
    assert 0 < np.abs(added).max() < 0.5
    # And it is symmetric, though the training is not: a scan's columns change sides.
    from vlnpe.collectors.locomotion.training.mirror import Symmetry

    mirror = Symmetry.of(ALIENGO, learned.card.past, learned.card.footing)
    image = seen[:, mirror.observation_order.numpy()] * mirror.observation_signs.numpy()
    answer = learned.infer(image)[:, mirror.joint_order.numpy()] * mirror.joint_signs.numpy()
    np.testing.assert_allclose(answer, added, atol=1e-4)
    monkeypatch.setattr(training, "stairs_phases", lambda *_: ((phase, 3),))
    # It goes on with half of the robots in each of two processes.
    training.train(ALIENGO, tmp_path, replace(arguments, workers=2))
    with (tmp_path / "curve.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["iteration"]) for row in rows] == [2, 3]
    assert sum(name.startswith("climbed_") for name in rows[0]) == training.LANES
    assert rows[0].keys() == rows[1].keys() and float(rows[1]["reward"]) > 0.0
    with pytest.raises(InputError, match=r"--workers 5; valid: a divisor of 12"):
        training.train(ALIENGO, tmp_path / "other", replace(arguments, workers=5))
    assert not (tmp_path / "other").exists()


def test_a_worker_that_dies_is_named_and_none_outlives_the_training(training: Any):
    from vlnpe.collectors.locomotion.training.stairs.base import Base

    phase = stairs_phase(training, envs=4, steps=2)
    arguments = training.Arguments("aliengo", terrain="stairs", threads=1, workers=2)
    rng = np.random.default_rng(0)
    robots = training._environment(ALIENGO, phase, rng, Base.load(ALIENGO), arguments)
    processes = robots._processes
    robots.get_observations()
    processes[1].kill()
    with pytest.raises(VlnpeError, match=r"worker 1 of 2 died; .* last checkpoint"):
        robots.get_observations()
    robots.close()
    assert not any(process.is_alive() for process in processes)


def test_what_cannot_be_trained_leaves_nothing(training: Any, tmp_path: Path):
    for robot, terrain, start, reason in (
        ("jetbot", "level", None, "walks on 2 or 4 feet"),
        ("aliengo", "level", tmp_path, "starts from nothing"),
    ):
        out = tmp_path / "out"
        with pytest.raises(InputError, match=reason):
            training.run(training.Arguments(robot, out=out, terrain=terrain, start=start))
        assert not out.exists()


def test_robots_get_the_stairs_that_they_can_climb(training: Any):
    from vlnpe.collectors.locomotion.training.stairs.course import Stairs

    terrain = stairs_terrain((0.05, 0.1, 0.15), (0.3, 0.3, 0.3), steps=5)
    stairs = Stairs(terrain, 40, np.random.default_rng(5))
    robots = np.arange(40)
    stairs.lane[:] = np.where(stairs.lane < 0, -1, 1)
    on = np.flatnonzero(stairs.lane == 1)
    xy, yaw = stairs.place(robots)
    pose = np.column_stack([xy, yaw])
    assert not stairs.left(pose).any()
    np.testing.assert_allclose(terrain.at(xy[stairs.lane < 0]), 0.0)
    target = np.zeros((40, 3))
    for _ in range(400):
        # All go as commanded, straight along their lane.
        pose[on, 2] = np.where(np.cos(pose[on, 2]) > 0, 0.0, np.pi)
        stairs.steer(target, pose)
        pose[on, 0] += 0.02 * target[on, 0] * np.cos(pose[on, 2])
    fell = np.zeros(40, dtype=bool)
    fell[on[:5]] = True
    stairs.finish(robots, pose, fell)
    assert (stairs.lane[on[:5]] == 0).all()
    assert (stairs.lane[on[5:]] == 2).mean() > 0.8
    assert (stairs.lane[:2] == -1).all()
    climbed, walks = stairs.take_walks()[1]
    assert walks >= 30 and 0.5 * walks < climbed < walks
    assert not stairs.take_walks().any()
