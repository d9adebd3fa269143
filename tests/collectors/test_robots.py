"""The robots as compiled: masses, limits, symmetry, camera, poses, and being found by name."""

import re

import mujoco
import numpy as np
import pytest

from vlnpe.collectors.robots import (
    ROBOTS,
    TIMESTEP_S,
    RobotHandles,
    RobotSpec,
    apply_physics_options,
    get_robot,
)
from vlnpe.collectors.robots.shapes import COLLISION_GROUP, VISUAL_GROUP
from vlnpe.formats.core.errors import InputError, UnknownNameError

# Published facts, written down here once more: link → kg, joint's part → Nm, → rad (left side).
PUBLISHED_MASS = {
    "aliengo": {
        "total": 24.64,
        "base": 13.04,
        "FL_hip": 1.993,
        "RR_thigh": 0.639,
        "FR_calf": 0.267,
    },
    "h1": {
        "total": 51.4,
        "pelvis": 5.39,
        "torso": 17.79,
        "left_hip_yaw": 2.244,
        "right_hip_roll": 2.232,
        "left_hip_pitch": 4.152,
        "right_knee": 1.721,
        "left_ankle": 0.446,
    },
    "g1": {
        "total": 33.34,
        "pelvis": 3.813,
        "torso": 7.82,
        "left_hip_pitch": 1.35,
        "right_hip_roll": 1.52,
        "left_hip_yaw": 1.702,
        "right_knee": 1.932,
        "left_ankle_pitch": 0.074,
        "right_ankle_roll": 0.608,
    },
    # Five times a toy of 0.56 kg weighs 125 times as much.
    "jetbot": {"total": 70.0, "right_wheel": 4.375},
    "vlnce": {"total": 1.0},
}
PUBLISHED_TORQUE = {
    "aliengo": {"hip": 35.3, "thigh": 35.3, "calf": 44.4},
    "h1": {
        **{f"hip_{axis}": 200 for axis in ("yaw", "roll", "pitch")},
        **{"knee": 300, "ankle": 40, "torso": 200},
        **{"shoulder_pitch": 40, "shoulder_roll": 40, "shoulder_yaw": 18, "elbow": 18},
    },
    "g1": {
        **{"hip_pitch": 88, "hip_roll": 139, "hip_yaw": 88, "knee": 139},
        **{"ankle_pitch": 35, "ankle_roll": 35},
        **{"waist_yaw": 88, "waist_roll": 50, "waist_pitch": 50},
        **{f"shoulder_{axis}": 25 for axis in ("pitch", "roll", "yaw")},
        **{"elbow": 25, "wrist_roll": 25, "wrist_pitch": 5, "wrist_yaw": 5},
    },
    "jetbot": {"wheel": 50},
}
# `velocity` of the limits in Unitree's published URDF files [rad/s].
PUBLISHED_SPEED = {
    "aliengo": {"hip": 20, "thigh": 20, "calf": 15.9},
    "h1": {
        **{f"hip_{axis}": 23 for axis in ("yaw", "roll", "pitch")},
        **{"knee": 14, "ankle": 9, "torso": 23},
        **{"shoulder_pitch": 9, "shoulder_roll": 9, "shoulder_yaw": 20, "elbow": 20},
    },
    "g1": {
        **{"hip_pitch": 32, "hip_roll": 20, "hip_yaw": 32, "knee": 20},
        **{"ankle_pitch": 30, "ankle_roll": 30},
        **{"waist_yaw": 32, "waist_roll": 30, "waist_pitch": 30},
        **{f"shoulder_{axis}": 37 for axis in ("pitch", "roll", "yaw")},
        **{"elbow": 37, "wrist_roll": 37, "wrist_pitch": 22, "wrist_yaw": 22},
    },
}
PUBLISHED_RANGE = {
    "aliengo": {"hip": (-1.22, 1.22), "calf": (-2.775, -0.646)},
    "h1": {
        "hip_yaw": (-0.43, 0.43),
        "hip_roll": (-0.43, 0.43),
        "hip_pitch": (-1.57, 1.57),
        "knee": (-0.26, 2.05),
        "ankle": (-0.87, 0.52),
    },
    "g1": {
        "hip_pitch": (-2.53, 2.88),
        "hip_roll": (-0.52, 2.97),
        "knee": (-0.09, 2.88),
        "ankle_pitch": (-0.87, 0.52),
        "ankle_roll": (-0.26, 0.26),
    },
    "jetbot": {},
}
# Above the floor [m]: base frame, highest part, camera.
BASE_HEIGHT = {
    "aliengo": (0.35, 0.37),
    "h1": (0.97, 1.05),
    "g1": (0.77, 0.79),
    "jetbot": (0.149, 0.151),
    "vlnce": (0.74, 0.76),
}
TOP_HEIGHT = {
    "aliengo": (0.45, 0.60),
    "h1": (1.72, 1.83),
    "g1": (1.27, 1.35),
    "jetbot": (1.2, 1.3),
    "vlnce": (1.25, 1.30),
}
CAMERA_HEIGHT = {
    "aliengo": (0.40, 0.50),
    "h1": (1.55, 1.67),
    "g1": (1.22, 1.28),
    "jetbot": (1.19, 1.21),
    "vlnce": (1.249, 1.251),
}

all_robots = pytest.mark.parametrize("robot", list(ROBOTS.values()), ids=list(ROBOTS))


SIDE = re.compile(r"^(FL|FR|RL|RR|left|right)_")


def part_of(joint: str) -> str:
    """`left_hip_yaw_joint` → `hip_yaw`: what both sides of a robot share."""
    return SIDE.sub("", joint).removesuffix("_joint")


def mirrored_name(name: str) -> str:
    """The name of a body on the other side; the same for what is in the middle."""
    swap = {"FL": "FR", "FR": "FL", "RL": "RR", "RR": "RL", "left": "right", "right": "left"}
    return SIDE.sub(lambda match: f"{swap[match[1]]}_", name)


def standing(robot: RobotSpec) -> tuple[mujoco.MjModel, mujoco.MjData, RobotHandles]:
    model = robot.build_model()
    data = mujoco.MjData(model)
    handles = RobotHandles.find(robot, model)
    handles.spawn(data)
    mujoco.mj_forward(model, data)
    return model, data, handles


def highest_point_m(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Top of the boxes around all visible geoms."""
    top = -np.inf
    for geom in np.flatnonzero(model.geom_group == VISUAL_GROUP):
        rotation = data.geom_xmat[geom].reshape(3, 3)
        center, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        reach = rotation[2] @ center + np.abs(rotation[2]) @ half
        top = max(top, float(data.geom_xpos[geom, 2] + reach))
    return top


def in_larger_scene(robot: RobotSpec, prefix: str) -> mujoco.MjModel:
    scene = mujoco.MjSpec()
    apply_physics_options(scene)
    scene.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    ball = scene.worldbody.add_body(name="ball", pos=[3, 0, 1])
    ball.add_freejoint()
    ball.add_geom(size=[0.1, 0, 0])
    scene.attach(robot.spec(), prefix=prefix, frame=scene.worldbody.add_frame())
    return scene.compile()


@all_robots
def test_masses_are_the_published_ones(robot: RobotSpec):
    model = robot.build_model()
    published = dict(PUBLISHED_MASS[robot.name])
    total = published.pop("total")
    # Published totals are rounded to 0.1 kg, links to 0.01 kg or better.
    assert model.body_subtreemass[0] == pytest.approx(total, abs=0.05)
    assert robot.mass_kg == pytest.approx(model.body_subtreemass[0], abs=0.01)
    for link, mass in published.items():
        assert model.body(link).mass[0] == pytest.approx(mass, abs=0.005)


@all_robots
def test_torque_and_joint_limits_bind(robot: RobotSpec):
    model, data, handles = standing(robot)
    for joint in robot.joints:
        part = part_of(joint.name)
        assert model.actuator(joint.name).forcerange[1] == PUBLISHED_TORQUE[robot.name][part]
        if part in PUBLISHED_RANGE[robot.name]:
            low, high = PUBLISHED_RANGE[robot.name][part]
            if joint.name.startswith("right_") and not model.joint(joint.name).axis[1]:
                # A reflection of y reverses turns about x and z.
                low, high = -high, -low
            np.testing.assert_allclose(model.joint(joint.name).range, (low, high), atol=0.005)
    # An absurd target saturates every servo instead of moving the robot at will.
    data.ctrl[handles.actuators] = 100.0
    mujoco.mj_forward(model, data)
    limits = [joint.torque_nm for joint in robot.joints]
    np.testing.assert_allclose(data.actuator_force[handles.actuators], limits)


@pytest.mark.parametrize("name", sorted(PUBLISHED_SPEED))
def test_motors_lose_their_torque_at_the_published_speed(name: str):
    robot = get_robot(name)
    model, data, handles = standing(robot)
    greatest = np.array([PUBLISHED_SPEED[name][part_of(joint.name)] for joint in robot.joints])
    torque = np.array([joint.torque_nm for joint in robot.joints])

    def force(share: float, target: float) -> np.ndarray:
        data.ctrl[handles.actuators] = target
        data.qvel[handles.joint_dof] = share * greatest
        mujoco.mj_forward(model, data)
        return data.actuator_force[handles.actuators] / torque

    # An absurd target asks for all there is: full torque up to 60 % of the speed, then less.
    for share, left in ((0.0, 1.0), (0.6, 1.0), (0.8, 0.5), (1.0, 0.0)):
        np.testing.assert_allclose(force(share, 100.0), left, atol=1e-9)
    # Braking is not weakened by speed.
    for share in (0.3, 0.8, 1.0):
        np.testing.assert_allclose(force(share, -100.0), -1.0, atol=1e-9)


@pytest.mark.parametrize("name", sorted(PUBLISHED_SPEED))
def test_no_motor_drives_a_joint_faster_than_it_turns(name: str):
    robot = get_robot(name)
    spec = robot.spec()
    apply_physics_options(spec)
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    for joint in spec.joints:
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
    model = spec.compile()
    handles = RobotHandles.find(robot, model)
    greatest = np.array([joint.speed_rad_s for joint in robot.joints])
    data, beyond = mujoco.MjData(model), 0
    for step in range(200):
        # Targets that jump to and fro ask every motor for more than it has.
        data.ctrl[handles.actuators] = 3.0 if step // 25 % 2 else -3.0
        mujoco.mj_step1(model, data)
        speed = data.qvel[handles.joint_dof].copy()
        mujoco.mj_step2(model, data)
        fast = np.abs(speed) > greatest
        beyond += int(fast.sum())
        # A link may be flung faster than its motor turns, but its motor only brakes it then.
        assert (data.actuator_force[handles.actuators] * speed)[fast].max(initial=0.0) < 1e-6
    assert beyond > 0


@all_robots
def test_servos_are_the_published_springs(robot: RobotSpec):
    model, data, handles = standing(robot)
    data.ctrl[handles.actuators] = robot.default_joint_rad + 0.1
    data.qvel[handles.joint_dof] = 0.5
    mujoco.mj_forward(model, data)
    # A wheel's servo is commanded a speed instead of an angle.
    expected = [0.1 * (joint.kp or joint.kd) - 0.5 * joint.kd for joint in robot.joints]
    np.testing.assert_allclose(data.actuator_force[handles.actuators], expected, atol=1e-9)


@all_robots
def test_default_pose_just_touches_the_floor_and_nothing_else(robot: RobotSpec):
    model, data, handles = standing(robot)
    # A soft layer of soles reaches the floor before they do, without a force.
    assert all(contact.dist >= 0.0 for contact in data.contact)
    soles = data.geom_xpos[handles.sole_geoms, 2] - model.geom_rbound[handles.sole_geoms]
    assert np.all((soles >= 0.0) & (soles < 0.01))
    # Sunk by a centimetre it touches with its feet only.
    data.qpos[handles.root_qpos + 2] -= 0.01
    mujoco.mj_forward(model, data)
    touching = {model.geom(g).name for c in data.contact for g in (c.geom1, c.geom2)}
    assert touching == {"floor", *(sole for foot in robot.feet for sole in foot.soles)}


@all_robots
def test_it_stands_as_tall_as_the_real_one(robot: RobotSpec):
    model, data, _ = standing(robot)
    sag = robot.spawn_height_m - robot.base_height_m
    low, high = BASE_HEIGHT[robot.name]
    assert low <= robot.base_height_m <= high
    assert 0.0 <= sag < 0.1 * robot.base_height_m
    low, high = TOP_HEIGHT[robot.name]
    assert low <= highest_point_m(model, data) - sag <= high


@all_robots
def test_left_and_right_are_mirror_images(robot: RobotSpec):
    model, data, handles = standing(robot)
    assert abs(data.subtree_com[handles.root_body, 1]) < 1e-9
    flip = np.array([1.0, -1.0, 1.0])
    names = [model.body(i).name for i in handles.bodies]
    for name in names:
        other = mirrored_name(name)
        np.testing.assert_allclose(data.body(name).xipos * flip, data.body(other).xipos, atol=1e-9)
        np.testing.assert_allclose(model.body(name).inertia, model.body(other).inertia)
        assert model.body(name).mass == model.body(other).mass
    # The Jetbot carries a computer, whose sockets are nowhere symmetric.
    group = COLLISION_GROUP if robot.name == "jetbot" else VISUAL_GROUP
    visual = np.flatnonzero(model.geom_group == group)
    seen = {tuple(np.round([*data.geom_xpos[g], *model.geom_size[g]], 6) + 0.0) for g in visual}
    mirrored = {(x, -y + 0.0, z, *size) for x, y, z, *size in seen}
    assert seen == mirrored


@all_robots
def test_visual_geoms_neither_collide_nor_weigh(robot: RobotSpec):
    model = robot.build_model(floor=False)
    visual = model.geom_group == VISUAL_GROUP
    collision = model.geom_group == COLLISION_GROUP
    assert np.all(visual ^ collision)
    assert not np.any(model.geom_contype[visual] | model.geom_conaffinity[visual])
    assert np.all(model.geom_contype[collision])
    assert len(np.unique(model.geom_rgba[visual], axis=0)) >= 4
    # Enough shapes for a person to recognise it; a bodyless agent is a mere marker.
    assert visual.sum() > (30 if robot.joints else 5)


@all_robots
def test_camera_height_pitch_and_free_view(robot: RobotSpec):
    model, data, handles = standing(robot)
    sag = robot.spawn_height_m - robot.base_height_m
    low, high = CAMERA_HEIGHT[robot.name]
    assert low <= data.cam_xpos[handles.camera, 2] - sag <= high
    rotation = data.cam_xmat[handles.camera].reshape(3, 3)
    forward = -rotation[:, 2]
    pitch = np.rad2deg(np.arcsin(-forward[2]))
    assert pitch == pytest.approx(robot.camera.pitch_down_deg, abs=1e-6)
    assert abs(forward[1]) < 1e-9
    assert rotation[2, 1] > 0.9  # the image is upright
    assert model.cam_fovy[handles.camera] == pytest.approx(90.0)
    # No pixel of the 90° view shows the robot's own shell.
    groups = np.array([0, 0, 1, 0, 0, 0], dtype=np.uint8)
    hit = np.zeros(1, dtype=np.int32)
    for u in np.linspace(-1, 1, 33):
        for v in np.linspace(-1, 1, 33):
            ray = rotation @ np.array([u, v, -1.0])
            mujoco.mj_ray(model, data, data.cam_xpos[handles.camera], ray, groups, 1, -1, hit)
            assert hit[0] == -1, f"pixel ({u:.2f}, {v:.2f}) sees geom {hit[0]}"


@all_robots
def test_found_under_any_prefix(robot: RobotSpec):
    model = in_larger_scene(robot, "scene7/robot/")
    handles = RobotHandles.find(robot, model)
    data = mujoco.MjData(model)
    handles.spawn(data, x_m=1.0, y_m=-2.0, floor_z_m=0.5, yaw_rad=0.7)
    mujoco.mj_forward(model, data)
    position = data.body(f"scene7/robot/{robot.root_body}").xpos
    np.testing.assert_allclose(position, [1.0, -2.0, 0.5 + robot.spawn_height_m])
    assert len(handles.bodies) == robot.build_model().nbody - 1
    assert model.opt.timestep == TIMESTEP_S
    for joint in robot.joints:
        assert data.joint(f"scene7/robot/{joint.name}").qpos[0] == joint.default_rad


def test_absent_robot_is_refused():
    empty = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(InputError, match="0 times"):
        RobotHandles.find(get_robot("aliengo"), empty)


def test_unknown_robot_names_the_valid_ones():
    with pytest.raises(UnknownNameError, match="aliengo"):
        get_robot("spot")


@all_robots
def test_hash_follows_dynamics_and_not_looks(robot: RobotSpec):
    from dataclasses import replace

    def variant(change) -> str:
        def build(r: RobotSpec) -> mujoco.MjSpec:
            spec = robot.build(r)
            change(spec)
            return spec

        return replace(robot, build=build).physics_hash()

    def recolour(spec: mujoco.MjSpec) -> None:
        next(g for g in spec.geoms if g.group == VISUAL_GROUP).rgba = [1, 0, 0, 1]

    def fatten(spec: mujoco.MjSpec) -> None:
        spec.body(robot.root_body).mass *= 1.01

    def grow_foot(spec: mujoco.MjSpec) -> None:
        spec.geom(robot.feet[0].soles[0]).size[0] += 0.001

    reference = robot.physics_hash()
    assert variant(recolour) == reference
    assert variant(fatten) != reference
    assert variant(grow_foot) != reference
