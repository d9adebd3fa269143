"""Unitree H1: a 51.4 kg humanoid with five joints a leg, a turning torso and arms of four."""

from __future__ import annotations

from types import MappingProxyType

import mujoco

from ....formats.core.camera import CameraModel
from ..humanoid import SIDES, Limb, Soles, add_limbs, both_sides, joint_of, link_masses
from ..links import Link, add_links
from ..shapes import add_camera, add_collision, add_imu, add_servo, set_inertia, start_robot
from ..spec import CameraMount, CommandLimits, FallThresholds, RobotSpec
from .shell import dress_pelvis, dress_side, dress_torso

PELVIS_KG = 5.39
SOLES = Soles(
    part="ankle",
    radius_m=0.02,
    z_m=-0.05,
    xy_m=MappingProxyType(
        {
            "heel_out": (-0.05, 0.035),
            "heel_in": (-0.05, -0.035),
            "toe_out": (0.17, 0.035),
            "toe_in": (0.17, -0.035),
        }
    ),
    touch_x_m=0.06,
    touch_m=(0.15, 0.08, 0.04),
)
# Dry friction of such actuators is not published; typical.
FRICTIONLOSS_NM = 0.5

LEFT_LEG = (
    Link(
        "left_hip_yaw",
        "pelvis",
        (0.0, 0.0875, -0.1742),
        "z",
        2.244,
        (-0.049, 0.0, 0.007),
        (0.16, 0.11, 0.12),
        joint_of("left_hip_yaw", 0.0, -0.43, 0.43, 200, 5, 200, 23),
        0.05,
    ),
    Link(
        "left_hip_roll",
        "left_hip_yaw",
        (0.0395, 0.0, 0.0),
        "x",
        2.232,
        (-0.006, 0.03, 0.0),
        (0.12, 0.12, 0.11),
        joint_of("left_hip_roll", 0.0, -0.43, 0.43, 200, 5, 200, 23),
        0.05,
    ),
    Link(
        "left_hip_pitch",
        "left_hip_roll",
        (0.0, 0.115, 0.0),
        "y",
        4.152,
        (0.007, -0.023, -0.082),
        (0.14, 0.12, 0.38),
        joint_of("left_hip_pitch", -0.4, -1.57, 1.57, 200, 5, 200, 23),
        0.05,
    ),
    Link(
        "left_knee",
        "left_hip_pitch",
        (0.0, 0.0, -0.4),
        "y",
        1.721,
        (-0.001, -0.005, -0.138),
        (0.09, 0.08, 0.36),
        joint_of("left_knee", 0.8, -0.26, 2.05, 300, 6, 300, 14),
        0.05,
    ),
    Link(
        "left_ankle",
        "left_knee",
        (0.0, 0.0, -0.4),
        "y",
        0.446,
        (0.049, 0.0, -0.046),
        (0.24, 0.08, 0.05),
        joint_of("left_ankle", -0.4, -0.87, 0.52, 40, 2, 40, 9),
        0.02,
    ),
)
TORSO = Link(
    "torso",
    "pelvis",
    (0.0, 0.0, 0.0),
    "z",
    17.79,
    (0.0, 0.0, 0.205),
    (0.2, 0.26, 0.5),
    joint_of("torso", 0.0, -2.35, 2.35, 300, 6, 200, 23),
    0.05,
)
LEFT_ARM = (
    Link(
        "left_shoulder_pitch",
        "torso",
        (0.0055, 0.155, 0.43),
        "y",
        1.033,
        (0.005, 0.045, -0.005),
        (0.1, 0.1, 0.1),
        joint_of("left_shoulder_pitch", 0.1, -2.87, 2.87, 100, 3, 40, 9),
        0.02,
    ),
    Link(
        "left_shoulder_roll",
        "left_shoulder_pitch",
        (-0.0055, 0.0625, -0.0088),
        "x",
        0.793,
        (0.0, 0.005, -0.06),
        (0.08, 0.08, 0.15),
        joint_of("left_shoulder_roll", 0.1, -0.34, 3.11, 100, 3, 40, 9),
        0.02,
    ),
    Link(
        "left_shoulder_yaw",
        "left_shoulder_roll",
        (0.0, 0.0, -0.1343),
        "z",
        0.839,
        (0.01, 0.0, -0.08),
        (0.08, 0.08, 0.2),
        joint_of("left_shoulder_yaw", 0.0, -1.3, 4.45, 60, 2, 18, 20),
        0.02,
    ),
    # At zero the forearm points forward.
    Link(
        "left_elbow",
        "left_shoulder_yaw",
        (0.0185, 0.0, -0.198),
        "y",
        0.669,
        (0.15, 0.0, -0.01),
        (0.3, 0.06, 0.06),
        joint_of("left_elbow", 1.0, -1.25, 2.61, 60, 2, 18, 20),
        0.02,
    ),
)
LINKS = both_sides(LEFT_LEG, (TORSO,), LEFT_ARM)
LIMBS: tuple[Limb, ...] = (
    ("hip_pitch", 0.06, (0.0, 0.0, -0.08), (0.0, 0.0, -0.33)),
    ("knee", 0.045, (0.0, 0.0, -0.06), (0.0, 0.0, -0.33)),
    ("shoulder_yaw", 0.04, (0.0, 0.0, -0.02), (0.0, 0.0, -0.16)),
    ("elbow", 0.036, (0.03, 0.0, -0.01), (0.27, 0.0, -0.01)),
)


def build_h1(robot: RobotSpec) -> mujoco.MjSpec:
    """The robot alone; collision, visual shapes, servos, sensors and the ego camera."""
    spec, pelvis = start_robot(robot)
    set_inertia(pelvis, PELVIS_KG, (0.0, 0.0, -0.045), (0.15, 0.2, 0.18))
    bodies = add_links(pelvis, LINKS, FRICTIONLOSS_NM)
    add_collision(
        pelvis, "pelvis", "capsule", (0.07,), ends=((0.0, -0.05, -0.05), (0.0, 0.05, -0.05))
    )
    dress_pelvis(pelvis)
    torso = bodies["torso"]
    add_collision(torso, "torso", "box", (0.085, 0.12, 0.2), position=(0.0, 0.0, 0.28))
    add_collision(torso, "head", "capsule", (0.075,), ends=((0.02, 0.0, 0.6), (0.02, 0.0, 0.69)))
    dress_torso(torso)
    for side, left in SIDES:
        add_limbs(bodies, side, LIMBS)
        SOLES.add(spec, bodies, side, left)
        dress_side(bodies, side, left)
    add_imu(spec, pelvis)
    add_camera(bodies[robot.camera.body], robot.camera)
    for joint in robot.joints:
        add_servo(spec, joint)
    return spec


H1 = RobotSpec(
    name="h1",
    title="Unitree H1",
    mass_kg=PELVIS_KG + sum(link.mass_kg for link in LINKS),
    link_mass_kg=link_masses("pelvis", PELVIS_KG, LINKS),
    joints=tuple(link.facts for link in LINKS),
    policy_joints=10,
    action_scale_rad=0.25,
    root_body="pelvis",
    root_joint="root",
    feet=SOLES.feet,
    base_height_m=0.977,
    spawn_height_m=0.982,
    footprint_radius_m=0.30,
    camera=CameraMount(
        name="ego",
        body="torso",
        position_body_m=(0.12, 0.0, 0.68),
        pitch_down_deg=15.0,
        model=CameraModel("ego", 256, 256, 90.0),
    ),
    fall=FallThresholds(com_to_foot_m=0.6),
    command_limits=CommandLimits((-0.3, 1.0), (-0.3, 0.3), (-1.05, 1.05)),
    sources=(
        "masses, link lengths, joint, torque and speed limits: Unitree's published robot "
        "description (unitree_ros, h1.urdf)",
        "fall thresholds, camera height (about 1.66 m, 15° down) and HFOV 90°: VLN-PE",
        "PD gains and default legs: common practice of velocity-tracking policies on this robot",
        "torque falls off from 60 % of the speed limit on: Unitree's torque-speed curves of such "
        "motors have their knee at 55–77 % of the no-load speed (unitree_rl_lab)",
        "link inertias: uniform boxes of the links' outer size with the published masses",
    ),
    build=build_h1,
)
