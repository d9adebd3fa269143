"""The Jetbot at any scale, and its wheels: facts, driving, and episodes to the goal."""

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.collectors.test_replay import make_episode
from vlnpe.collectors.locomotion.runtime.drives import DifferentialDrive, gait_for
from vlnpe.collectors.locomotion.trials.terrain import noise_terrain
from vlnpe.collectors.replay.replay import ReplayConfig, replay_episode
from vlnpe.collectors.robots import RobotHandles, RobotSpec, apply_physics_options, get_robot
from vlnpe.formats.core.errors import InputError, UnknownNameError
from vlnpe.formats.core.rollout import EndReason
from vlnpe.formats.scene.bundle import SceneBundle

pytestmark = pytest.mark.chain

SCALES = pytest.mark.parametrize("name", ["jetbot", "jetbot@1", "jetbot@2.5"])
POLICY_STEP_S = 0.02


class Track:
    """A robot on a floor, driven by commands."""

    def __init__(self, robot: RobotSpec, add_floor=None, lift_m: float = 0.0):
        spec = robot.spec()
        apply_physics_options(spec)
        if add_floor is None:
            spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
        else:
            add_floor(spec)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.handles = RobotHandles.find(robot, self.model)
        self.gait = gait_for(robot)
        self.handles.spawn(self.data, floor_z_m=lift_m)
        self.travelled_m = self.turned_rad = 0.0

    def drive(self, command: tuple[float, float, float], seconds: float) -> None:
        data, handles = self.data, self.handles
        for _ in range(round(seconds / POLICY_STEP_S)):
            data.ctrl[handles.actuators] = self.gait.act(data, command)
            before, yaw = data.qpos[:2].copy(), self.yaw_rad
            mujoco.mj_step(self.model, data, nstep=4)
            self.travelled_m += float(np.linalg.norm(data.qpos[:2] - before))
            self.turned_rad += math.remainder(self.yaw_rad - yaw, 2 * math.pi)

    @property
    def yaw_rad(self) -> float:
        w, x, y, z = self.data.qpos[3:7]
        return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    @property
    def tilt_rad(self) -> float:
        _, x, y, _ = self.data.qpos[3:7]
        return math.acos(1 - 2 * (x * x + y * y))


@pytest.mark.parametrize(("name", "scale"), [("jetbot", 5.0), ("jetbot@1", 1.0), ("jetbot@2", 2.0)])
def test_lengths_masses_and_torques_grow_as_they_must(name: str, scale: float):
    robot, toy = get_robot(name), get_robot("jetbot@1")
    assert robot.drive is not None
    assert robot.drive.wheel_radius_m == pytest.approx(0.03 * scale)
    assert robot.drive.track_m == pytest.approx(0.1125 * scale)
    model = robot.build_model(floor=False)
    assert model.body_subtreemass[0] == pytest.approx(0.56 * scale**3)
    wheels = [model.body(f"{side}_wheel").ipos + model.body(f"{side}_wheel").pos
              for side in ("left", "right")]  # fmt: skip
    assert wheels[0][1] - wheels[1][1] == pytest.approx(0.1125 * scale)
    # Weights times lengths.
    assert robot.joints[0].torque_nm == pytest.approx(toy.joints[0].torque_nm * scale**4)
    assert robot.footprint_radius_m == pytest.approx(toy.footprint_radius_m * scale)


def test_five_is_the_default_scale_and_named_so():
    assert get_robot("jetbot@5").name == get_robot("jetbot@5.0").name == "jetbot"
    assert get_robot("jetbot@1.0").name == "jetbot@1"
    assert get_robot("jetbot@5").physics_hash() == get_robot("jetbot").physics_hash()


def test_the_toy_sees_from_its_bracket_the_large_one_from_a_mast():
    def camera_m(name: str) -> float:
        robot = get_robot(name)
        return robot.base_height_m + robot.camera.position_body_m[2]

    assert camera_m("jetbot@1") == pytest.approx(0.0875)
    assert camera_m("jetbot@2.5") == pytest.approx(0.6)
    assert camera_m("jetbot") == pytest.approx(1.2)


@pytest.mark.parametrize("name", ["jetbot@0", "jetbot@-1", "jetbot@nan", "jetbot@inf", "jetbot@x"])
def test_impossible_scales_are_refused(name: str):
    with pytest.raises(InputError, match="jetbot@"):
        get_robot(name)


def test_other_robots_have_one_size():
    with pytest.raises(UnknownNameError, match="jetbot@<scale>"):
        get_robot("aliengo@2")


@SCALES
def test_it_drives_as_commanded(name: str):
    robot = get_robot(name)
    fastest, sharpest = robot.command_limits.vx_m_s[1], robot.command_limits.yaw_rad_s[1]
    for vx, yaw in ((fastest, 0.0), (0.0, sharpest), (0.5 * fastest, -0.5 * sharpest)):
        track = Track(robot)
        track.drive((vx, 0.0, yaw), 1.0)  # up to speed
        track.travelled_m = track.turned_rad = 0.0
        track.drive((vx, 0.0, yaw), 2.0)
        assert track.travelled_m == pytest.approx(2.0 * abs(vx), abs=0.02 * fastest)
        assert track.turned_rad == pytest.approx(2.0 * yaw, abs=0.04 * sharpest)


@SCALES
def test_it_neither_tips_nor_slips_when_it_starts_and_brakes(name: str):
    robot = get_robot(name)
    track = Track(robot)
    highest = 0.0
    for vx in (1.0, -1.0, 1.0, 0.0):
        for _ in range(50):
            track.drive((vx, 0.0, 0.0), POLICY_STEP_S)
            highest = max(highest, track.tilt_rad)
    assert highest < math.radians(3.0)
    assert np.abs(track.data.qvel).max() < 0.02  # at rest


def test_commands_are_ramped_clipped_and_forgotten():
    robot = get_robot("jetbot")
    drive, data = DifferentialDrive(robot), mujoco.MjData(robot.build_model())
    first = drive.act(data, (9.0, 9.0, 0.0)).copy()
    assert robot.drive is not None
    np.testing.assert_allclose(first, robot.drive.ramp_m_s2 * POLICY_STEP_S / 0.15)
    torques = [drive.act(data, (9.0, 9.0, 0.0)) for _ in range(100)]
    np.testing.assert_allclose(torques[-1], 1.0 / 0.15)
    drive.reset()
    np.testing.assert_allclose(drive.act(data, (9.0, 0.0, 0.0)), first)


@settings(max_examples=30, deadline=None)
@given(st.floats(-2, 2), st.floats(-3, 3))
def test_wheel_speeds_are_those_of_the_turn(vx: float, yaw: float):
    robot = get_robot("jetbot")
    drive, data = DifferentialDrive(robot), mujoco.MjData(robot.build_model())
    assert robot.drive is not None
    left, right = [drive.act(data, (vx, 0.3, yaw)) for _ in range(100)][-1]
    vx, yaw = float(np.clip(vx, -0.3, 1.0)), float(np.clip(yaw, -1.5, 1.5))
    radius, track = robot.drive.wheel_radius_m, robot.drive.track_m
    assert 0.5 * (left + right) * radius == pytest.approx(vx, abs=1e-9)
    assert (right - left) * radius / track == pytest.approx(yaw, abs=1e-9)


def test_it_crosses_bumps_of_six_centimetres():
    robot = get_robot("jetbot")
    terrain = noise_terrain(np.random.default_rng(3), 0.06, size_m=16.0)
    around = np.random.default_rng(0).uniform(-0.45, 0.45, (200, 2))
    track = Track(robot, terrain.add_to, float(terrain.at(around).max()))
    track.drive((0.0, 0.0, 0.0), 0.5)
    leaned = 0.0
    for _ in range(50):
        track.drive((0.8, 0.0, 0.0), 0.1)
        leaned = max(leaned, track.tilt_rad)
    assert track.data.qpos[0] > 3.0  # of 4 m on a plane
    assert math.radians(1.0) < leaned < 0.6 * robot.fall.roll_rad


@pytest.mark.parametrize("controller", ["path", "speed"])
@SCALES
def test_it_reaches_the_other_room(two_rooms: SceneBundle, name: str, controller: str):
    episode = make_episode(two_rooms, yaw=1.0)
    rollout = replay_episode(two_rooms, episode, ReplayConfig(robot=name, controller=controller))
    assert rollout.end_reason is EndReason.SUCCESS, rollout.events
    assert not [event for event in rollout.events if event.kind == "contact"]
    assert rollout.robot == name
    # All three stand on the floor nearly all the time.
    assert rollout.foot_contact.mean() > 0.9
