"""Unitree H1: a 51.4 kg humanoid with five joints a leg, a turning torso and arms of four."""

from ..humanoid import UNITREE_SOURCES, Bodies, Humanoid, Link, Servo, Soles, both_sides
from ..parts import FallThresholds, ego_camera
from ..shapes import add_collision
from .shell import dress

# Dry friction of such actuators is not published; typical.
FRICTIONLOSS_NM = 0.5

WAIST = Servo(kp=300, kd=6, torque_nm=200, speed_rad_s=23, armature_kg_m2=0.05)
HIP = Servo(kp=200, kd=5, torque_nm=200, speed_rad_s=23, armature_kg_m2=0.05)
KNEE = Servo(kp=300, kd=6, torque_nm=300, speed_rad_s=14, armature_kg_m2=0.05)
ANKLE = Servo(kp=40, kd=2, torque_nm=40, speed_rad_s=9, armature_kg_m2=0.02)
SHOULDER = Servo(kp=100, kd=3, torque_nm=40, speed_rad_s=9, armature_kg_m2=0.02)
UPPER_ARM = Servo(kp=60, kd=2, torque_nm=18, speed_rad_s=20, armature_kg_m2=0.02)

LEFT_LEG = (
    Link("left_hip_yaw", "pelvis", "z", HIP, 0.0, (-0.43, 0.43),
         mass_kg=2.244, box_m=(0.16, 0.11, 0.12), position_m=(0.0, 0.0875, -0.1742),
         center_m=(-0.049, 0.0, 0.007)),
    Link("left_hip_roll", "left_hip_yaw", "x", HIP, 0.0, (-0.43, 0.43),
         mass_kg=2.232, box_m=(0.12, 0.12, 0.11), position_m=(0.0395, 0.0, 0.0),
         center_m=(-0.006, 0.03, 0.0)),
    Link("left_hip_pitch", "left_hip_roll", "y", HIP, -0.4, (-1.57, 1.57),
         mass_kg=4.152, box_m=(0.14, 0.12, 0.38), position_m=(0.0, 0.115, 0.0),
         center_m=(0.007, -0.023, -0.082)),
    Link("left_knee", "left_hip_pitch", "y", KNEE, 0.8, (-0.26, 2.05),
         mass_kg=1.721, box_m=(0.09, 0.08, 0.36), position_m=(0.0, 0.0, -0.4),
         center_m=(-0.001, -0.005, -0.138)),
    Link("left_ankle", "left_knee", "y", ANKLE, -0.4, (-0.87, 0.52),
         mass_kg=0.446, box_m=(0.24, 0.08, 0.05), position_m=(0.0, 0.0, -0.4),
         center_m=(0.049, 0.0, -0.046)),
)  # fmt: skip
TORSO = Link("torso", "pelvis", "z", WAIST, 0.0, (-2.35, 2.35),
             mass_kg=17.79, box_m=(0.2, 0.26, 0.5), position_m=(0.0, 0.0, 0.0),
             center_m=(0.0, 0.0, 0.205))  # fmt: skip
LEFT_ARM = (
    Link("left_shoulder_pitch", "torso", "y", SHOULDER, 0.1, (-2.87, 2.87),
         mass_kg=1.033, box_m=(0.1, 0.1, 0.1), position_m=(0.0055, 0.155, 0.43),
         center_m=(0.005, 0.045, -0.005)),
    Link("left_shoulder_roll", "left_shoulder_pitch", "x", SHOULDER, 0.1, (-0.34, 3.11),
         mass_kg=0.793, box_m=(0.08, 0.08, 0.15), position_m=(-0.0055, 0.0625, -0.0088),
         center_m=(0.0, 0.005, -0.06)),
    Link("left_shoulder_yaw", "left_shoulder_roll", "z", UPPER_ARM, 0.0, (-1.3, 4.45),
         mass_kg=0.839, box_m=(0.08, 0.08, 0.2), position_m=(0.0, 0.0, -0.1343),
         center_m=(0.01, 0.0, -0.08)),
    # At zero the forearm points forward.
    Link("left_elbow", "left_shoulder_yaw", "y", UPPER_ARM, 1.0, (-1.25, 2.61),
         mass_kg=0.669, box_m=(0.3, 0.06, 0.06), position_m=(0.0185, 0.0, -0.198),
         center_m=(0.15, 0.0, -0.01)),
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
        xy_m={
            "heel_out": (-0.05, 0.035),
            "heel_in": (-0.05, -0.035),
            "toe_out": (0.17, 0.035),
            "toe_in": (0.17, -0.035),
        },
        touch_x_m=0.06,
        touch_m=(0.15, 0.08, 0.04),
    ),
    dress=dress,
)


H1 = BODY.robot(
    name="h1",
    title="Unitree H1",
    policy_joints=10,
    base_height_m=0.977,
    spawn_height_m=0.982,
    footprint_radius_m=0.30,
    camera=ego_camera("torso", (0.12, 0.0, 0.68), 15.0),
    fall=FallThresholds(com_to_foot_m=0.6),
    sources=(
        "masses, link lengths, joint, torque and speed limits: Unitree's published robot "
        "description (unitree_ros, h1.urdf)",
        "fall thresholds, camera height (about 1.66 m, 15° down) and HFOV 90°: VLN-PE",
        *UNITREE_SOURCES,
    ),
)
