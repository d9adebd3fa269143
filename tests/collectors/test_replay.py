"""Replay in physics: every outcome, and proof that nothing but the servos moves the robot."""

import math
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import ArrayLike

from tests.support.cart import CartGait, make_cart
from tests.support.scenes.rooms import write_two_rooms
from vlnpe.collectors.controllers import FlashConfig, SpeedConfig
from vlnpe.collectors.physics import ObstacleGate
from vlnpe.collectors.physics.outcome import OutcomeConfig
from vlnpe.collectors.replay.replay import ReplayConfig, replay_episode, replay_in
from vlnpe.collectors.replay.world import World, open_world
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.errors import UnknownNameError
from vlnpe.formats.core.rollout import Action, EndReason, Rollout
from vlnpe.formats.scene.bundle import Obstacles, SceneBundle, load_bundle, save_bundle
from vlnpe.wayfinding.planning import plan_path

pytestmark = pytest.mark.chain

PHYSICAL = ("path", "speed")


@pytest.fixture(scope="module")
def world(two_rooms: SceneBundle) -> World:
    return open_world(two_rooms, 0, make_cart(), CartGait())


def make_episode(
    bundle: SceneBundle, start=(1.0, 1.0), goal=(7.0, 3.0), yaw=0.0, path=None, name="e0"
) -> Episode:
    if path is None:
        path = plan_path(bundle.freemap(0), start, goal, 0.3)
        assert path is not None
    path = np.asarray(path, dtype=float)
    return Episode(
        episode_id=name,
        trajectory_id=name,
        scene_id="two_rooms",
        split="train",
        level=0,
        start_position_world_m=np.array([*start, 0.0]),
        start_yaw_rad=yaw,
        goal_position_world_m=np.array([*goal, 0.0]),
        reference_path_world_m=path,
        geodesic_distance_m=float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()),
    )


def with_box(root: Path, center, half) -> SceneBundle:
    """The two rooms with one more obstacle, of which the planning map knows nothing."""
    bundle = write_two_rooms(root)
    boxes = bundle.obstacles(0)
    boxes = Obstacles(np.vstack([boxes.center_m, center]), np.vstack([boxes.half_m, half]))
    save_bundle(bundle, bundle.visual(), [(bundle.floor(0), boxes, bundle.freemap(0))])
    return load_bundle(root)


def same(a: Rollout, b: Rollout) -> bool:
    pairs = [(getattr(a, f.name), getattr(b, f.name)) for f in fields(Rollout)]
    return all(
        np.array_equal(x, y) if isinstance(x, np.ndarray) else x == y
        for x, y in pairs
        if not isinstance(x, Episode)
    )


@pytest.mark.parametrize("controller", PHYSICAL)
@pytest.mark.parametrize(
    ("start", "goal", "yaw"),
    [((1, 1), (7, 3), 0.0), ((1, 1), (7, 3), 3.1), ((7, 3), (0.8, 1.2), 1.6)],
)
def test_it_walks_through_the_doorway(world: World, controller, start, goal, yaw) -> None:
    episode = make_episode(world.bundle, start, goal, yaw)
    r = replay_in(world, episode, ReplayConfig(controller=controller))
    assert r.end_reason is EndReason.SUCCESS
    assert r.metrics.success
    assert r.metrics.navigation_error_euclidean_m <= 0.25
    assert r.metrics.spl > 0.9
    assert r.metrics.ndtw > 0.9
    crossing = r.position_world_m[np.argmin(np.abs(r.position_world_m[:, 0] - 4.0)), 1]
    assert 1.5 < crossing < 2.5
    assert not [e for e in r.events if e.kind == "contact"]


@pytest.mark.parametrize("controller", PHYSICAL)
def test_the_record_is_whole(world: World, controller: str) -> None:
    r = replay_in(world, make_episode(world.bundle), ReplayConfig(controller=controller))
    count = len(r.time_s)
    assert np.allclose(np.diff(r.time_s), 0.01)
    for f in fields(Rollout):
        value = getattr(r, f.name)
        if isinstance(value, np.ndarray):
            assert len(value) == count, f.name
            assert value.dtype == bool or np.isfinite(value).all(), f.name
    assert np.allclose(np.linalg.norm(r.quat_wxyz, axis=1), 1.0)
    assert r.joint_position_rad.shape == (count, len(r.joint_names))
    assert r.foot_contact.shape == (count, len(r.foot_names))
    assert np.abs(r.floor_z_m).max() < 1e-6
    # At the start and at the end it stands: gravity is all the IMU feels, the wheels carry it.
    for k in (0, -1):
        assert r.imu[k, :3] == pytest.approx([0, 0, 9.81], abs=0.5)
        assert np.abs(r.linear_velocity_base_m_s[k]).max() < 0.05
        assert r.foot_contact[k, :2].all()
    # The frame of the STOP action is at rest too, at the default frame rate.
    last = r.frame_samples(4)[-1]
    assert np.abs(r.linear_velocity_base_m_s[last]).max() < 0.05
    assert (r.command[last] == 0).all()


def test_velocities_are_the_derivative_of_the_path(world: World) -> None:
    """The robot is never repositioned: each step of its path is the integral of its velocity."""
    r = replay_in(world, make_episode(world.bundle), ReplayConfig())
    step = np.diff(r.position_world_m[:, :2], axis=0)
    assert np.linalg.norm(step, axis=1).max() < 0.012
    yaw = np.arctan2(2 * r.quat_wxyz[:, 0] * r.quat_wxyz[:, 3], 1 - 2 * r.quat_wxyz[:, 3] ** 2)
    forward = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    speed = np.einsum("ti,ti->t", step, forward[:-1]) / 0.01
    assert np.abs(speed - r.linear_velocity_base_m_s[1:, 0]).max() < 0.15
    turn = np.abs(np.diff(np.unwrap(yaw)) / 0.01 - r.angular_velocity_base_rad_s[1:, 2])
    assert turn.max() < 0.3


@pytest.mark.parametrize("controller", PHYSICAL)
def test_the_servos_alone_reproduce_the_rollout(world: World, controller: str) -> None:
    """From the same spawn, the logged servo targets reproduce the rollout bit for bit."""
    config = ReplayConfig(controller=controller, spawn_joint_noise_rad=0.0)
    episode = make_episode(world.bundle)
    r = replay_in(world, episode, config)
    assert isinstance(world.gait, CartGait)
    targets = world.gait.targets
    assert not world.data.xfrc_applied.any()
    assert not world.data.qfrc_applied.any()
    x, y, _ = episode.start_position_world_m
    world.spawn(type(world.pose)(x, y, episode.start_yaw_rad))
    base = []
    for target in targets:
        world.data.ctrl[world.handles.actuators] = target
        for _ in range(2):
            mujoco.mj_step(world.model, world.data, nstep=2)
            base.append(world.data.qpos[:7].copy())
    settled = round(float(r.facts["settle_s"]) * 100)  # type: ignore[arg-type]
    replayed = np.array(base)[settled - 1 : settled - 1 + len(r.time_s)]
    assert np.array_equal(replayed[:, :3], r.position_world_m[: len(replayed)])
    assert np.array_equal(replayed[:, 3:], r.quat_wxyz[: len(replayed)])
    assert len(replayed) >= len(r.time_s) - 1


@pytest.mark.parametrize("controller", ["path", "speed", "flash"])
def test_the_same_seed_gives_the_same_bits(world: World, controller: str) -> None:
    episode = make_episode(world.bundle)
    first = replay_in(world, episode, ReplayConfig(controller=controller, seed=4))
    replay_in(world, make_episode(world.bundle, (7, 3), (1, 1)), ReplayConfig())
    assert same(first, replay_in(world, episode, ReplayConfig(controller=controller, seed=4)))


def test_another_seed_gives_another_rollout(world: World) -> None:
    episode = make_episode(world.bundle)
    a, b = (replay_in(world, episode, ReplayConfig(seed=seed)) for seed in (0, 1))
    assert not np.array_equal(a.joint_position_rad[:50], b.joint_position_rad[:50])
    assert a.end_reason is b.end_reason is EndReason.SUCCESS


def test_discrete_actions_fill_the_time_one_after_the_other(world: World) -> None:
    jump = SpeedConfig(ramp_m_s2=math.inf, ramp_rad_s2=math.inf)
    r = replay_in(world, make_episode(world.bundle), ReplayConfig(controller="speed", speed=jump))
    assert r.actions[0].start_sample == 0
    assert r.actions[-1].stop_sample == len(r.time_s)
    assert all(a.stop_sample == b.start_sample for a, b in pairwise(r.actions))
    assert {a.stop_sample - a.start_sample for a in r.actions[:-1]} == {25}
    assert [a.action for a in r.actions].count(Action.STOP) == 1
    assert r.actions[-1].action is Action.STOP
    for span in r.actions:
        inside = slice(span.start_sample, span.stop_sample)
        vx, _, yaw = r.command[inside].T
        assert (vx > 0).all() == (span.action is Action.FORWARD)
        assert (np.sign(yaw) == {Action.LEFT: 1, Action.RIGHT: -1}.get(span.action, 0)).all()


def test_commands_are_ramped(world: World) -> None:
    r = replay_in(world, make_episode(world.bundle), ReplayConfig(controller="speed"))
    driven = r.command[: r.actions[-1].start_sample]
    steps = np.abs(np.diff(driven, axis=0)).max(axis=0)
    assert steps[0] == pytest.approx(SpeedConfig().ramp_m_s2 / 100)
    assert steps[2] == pytest.approx(SpeedConfig().ramp_rad_s2 / 100)


def test_closed_loop_actions_reach_their_displacement(world: World) -> None:
    speed = SpeedConfig(end_on_displacement=True)
    r = replay_in(world, make_episode(world.bundle), ReplayConfig(controller="speed", speed=speed))
    assert r.end_reason is EndReason.SUCCESS
    for span in r.actions[:-1]:
        length = span.stop_sample - span.start_sample
        assert length < 100 * speed.servo.longest_s
        start, stop = r.position_world_m[[span.start_sample, span.stop_sample], :2]
        step = 0.25 if span.action is Action.FORWARD else 0.0
        assert np.linalg.norm(stop - start) == pytest.approx(step, abs=0.03)


def test_flash_jumps_and_nothing_else_does(world: World) -> None:
    episode = make_episode(world.bundle)
    r = replay_in(world, episode, ReplayConfig(controller="flash"))
    assert r.end_reason is EndReason.SUCCESS
    moves = np.linalg.norm(np.diff(r.position_world_m[:, :2], axis=0), axis=1)
    assert sorted({round(float(m), 2) for m in moves}) == [0.0, 0.25]
    assert len(r.time_s) == 25 * len(r.actions)
    assert r.actions[-1].action is Action.STOP


@pytest.mark.parametrize("refuse", [False, True])
def test_flash_flags_or_refuses_a_target_in_collision(tmp_path: Path, refuse: bool) -> None:
    bundle = with_box(tmp_path, (4.0, 2.0, 0.2), (0.1, 0.5, 0.2))
    world = open_world(bundle, 0, make_cart(), CartGait())
    config = ReplayConfig(controller="flash", flash=FlashConfig(refuse_collisions=refuse))
    r = replay_in(world, make_episode(bundle), config)
    assert any(e.kind == "collision_target" for e in r.events)
    assert r.end_reason is (EndReason.STUCK if refuse else EndReason.SUCCESS)
    assert not refuse or r.position_world_m[-1, 0] < 4.0


@pytest.mark.parametrize("controller", PHYSICAL)
def test_a_blocked_doorway_leaves_it_stuck(tmp_path: Path, controller: str) -> None:
    bundle = with_box(tmp_path, (4.0, 2.0, 0.2), (0.1, 0.5, 0.2))
    world = open_world(bundle, 0, make_cart(), CartGait())
    r = replay_in(world, make_episode(bundle), ReplayConfig(controller=controller))
    assert r.end_reason is EndReason.STUCK
    assert r.metrics.stuck
    assert not r.metrics.success
    assert r.position_world_m[:, 0].max() < 4.0
    parts = {e.detail for e in r.events if e.kind == "contact"}
    assert parts <= {"base", "left_wheel", "right_wheel"}
    assert "base" in parts
    # 2,500 physics steps at least are needed to call it stuck.
    assert r.metrics.duration_s > 12.5


def test_an_unknown_box_beside_the_way_is_felt_or_passed(tmp_path: Path) -> None:
    bundle = with_box(tmp_path, (2.6, 1.72, 0.2), (0.05, 0.05, 0.2))
    world = open_world(bundle, 0, make_cart(), CartGait())
    r = replay_in(world, make_episode(bundle), ReplayConfig())
    assert r.end_reason in (EndReason.SUCCESS, EndReason.STUCK, EndReason.TIMEOUT)
    assert (r.end_reason is EndReason.SUCCESS) or any(e.kind == "contact" for e in r.events)


def test_a_top_heavy_cart_falls(two_rooms: SceneBundle) -> None:
    world = open_world(two_rooms, 0, make_cart(mast_kg=15.0, mast_m=2.0), CartGait(brisk=2.0))
    # Its centre of mass is more than 1 m up between casters 0.34 m apart; it starts with a jerk.
    jump = SpeedConfig(ramp_m_s2=math.inf, ramp_rad_s2=math.inf)
    r = replay_in(world, make_episode(two_rooms), ReplayConfig(controller="speed", speed=jump))
    assert r.end_reason is EndReason.FALL
    assert r.metrics.fall
    fall = [e for e in r.events if e.kind == "fall"]
    assert len(fall) == 1
    assert "roll" in fall[0].detail or "pitch" in fall[0].detail or "mass" in fall[0].detail
    # A second more is recorded, to be looked at, and it did not get up.
    assert r.time_s[-1] - fall[0].time_s == pytest.approx(1.0, abs=0.03)
    assert r.metrics.down and not r.metrics.recovered


class Jolted(CartGait):
    """Drives and stops gently, and 1.5 s later darts off for a moment."""

    def reset(self, seed: int | None = None) -> None:
        super().reset(seed)
        self._driven, self._still = False, 0

    def act(self, data: mujoco.MjData, command: ArrayLike) -> np.ndarray:
        still = not np.any(command)
        self._driven |= not still
        self._still = self._still + 1 if still and self._driven else 0
        jolt = 75 < self._still < 100
        self._step[:] = 0.8 if jolt else 0.02
        return super().act(data, (1.0, 0.0, 0.0) if jolt else command)


@pytest.mark.parametrize("high", [False, True])
def test_what_happens_to_a_robot_at_rest_still_counts(two_rooms: SceneBundle, high: bool) -> None:
    """One falls, the other one comes to rest elsewhere; nobody would know at the first rest."""
    cart = make_cart(mast_kg=15.0, mast_m=2.0) if high else make_cart()
    world = open_world(two_rooms, 0, cart, Jolted())
    slow = SpeedConfig(ramp_m_s2=0.5)
    r = replay_in(world, make_episode(two_rooms), ReplayConfig(controller="speed", speed=slow))
    at = {event.kind: event.time_s for event in r.events}
    at_rest, last = r.position_world_m[[round(100 * at["stop"]) + 100, -1]]
    assert np.linalg.norm(last - at_rest) > 0.1
    if high:
        assert r.end_reason is EndReason.FALL
        assert at["fall"] - at["stop"] > 1.5
    else:
        assert at["rest"] - at["stop"] > 1.5
        assert r.time_s[-1] - at["rest"] == pytest.approx(0.25, abs=0.02)


def test_walking_off_the_floor_is_a_fall(tmp_path: Path) -> None:
    bundle = write_two_rooms(tmp_path)
    floor = bundle.floor(0)
    rows, columns = np.indices(floor.grid.shape)
    x = floor.grid.center_of(np.stack([rows, columns], -1))[..., 0]
    floor = replace(floor, covered=floor.covered & (x < 3.0))
    save_bundle(bundle, bundle.visual(), [(floor, bundle.obstacles(0), bundle.freemap(0))])
    world = open_world(load_bundle(tmp_path), 0, make_cart(), CartGait())
    r = replay_in(world, make_episode(bundle), ReplayConfig())
    assert r.end_reason is EndReason.FALL
    assert "no floor" in next(e.detail for e in r.events if e.kind == "fall")


@pytest.mark.parametrize("controller", PHYSICAL)
def test_too_slow_is_a_timeout(world: World, controller: str) -> None:
    config = ReplayConfig(controller=controller, outcome=OutcomeConfig(timeout_factor=0.4))
    r = replay_in(world, make_episode(world.bundle), config)
    assert r.end_reason is EndReason.TIMEOUT
    assert not r.metrics.success


def test_too_many_actions_are_a_timeout(world: World) -> None:
    config = ReplayConfig(controller="speed", outcome=OutcomeConfig(timeout_actions=10))
    r = replay_in(world, make_episode(world.bundle), config)
    assert r.end_reason is EndReason.TIMEOUT
    assert r.metrics.duration_s == pytest.approx(2.5, abs=0.3)


@pytest.mark.parametrize(
    ("x_m", "end"), [(5.0, EndReason.STOPPED_NEAR), (3.0, EndReason.STOPPED_FAR)]
)
def test_a_stop_elsewhere_is_near_where_vln_calls_it_a_success(
    world: World, x_m: float, end: EndReason
) -> None:
    episode = make_episode(world.bundle, goal=(7.0, 3.0), path=[[1, 1, 0], [3, 2, 0], [x_m, 2, 0]])
    r = replay_in(world, episode, ReplayConfig(controller="speed"))
    assert r.end_reason is end
    assert r.metrics.success is (end is EndReason.STOPPED_NEAR)
    assert r.metrics.navigation_error_euclidean_m > 1.5


@pytest.mark.parametrize("controller", ["path", "speed", "flash"])
def test_a_start_inside_furniture_is_reported(world: World, controller: str) -> None:
    episode = make_episode(world.bundle, (7.0, 0.6), (1, 1), path=[[7, 0.6, 0], [1, 1, 0]])
    r = replay_in(world, episode, ReplayConfig(controller=controller))
    assert r.end_reason is EndReason.COLLISION_START
    assert len(r.time_s) == 1
    assert r.metrics.trajectory_length_m == 0.0


def test_exploding_physics_ends_as_diverged(two_rooms: SceneBundle) -> None:
    cart = make_cart()
    mad = tuple(replace(j, kd=-400.0, torque_nm=1e7) for j in cart.joints)
    world = open_world(two_rooms, 0, replace(cart, joints=mad), CartGait())
    r = replay_in(world, make_episode(two_rooms), ReplayConfig())
    assert r.end_reason is EndReason.DIVERGED
    assert not r.metrics.success
    assert set(r.facts["diverged_state"]) == {"qpos", "qvel", "ctrl"}  # type: ignore[arg-type]
    assert np.isfinite(r.position_world_m).all()


@pytest.mark.parametrize(
    ("config", "valid"),
    [
        (ReplayConfig(controller="jetpack"), "flash, path, speed"),
        (ReplayConfig(robot="roomba"), "aliengo"),
    ],
)
def test_unknown_names_list_the_valid_ones(two_rooms: SceneBundle, config, valid: str) -> None:
    with pytest.raises(UnknownNameError, match=valid):
        replay_episode(two_rooms, make_episode(two_rooms), config)


@pytest.mark.parametrize("controller", PHYSICAL)
def test_aliengo_walks_to_the_other_room(two_rooms: SceneBundle, controller: str) -> None:
    r = replay_episode(
        two_rooms, make_episode(two_rooms, yaw=1.0), ReplayConfig(controller=controller)
    )
    assert r.end_reason is EndReason.SUCCESS
    assert r.metrics.ndtw > 0.85
    limits = [35.3, 35.3, 44.4] * 4
    assert (np.abs(r.joint_torque_nm) <= np.array(limits) + 1e-6).all()
    # It walks: every foot is lifted and set down again and again, and carries weight in between.
    steps = np.diff(r.foot_contact.astype(int), axis=0)
    assert ((steps == 1).sum(axis=0) > 5).all()
    assert (r.foot_contact.mean(axis=0) > 0.3).all()
    height = r.position_world_m[:, 2] - r.floor_z_m
    assert 0.28 < height.min() < height.max() < 0.42
    assert np.abs(r.linear_velocity_base_m_s[-1]).max() < 0.1


@pytest.mark.parametrize("robot", [make_cart(), get_robot("aliengo")], ids=lambda r: r.name)
def test_the_obstacle_gate_changes_nothing(tmp_path: Path, robot, monkeypatch) -> None:
    """Open and shut on the way past a box it bumps into: the same bits as when always open."""
    bundle = with_box(tmp_path, (4.0, 2.0, 0.2), (0.1, 0.5, 0.2))
    world = open_world(bundle, 0, robot, CartGait() if robot.name == "cart" else None)
    seen = []
    update = ObstacleGate.update

    def watched(gate: ObstacleGate) -> None:
        update(gate)
        seen.append(gate.open_bodies)

    monkeypatch.setattr(ObstacleGate, "update", watched)
    gated = replay_in(world, make_episode(bundle), ReplayConfig())
    assert min(seen) == 0
    assert max(seen) > 0
    monkeypatch.setattr(ObstacleGate, "update", lambda gate: None)
    always = replay_in(world, make_episode(bundle), ReplayConfig())
    assert any(e.kind == "contact" for e in always.events)
    assert same(gated, always)
