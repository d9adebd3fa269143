"""Unitree G1 with 29 joints: a 33.3 kg humanoid, 1.3 m tall."""

from types import MappingProxyType

import mujoco

from ....formats.core.camera import CameraModel
from ..humanoid import Bodies, Humanoid, Link, Soles, both_sides
from ..parts import CameraMount, CommandLimits, FallThresholds, JointFacts
from ..shapes import add_collision
from ..spec import RobotSpec
from .shell import dress

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
        "left_hip_pitch", parent="pelvis", axis="y", box_m=(0.1, 0.1, 0.1),
        position_m=(0.0, 0.0645, -0.1027), center_m=(0.003, 0.048, -0.026),
        joint=JointFacts("left_hip_pitch_joint", -0.1, (-2.53, 2.88), kp=150, kd=2,
                         torque_nm=88, speed_rad_s=32), mass_kg=1.35, armature_kg_m2=MIDDLE_KG_M2,
    ),
    Link(
        "left_hip_roll", parent="left_hip_pitch", axis="x", box_m=(0.1, 0.09, 0.14),
        position_m=(0.0, 0.052, -0.0305), center_m=(0.03, -0.001, -0.088), pitch_deg=-LEAN_DEG,
        joint=JointFacts("left_hip_roll_joint", 0.0, (-0.52, 2.97), kp=150, kd=2,
                         torque_nm=139, speed_rad_s=20), mass_kg=1.52, armature_kg_m2=LARGE_KG_M2,
    ),
    Link(
        "left_hip_yaw", parent="left_hip_roll", axis="z", box_m=(0.12, 0.1, 0.2),
        position_m=(0.025, 0.0, -0.1241), center_m=(-0.058, -0.011, -0.151),
        joint=JointFacts("left_hip_yaw_joint", 0.0, (-2.76, 2.76), kp=150, kd=2,
                         torque_nm=88, speed_rad_s=32), mass_kg=1.702, armature_kg_m2=MIDDLE_KG_M2,
    ),
    Link(
        "left_knee", parent="left_hip_yaw", axis="y", box_m=(0.1, 0.09, 0.28),
        position_m=(-0.0783, 0.0021, -0.1773), center_m=(0.005, 0.004, -0.121), pitch_deg=LEAN_DEG,
        joint=JointFacts("left_knee_joint", 0.3, (-0.09, 2.88), kp=300, kd=4,
                         torque_nm=139, speed_rad_s=20), mass_kg=1.932, armature_kg_m2=LARGE_KG_M2,
    ),
    Link(
        "left_ankle_pitch", parent="left_knee", axis="y", box_m=(0.05, 0.05, 0.05),
        position_m=(0.0, 0.0, -0.3), center_m=(-0.007, 0.0, 0.011),
        joint=JointFacts("left_ankle_pitch_joint", -0.2, (-0.87, 0.52), kp=50, kd=5,
                         torque_nm=35, speed_rad_s=30), mass_kg=0.074, armature_kg_m2=PAIR_KG_M2,
    ),
    Link(
        "left_ankle_roll", parent="left_ankle_pitch", axis="x", box_m=(0.2, 0.07, 0.04),
        position_m=(0.0, 0.0, -0.0176), center_m=(0.0265, 0.0, -0.0164),
        joint=JointFacts("left_ankle_roll_joint", 0.0, (-0.26, 0.26), kp=50, kd=5,
                         torque_nm=35, speed_rad_s=30), mass_kg=0.608, armature_kg_m2=PAIR_KG_M2,
    ),
)  # fmt: skip
WAIST = (
    Link(
        "waist_yaw", parent="pelvis", axis="z", box_m=(0.08, 0.08, 0.06),
        position_m=(0.0, 0.0, 0.0), center_m=(0.0, 0.0, 0.018),
        joint=JointFacts("waist_yaw_joint", 0.0, (-2.618, 2.618), kp=200, kd=5,
                         torque_nm=88, speed_rad_s=32), mass_kg=0.214, armature_kg_m2=MIDDLE_KG_M2,
    ),
    Link(
        "waist_roll", parent="waist_yaw", axis="x", box_m=(0.06, 0.06, 0.04),
        position_m=(-0.004, 0.0, 0.035), center_m=(0.0, 0.0, 0.0),
        joint=JointFacts("waist_roll_joint", 0.0, (-0.52, 0.52), kp=200, kd=5,
                         torque_nm=50, speed_rad_s=30), mass_kg=0.086, armature_kg_m2=PAIR_KG_M2,
    ),
    Link(
        "torso", parent="waist_roll", axis="y", box_m=(0.15, 0.2, 0.34),
        position_m=(0.0, 0.0, 0.019), center_m=(0.002, 0.0, 0.17),
        joint=JointFacts("waist_pitch_joint", 0.0, (-0.52, 0.52), kp=200, kd=5,
                         torque_nm=50, speed_rad_s=30), mass_kg=7.818, armature_kg_m2=PAIR_KG_M2,
    ),
)  # fmt: skip
LEFT_ARM = (
    Link(
        "left_shoulder_pitch", parent="torso", axis="y", box_m=(0.08, 0.09, 0.08),
        position_m=(0.004, 0.1002, 0.2478), center_m=(0.0, 0.036, -0.01),
        joint=JointFacts("left_shoulder_pitch_joint", 0.2, (-3.09, 2.67), kp=60, kd=2,
                         torque_nm=25, speed_rad_s=37), mass_kg=0.718, armature_kg_m2=SMALL_KG_M2,
    ),
    Link(
        "left_shoulder_roll", parent="left_shoulder_pitch", axis="x", box_m=(0.07, 0.07, 0.12),
        position_m=(0.0, 0.05, -0.003), center_m=(0.0, 0.003, -0.05),
        joint=JointFacts("left_shoulder_roll_joint", 0.16, (-1.59, 2.25), kp=60, kd=2,
                         torque_nm=25, speed_rad_s=37), mass_kg=0.643, armature_kg_m2=SMALL_KG_M2,
    ),
    Link(
        "left_shoulder_yaw", parent="left_shoulder_roll", axis="z", box_m=(0.07, 0.07, 0.12),
        position_m=(0.0, 0.0, -0.1032), center_m=(0.011, 0.0, -0.06),
        joint=JointFacts("left_shoulder_yaw_joint", 0.0, (-2.618, 2.618), kp=40, kd=1,
                         torque_nm=25, speed_rad_s=37), mass_kg=0.734, armature_kg_m2=SMALL_KG_M2,
    ),
    # At zero the forearm points forward.
    Link(
        "left_elbow", parent="left_shoulder_yaw", axis="y", box_m=(0.14, 0.06, 0.06),
        position_m=(0.0158, 0.0, -0.0805), center_m=(0.06, 0.0, -0.01),
        joint=JointFacts("left_elbow_joint", 0.8, (-1.047, 2.094), kp=40, kd=1,
                         torque_nm=25, speed_rad_s=37), mass_kg=0.6, armature_kg_m2=SMALL_KG_M2,
    ),
    Link(
        "left_wrist_roll", parent="left_elbow", axis="x", box_m=(0.05, 0.05, 0.05),
        position_m=(0.1, 0.0, -0.01), center_m=(0.017, 0.0, 0.0),
        joint=JointFacts("left_wrist_roll_joint", 0.0, (-1.97, 1.97), kp=20, kd=1,
                         torque_nm=25, speed_rad_s=37), mass_kg=0.0854, armature_kg_m2=SMALL_KG_M2,
    ),
    Link(
        "left_wrist_pitch", parent="left_wrist_roll", axis="y", box_m=(0.07, 0.05, 0.06),
        position_m=(0.038, 0.0, 0.0), center_m=(0.023, 0.0, 0.0),
        joint=JointFacts("left_wrist_pitch_joint", 0.0, (-1.614, 1.614), kp=20, kd=1,
                         torque_nm=5, speed_rad_s=22), mass_kg=0.484, armature_kg_m2=TINY_KG_M2,
    ),
    Link(
        "left_wrist_yaw", parent="left_wrist_pitch", axis="z", box_m=(0.14, 0.04, 0.07),
        position_m=(0.046, 0.0, 0.0), center_m=(0.07, 0.0, 0.0),
        joint=JointFacts("left_wrist_yaw_joint", 0.0, (-1.614, 1.614), kp=20, kd=1,
                         torque_nm=5, speed_rad_s=22), mass_kg=0.2546, armature_kg_m2=TINY_KG_M2,
    ),
)  # fmt: skip


def _add_trunk(bodies: Bodies) -> None:
    pelvis, torso = bodies["pelvis"], bodies["torso"]
    add_collision(
        pelvis, "pelvis", "capsule", (0.055,), ends=((0.0, -0.03, -0.06), (0.0, 0.03, -0.06))
    )
    add_collision(torso, "torso", "box", (0.065, 0.085, 0.13), position=(0.0, 0.0, 0.17))
    add_collision(torso, "head", "capsule", (0.06,), ends=((0.0, 0.0, 0.37), (0.0, 0.0, 0.43)))


BODY = Humanoid(
    pelvis_kg=3.813,
    pelvis_center_m=(0.0, 0.0, -0.076),
    pelvis_box_m=(0.12, 0.15, 0.13),
    links=both_sides(left_leg=LEFT_LEG, middle=WAIST, left_arm=LEFT_ARM),
    frictionloss_nm=FRICTIONLOSS_NM,
    trunk=_add_trunk,
    limbs=(
        ("hip_yaw", 0.05, (-0.025, 0.0, 0.0), (-0.065, 0.0, -0.12)),
        ("knee", 0.038, (0.0, 0.0, -0.05), (0.0, 0.0, -0.24)),
        ("shoulder_yaw", 0.035, (0.0, 0.0, 0.0), (0.01, 0.0, -0.06)),
        ("elbow", 0.032, (0.03, 0.0, -0.01), (0.1, 0.0, -0.01)),
        ("wrist_yaw", 0.032, (0.0, 0.0, 0.0), (0.1, 0.0, 0.0)),
    ),
    soles=Soles(
        link="ankle_roll",
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
    ),
    dress=dress,
)


def build_g1(robot: RobotSpec) -> mujoco.MjSpec:
    """Return the robot alone: collision and visual shapes, servos, sensors, ego camera."""
    return BODY.build(robot)


G1 = RobotSpec(
    name="g1",
    title="Unitree G1",
    mass_kg=BODY.mass_kg,
    link_mass_kg=MappingProxyType(BODY.link_mass_kg),
    joints=tuple(link.joint for link in BODY.links),
    policy_joints=12,
    action_scale_rad=0.25,
    root_body="pelvis",
    root_joint="root",
    feet=BODY.soles.feet,
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
    command_limits=CommandLimits(vx_m_s=(-0.3, 1.0), vy_m_s=(-0.3, 0.3), yaw_rad_s=(-1.05, 1.05)),
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
