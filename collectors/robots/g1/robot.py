"""Unitree G1 with 29 joints: a 33.3 kg humanoid, 1.3 m tall."""

from ..humanoid import UNITREE_SOURCES, Bodies, Humanoid, Link, Servo, Soles, both_sides
from ..parts import FallThresholds, ego_camera
from ..shapes import add_collision
from .shell import dress

# Rotor inertia seen through the gears of its motor families, small to large.
TINY_KG_M2, SMALL_KG_M2, MIDDLE_KG_M2, LARGE_KG_M2 = 0.00425, 0.0036, 0.0102, 0.0251
# The ankles and the waist's tilt are driven by two small motors each.
PAIR_KG_M2 = 2 * SMALL_KG_M2
# Dry friction of such actuators is not published; typical.
FRICTIONLOSS_NM = 0.2
# The hip's roll frame leans back by this much, and the knee's frame forward again.
LEAN_DEG = 10.021

HIP = Servo(kp=150, kd=2, torque_nm=88, speed_rad_s=32, armature_kg_m2=MIDDLE_KG_M2)
HIP_ROLL = Servo(kp=150, kd=2, torque_nm=139, speed_rad_s=20, armature_kg_m2=LARGE_KG_M2)
KNEE = Servo(kp=300, kd=4, torque_nm=139, speed_rad_s=20, armature_kg_m2=LARGE_KG_M2)
ANKLE = Servo(kp=50, kd=5, torque_nm=35, speed_rad_s=30, armature_kg_m2=PAIR_KG_M2)
WAIST_YAW = Servo(kp=200, kd=5, torque_nm=88, speed_rad_s=32, armature_kg_m2=MIDDLE_KG_M2)
WAIST_TILT = Servo(kp=200, kd=5, torque_nm=50, speed_rad_s=30, armature_kg_m2=PAIR_KG_M2)
SHOULDER = Servo(kp=60, kd=2, torque_nm=25, speed_rad_s=37, armature_kg_m2=SMALL_KG_M2)
UPPER_ARM = Servo(kp=40, kd=1, torque_nm=25, speed_rad_s=37, armature_kg_m2=SMALL_KG_M2)
WRIST_ROLL = Servo(kp=20, kd=1, torque_nm=25, speed_rad_s=37, armature_kg_m2=SMALL_KG_M2)
WRIST = Servo(kp=20, kd=1, torque_nm=5, speed_rad_s=22, armature_kg_m2=TINY_KG_M2)

LEFT_LEG = (
    Link("left_hip_pitch", "pelvis", "y", HIP, -0.1, (-2.53, 2.88),
         mass_kg=1.35, box_m=(0.1, 0.1, 0.1), position_m=(0.0, 0.0645, -0.1027),
         center_m=(0.003, 0.048, -0.026)),
    Link("left_hip_roll", "left_hip_pitch", "x", HIP_ROLL, 0.0, (-0.52, 2.97),
         mass_kg=1.52, box_m=(0.1, 0.09, 0.14), position_m=(0.0, 0.052, -0.0305),
         center_m=(0.03, -0.001, -0.088), pitch_deg=-LEAN_DEG),
    Link("left_hip_yaw", "left_hip_roll", "z", HIP, 0.0, (-2.76, 2.76),
         mass_kg=1.702, box_m=(0.12, 0.1, 0.2), position_m=(0.025, 0.0, -0.1241),
         center_m=(-0.058, -0.011, -0.151)),
    Link("left_knee", "left_hip_yaw", "y", KNEE, 0.3, (-0.09, 2.88),
         mass_kg=1.932, box_m=(0.1, 0.09, 0.28), position_m=(-0.0783, 0.0021, -0.1773),
         center_m=(0.005, 0.004, -0.121), pitch_deg=LEAN_DEG),
    Link("left_ankle_pitch", "left_knee", "y", ANKLE, -0.2, (-0.87, 0.52),
         mass_kg=0.074, box_m=(0.05, 0.05, 0.05), position_m=(0.0, 0.0, -0.3),
         center_m=(-0.007, 0.0, 0.011)),
    Link("left_ankle_roll", "left_ankle_pitch", "x", ANKLE, 0.0, (-0.26, 0.26),
         mass_kg=0.608, box_m=(0.2, 0.07, 0.04), position_m=(0.0, 0.0, -0.0176),
         center_m=(0.0265, 0.0, -0.0164)),
)  # fmt: skip
WAIST = (
    Link("waist_yaw", "pelvis", "z", WAIST_YAW, 0.0, (-2.618, 2.618),
         mass_kg=0.214, box_m=(0.08, 0.08, 0.06), position_m=(0.0, 0.0, 0.0),
         center_m=(0.0, 0.0, 0.018)),
    Link("waist_roll", "waist_yaw", "x", WAIST_TILT, 0.0, (-0.52, 0.52),
         mass_kg=0.086, box_m=(0.06, 0.06, 0.04), position_m=(-0.004, 0.0, 0.035),
         center_m=(0.0, 0.0, 0.0)),
    Link("torso", "waist_roll", "y", WAIST_TILT, 0.0, (-0.52, 0.52),
         mass_kg=7.818, box_m=(0.15, 0.2, 0.34), position_m=(0.0, 0.0, 0.019),
         center_m=(0.002, 0.0, 0.17), joint_name="waist_pitch_joint"),
)  # fmt: skip
LEFT_ARM = (
    Link("left_shoulder_pitch", "torso", "y", SHOULDER, 0.2, (-3.09, 2.67),
         mass_kg=0.718, box_m=(0.08, 0.09, 0.08), position_m=(0.004, 0.1002, 0.2478),
         center_m=(0.0, 0.036, -0.01)),
    Link("left_shoulder_roll", "left_shoulder_pitch", "x", SHOULDER, 0.16, (-1.59, 2.25),
         mass_kg=0.643, box_m=(0.07, 0.07, 0.12), position_m=(0.0, 0.05, -0.003),
         center_m=(0.0, 0.003, -0.05)),
    Link("left_shoulder_yaw", "left_shoulder_roll", "z", UPPER_ARM, 0.0, (-2.618, 2.618),
         mass_kg=0.734, box_m=(0.07, 0.07, 0.12), position_m=(0.0, 0.0, -0.1032),
         center_m=(0.011, 0.0, -0.06)),
    # At zero the forearm points forward.
    Link("left_elbow", "left_shoulder_yaw", "y", UPPER_ARM, 0.8, (-1.047, 2.094),
         mass_kg=0.6, box_m=(0.14, 0.06, 0.06), position_m=(0.0158, 0.0, -0.0805),
         center_m=(0.06, 0.0, -0.01)),
    Link("left_wrist_roll", "left_elbow", "x", WRIST_ROLL, 0.0, (-1.97, 1.97),
         mass_kg=0.0854, box_m=(0.05, 0.05, 0.05), position_m=(0.1, 0.0, -0.01),
         center_m=(0.017, 0.0, 0.0)),
    Link("left_wrist_pitch", "left_wrist_roll", "y", WRIST, 0.0, (-1.614, 1.614),
         mass_kg=0.484, box_m=(0.07, 0.05, 0.06), position_m=(0.038, 0.0, 0.0),
         center_m=(0.023, 0.0, 0.0)),
    Link("left_wrist_yaw", "left_wrist_pitch", "z", WRIST, 0.0, (-1.614, 1.614),
         mass_kg=0.2546, box_m=(0.14, 0.04, 0.07), position_m=(0.046, 0.0, 0.0),
         center_m=(0.07, 0.0, 0.0)),
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
        xy_m={
            "heel_out": (-0.05, 0.025),
            "heel_in": (-0.05, -0.025),
            "toe_out": (0.12, 0.03),
            "toe_in": (0.12, -0.03),
        },
        touch_x_m=0.035,
        touch_m=(0.11, 0.06, 0.03),
    ),
    dress=dress,
)


G1 = BODY.robot(
    name="g1",
    title="Unitree G1",
    policy_joints=12,
    base_height_m=0.783,
    spawn_height_m=0.785,
    footprint_radius_m=0.25,
    camera=ego_camera("torso", (0.075, 0.0175, 0.43), 0.0),
    fall=FallThresholds(com_to_foot_m=0.42),
    sources=(
        "masses, link lengths, joint, torque and speed limits: Unitree's published robot "
        "description (unitree_ros, g1_29dof_rev_1_0.urdf)",
        "fall rule and HFOV 90°: VLN-PE; the camera is where its D435 sits, levelled",
        *UNITREE_SOURCES,
    ),
)
