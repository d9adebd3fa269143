"""Unitree H1: a 51.4 kg humanoid with five joints a leg, a turning torso and arms of four."""

from types import MappingProxyType

import mujoco

from ....formats.core.camera import CameraModel
from ..humanoid import Bodies, Humanoid, Link, Soles, both_sides
from ..parts import CameraMount, CommandLimits, FallThresholds, JointFacts
from ..shapes import add_collision
from ..spec import RobotSpec
from .shell import dress

# Dry friction of such actuators is not published; typical.
FRICTIONLOSS_NM = 0.5

LEFT_LEG = (
    Link(
        "left_hip_yaw", parent="pelvis", axis="z", box_m=(0.16, 0.11, 0.12),
        position_m=(0.0, 0.0875, -0.1742), center_m=(-0.049, 0.0, 0.007),
        joint=JointFacts("left_hip_yaw_joint", 0.0, (-0.43, 0.43), kp=200, kd=5,
                         torque_nm=200, speed_rad_s=23), mass_kg=2.244, armature_kg_m2=0.05,
    ),
    Link(
        "left_hip_roll", parent="left_hip_yaw", axis="x", box_m=(0.12, 0.12, 0.11),
        position_m=(0.0395, 0.0, 0.0), center_m=(-0.006, 0.03, 0.0),
        joint=JointFacts("left_hip_roll_joint", 0.0, (-0.43, 0.43), kp=200, kd=5,
                         torque_nm=200, speed_rad_s=23), mass_kg=2.232, armature_kg_m2=0.05,
    ),
    Link(
        "left_hip_pitch", parent="left_hip_roll", axis="y", box_m=(0.14, 0.12, 0.38),
        position_m=(0.0, 0.115, 0.0), center_m=(0.007, -0.023, -0.082),
        joint=JointFacts("left_hip_pitch_joint", -0.4, (-1.57, 1.57), kp=200, kd=5,
                         torque_nm=200, speed_rad_s=23), mass_kg=4.152, armature_kg_m2=0.05,
    ),
    Link(
        "left_knee", parent="left_hip_pitch", axis="y", box_m=(0.09, 0.08, 0.36),
        position_m=(0.0, 0.0, -0.4), center_m=(-0.001, -0.005, -0.138),
        joint=JointFacts("left_knee_joint", 0.8, (-0.26, 2.05), kp=300, kd=6,
                         torque_nm=300, speed_rad_s=14), mass_kg=1.721, armature_kg_m2=0.05,
    ),
    Link(
        "left_ankle", parent="left_knee", axis="y", box_m=(0.24, 0.08, 0.05),
        position_m=(0.0, 0.0, -0.4), center_m=(0.049, 0.0, -0.046),
        joint=JointFacts("left_ankle_joint", -0.4, (-0.87, 0.52), kp=40, kd=2,
                         torque_nm=40, speed_rad_s=9), mass_kg=0.446, armature_kg_m2=0.02,
    ),
)  # fmt: skip
TORSO = Link(
    "torso", parent="pelvis", axis="z", box_m=(0.2, 0.26, 0.5),
    position_m=(0.0, 0.0, 0.0), center_m=(0.0, 0.0, 0.205),
    joint=JointFacts("torso_joint", 0.0, (-2.35, 2.35), kp=300, kd=6,
                     torque_nm=200, speed_rad_s=23), mass_kg=17.79, armature_kg_m2=0.05,
)  # fmt: skip
LEFT_ARM = (
    Link(
        "left_shoulder_pitch", parent="torso", axis="y", box_m=(0.1, 0.1, 0.1),
        position_m=(0.0055, 0.155, 0.43), center_m=(0.005, 0.045, -0.005),
        joint=JointFacts("left_shoulder_pitch_joint", 0.1, (-2.87, 2.87), kp=100, kd=3,
                         torque_nm=40, speed_rad_s=9), mass_kg=1.033, armature_kg_m2=0.02,
    ),
    Link(
        "left_shoulder_roll", parent="left_shoulder_pitch", axis="x", box_m=(0.08, 0.08, 0.15),
        position_m=(-0.0055, 0.0625, -0.0088), center_m=(0.0, 0.005, -0.06),
        joint=JointFacts("left_shoulder_roll_joint", 0.1, (-0.34, 3.11), kp=100, kd=3,
                         torque_nm=40, speed_rad_s=9), mass_kg=0.793, armature_kg_m2=0.02,
    ),
    Link(
        "left_shoulder_yaw", parent="left_shoulder_roll", axis="z", box_m=(0.08, 0.08, 0.2),
        position_m=(0.0, 0.0, -0.1343), center_m=(0.01, 0.0, -0.08),
        joint=JointFacts("left_shoulder_yaw_joint", 0.0, (-1.3, 4.45), kp=60, kd=2,
                         torque_nm=18, speed_rad_s=20), mass_kg=0.839, armature_kg_m2=0.02,
    ),
    # At zero the forearm points forward.
    Link(
        "left_elbow", parent="left_shoulder_yaw", axis="y", box_m=(0.3, 0.06, 0.06),
        position_m=(0.0185, 0.0, -0.198), center_m=(0.15, 0.0, -0.01),
        joint=JointFacts("left_elbow_joint", 1.0, (-1.25, 2.61), kp=60, kd=2,
                         torque_nm=18, speed_rad_s=20), mass_kg=0.669, armature_kg_m2=0.02,
    ),
)  # fmt: skip


def _add_trunk(bodies: Bodies) -> None:
    pelvis, torso = bodies["pelvis"], bodies["torso"]
    add_collision(
        pelvis, "pelvis", "capsule", (0.07,), ends=((0.0, -0.05, -0.05), (0.0, 0.05, -0.05))
    )
    add_collision(torso, "torso", "box", (0.085, 0.12, 0.2), position=(0.0, 0.0, 0.28))
    add_collision(torso, "head", "capsule", (0.075,), ends=((0.02, 0.0, 0.6), (0.02, 0.0, 0.69)))


BODY = Humanoid(
    pelvis_kg=5.39,
    pelvis_center_m=(0.0, 0.0, -0.045),
    pelvis_box_m=(0.15, 0.2, 0.18),
    links=both_sides(left_leg=LEFT_LEG, middle=(TORSO,), left_arm=LEFT_ARM),
    frictionloss_nm=FRICTIONLOSS_NM,
    trunk=_add_trunk,
    limbs=(
        ("hip_pitch", 0.06, (0.0, 0.0, -0.08), (0.0, 0.0, -0.33)),
        ("knee", 0.045, (0.0, 0.0, -0.06), (0.0, 0.0, -0.33)),
        ("shoulder_yaw", 0.04, (0.0, 0.0, -0.02), (0.0, 0.0, -0.16)),
        ("elbow", 0.036, (0.03, 0.0, -0.01), (0.27, 0.0, -0.01)),
    ),
    soles=Soles(
        link="ankle",
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
    ),
    dress=dress,
)


def build_h1(robot: RobotSpec) -> mujoco.MjSpec:
    """Return the robot alone: collision and visual shapes, servos, sensors, ego camera."""
    return BODY.build(robot)


H1 = RobotSpec(
    name="h1",
    title="Unitree H1",
    mass_kg=BODY.mass_kg,
    link_mass_kg=MappingProxyType(BODY.link_mass_kg),
    joints=tuple(link.joint for link in BODY.links),
    policy_joints=10,
    action_scale_rad=0.25,
    root_body="pelvis",
    root_joint="root",
    feet=BODY.soles.feet,
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
    command_limits=CommandLimits(vx_m_s=(-0.3, 1.0), vy_m_s=(-0.3, 0.3), yaw_rad_s=(-1.05, 1.05)),
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
