"""Unitree G1 with 29 joints: a 33.3 kg humanoid, 1.3 m tall."""

from __future__ import annotations

from types import MappingProxyType

import mujoco

from ....formats.core.camera import CameraModel
from ..humanoid import SIDES, Limb, Soles, add_limbs, both_sides, joint_of, link_masses
from ..links import Link, add_links
from ..shapes import add_camera, add_collision, add_imu, add_servo, set_inertia, start_robot
from ..spec import CameraMount, CommandLimits, FallThresholds, RobotSpec
from .shell import dress_pelvis, dress_side, dress_torso, dress_waist

PELVIS_KG = 3.813
SOLES = Soles(
    part="ankle_roll",
    radius_m=0.015,
    z_m=-0.02,
    xy_m=MappingProxyType(
        {
            "heel_out": (-0.05, 0.025),
            "heel_in": (-0.05, -0.025),
            "toe_out": (0.12, 0.03),
            "toe_in": (0.12, -0.03),
        }
    ),
    touch_x_m=0.035,
    touch_m=(0.11, 0.06, 0.03),
)
# Rotor inertia seen through the gears of its motor families, small to large.
TINY_KG_M2, SMALL_KG_M2, MIDDLE_KG_M2, LARGE_KG_M2 = 0.00425, 0.0036, 0.0102, 0.0251
# The ankles and the waist's tilt are driven by two small motors each.
PAIR_KG_M2 = 2 * SMALL_KG_M2
# Dry friction of such actuators is not published; typical.
FRICTIONLOSS_NM = 0.2
# The hip's roll frame leans back by this much, and the knee's frame forward again.
LEAN_DEG = 10.021

LEFT_LEG = (
    Link(
        "left_hip_pitch",
        "pelvis",
        (0.0, 0.0645, -0.1027),
        "y",
        1.35,
        (0.003, 0.048, -0.026),
        (0.1, 0.1, 0.1),
        joint_of("left_hip_pitch", -0.1, -2.53, 2.88, 150, 2, 88, 32),
        MIDDLE_KG_M2,
    ),
    Link(
        "left_hip_roll",
        "left_hip_pitch",
        (0.0, 0.052, -0.0305),
        "x",
        1.52,
        (0.03, -0.001, -0.088),
        (0.1, 0.09, 0.14),
        joint_of("left_hip_roll", 0.0, -0.52, 2.97, 150, 2, 139, 20),
        LARGE_KG_M2,
        -LEAN_DEG,
    ),
    Link(
        "left_hip_yaw",
        "left_hip_roll",
        (0.025, 0.0, -0.1241),
        "z",
        1.702,
        (-0.058, -0.011, -0.151),
        (0.12, 0.1, 0.2),
        joint_of("left_hip_yaw", 0.0, -2.76, 2.76, 150, 2, 88, 32),
        MIDDLE_KG_M2,
    ),
    Link(
        "left_knee",
        "left_hip_yaw",
        (-0.0783, 0.0021, -0.1773),
        "y",
        1.932,
        (0.005, 0.004, -0.121),
        (0.1, 0.09, 0.28),
        joint_of("left_knee", 0.3, -0.09, 2.88, 300, 4, 139, 20),
        LARGE_KG_M2,
        LEAN_DEG,
    ),
    Link(
        "left_ankle_pitch",
        "left_knee",
        (0.0, 0.0, -0.3),
        "y",
        0.074,
        (-0.007, 0.0, 0.011),
        (0.05, 0.05, 0.05),
        joint_of("left_ankle_pitch", -0.2, -0.87, 0.52, 50, 5, 35, 30),
        PAIR_KG_M2,
    ),
    Link(
        "left_ankle_roll",
        "left_ankle_pitch",
        (0.0, 0.0, -0.0176),
        "x",
        0.608,
        (0.0265, 0.0, -0.0164),
        (0.2, 0.07, 0.04),
        joint_of("left_ankle_roll", 0.0, -0.26, 0.26, 50, 5, 35, 30),
        PAIR_KG_M2,
    ),
)
WAIST = (
    Link(
        "waist_yaw",
        "pelvis",
        (0.0, 0.0, 0.0),
        "z",
        0.214,
        (0.0, 0.0, 0.018),
        (0.08, 0.08, 0.06),
        joint_of("waist_yaw", 0.0, -2.618, 2.618, 200, 5, 88, 32),
        MIDDLE_KG_M2,
    ),
    Link(
        "waist_roll",
        "waist_yaw",
        (-0.004, 0.0, 0.035),
        "x",
        0.086,
        (0.0, 0.0, 0.0),
        (0.06, 0.06, 0.04),
        joint_of("waist_roll", 0.0, -0.52, 0.52, 200, 5, 50, 30),
        PAIR_KG_M2,
    ),
    Link(
        "torso",
        "waist_roll",
        (0.0, 0.0, 0.019),
        "y",
        7.818,
        (0.002, 0.0, 0.17),
        (0.15, 0.2, 0.34),
        joint_of("waist_pitch", 0.0, -0.52, 0.52, 200, 5, 50, 30),
        PAIR_KG_M2,
    ),
)
LEFT_ARM = (
    Link(
        "left_shoulder_pitch",
        "torso",
        (0.004, 0.1002, 0.2478),
        "y",
        0.718,
        (0.0, 0.036, -0.01),
        (0.08, 0.09, 0.08),
        joint_of("left_shoulder_pitch", 0.2, -3.09, 2.67, 60, 2, 25, 37),
        SMALL_KG_M2,
    ),
    Link(
        "left_shoulder_roll",
        "left_shoulder_pitch",
        (0.0, 0.05, -0.003),
        "x",
        0.643,
        (0.0, 0.003, -0.05),
        (0.07, 0.07, 0.12),
        joint_of("left_shoulder_roll", 0.16, -1.59, 2.25, 60, 2, 25, 37),
        SMALL_KG_M2,
    ),
    Link(
        "left_shoulder_yaw",
        "left_shoulder_roll",
        (0.0, 0.0, -0.1032),
        "z",
        0.734,
        (0.011, 0.0, -0.06),
        (0.07, 0.07, 0.12),
        joint_of("left_shoulder_yaw", 0.0, -2.618, 2.618, 40, 1, 25, 37),
        SMALL_KG_M2,
    ),
    # At zero the forearm points forward.
    Link(
        "left_elbow",
        "left_shoulder_yaw",
        (0.0158, 0.0, -0.0805),
        "y",
        0.6,
        (0.06, 0.0, -0.01),
        (0.14, 0.06, 0.06),
        joint_of("left_elbow", 0.8, -1.047, 2.094, 40, 1, 25, 37),
        SMALL_KG_M2,
    ),
    Link(
        "left_wrist_roll",
        "left_elbow",
        (0.1, 0.0, -0.01),
        "x",
        0.0854,
        (0.017, 0.0, 0.0),
        (0.05, 0.05, 0.05),
        joint_of("left_wrist_roll", 0.0, -1.97, 1.97, 20, 1, 25, 37),
        SMALL_KG_M2,
    ),
    Link(
        "left_wrist_pitch",
        "left_wrist_roll",
        (0.038, 0.0, 0.0),
        "y",
        0.484,
        (0.023, 0.0, 0.0),
        (0.07, 0.05, 0.06),
        joint_of("left_wrist_pitch", 0.0, -1.614, 1.614, 20, 1, 5, 22),
        TINY_KG_M2,
    ),
    Link(
        "left_wrist_yaw",
        "left_wrist_pitch",
        (0.046, 0.0, 0.0),
        "z",
        0.2546,
        (0.07, 0.0, 0.0),
        (0.14, 0.04, 0.07),
        joint_of("left_wrist_yaw", 0.0, -1.614, 1.614, 20, 1, 5, 22),
        TINY_KG_M2,
    ),
)
LINKS = both_sides(LEFT_LEG, WAIST, LEFT_ARM)
LIMBS: tuple[Limb, ...] = (
    ("hip_yaw", 0.05, (-0.025, 0.0, 0.0), (-0.065, 0.0, -0.12)),
    ("knee", 0.038, (0.0, 0.0, -0.05), (0.0, 0.0, -0.24)),
    ("shoulder_yaw", 0.035, (0.0, 0.0, 0.0), (0.01, 0.0, -0.06)),
    ("elbow", 0.032, (0.03, 0.0, -0.01), (0.1, 0.0, -0.01)),
    ("wrist_yaw", 0.032, (0.0, 0.0, 0.0), (0.1, 0.0, 0.0)),
)


def build_g1(robot: RobotSpec) -> mujoco.MjSpec:
    """The robot alone; collision, visual shapes, servos, sensors and the ego camera."""
    spec, pelvis = start_robot(robot)
    set_inertia(pelvis, PELVIS_KG, (0.0, 0.0, -0.076), (0.12, 0.15, 0.13))
    bodies = add_links(pelvis, LINKS, FRICTIONLOSS_NM)
    add_collision(
        pelvis, "pelvis", "capsule", (0.055,), ends=((0.0, -0.03, -0.06), (0.0, 0.03, -0.06))
    )
    dress_pelvis(pelvis)
    dress_waist(bodies)
    torso = bodies["torso"]
    add_collision(torso, "torso", "box", (0.065, 0.085, 0.13), position=(0.0, 0.0, 0.17))
    add_collision(torso, "head", "capsule", (0.06,), ends=((0.0, 0.0, 0.37), (0.0, 0.0, 0.43)))
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


G1 = RobotSpec(
    name="g1",
    title="Unitree G1",
    mass_kg=PELVIS_KG + sum(link.mass_kg for link in LINKS),
    link_mass_kg=link_masses("pelvis", PELVIS_KG, LINKS),
    joints=tuple(link.facts for link in LINKS),
    policy_joints=12,
    action_scale_rad=0.25,
    root_body="pelvis",
    root_joint="root",
    feet=SOLES.feet,
    base_height_m=0.783,
    spawn_height_m=0.785,
    footprint_radius_m=0.25,
    camera=CameraMount(
        name="ego",
        body="torso",
        # The D435's place between the eyes, levelled.
        position_body_m=(0.075, 0.0175, 0.43),
        pitch_down_deg=0.0,
        model=CameraModel("ego", 256, 256, 90.0),
    ),
    fall=FallThresholds(com_to_foot_m=0.42),
    command_limits=CommandLimits((-0.3, 1.0), (-0.3, 0.3), (-1.05, 1.05)),
    sources=(
        "masses, link lengths, joint, torque and speed limits: Unitree's published robot "
        "description (unitree_ros, g1_29dof_rev_1_0.urdf)",
        "fall rule and HFOV 90°: VLN-PE; the camera is where its D435 sits, levelled",
        "PD gains and default legs: common practice of velocity-tracking policies on this robot",
        "torque falls off from 60 % of the speed limit on: Unitree's torque-speed curves of such "
        "motors have their knee at 55–77 % of the no-load speed (unitree_rl_lab)",
        "link inertias: uniform boxes of the links' outer size with the published masses",
    ),
    build=build_g1,
)
