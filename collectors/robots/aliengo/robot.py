"""Unitree Aliengo: a 24.6 kg quadruped with twelve joints."""

import mujoco

from ..humanoid import INERTIA_SOURCE, TORQUE_SOURCE, Bodies, Link, Servo, add_links
from ..parts import WALKING, FallThresholds, Foot, ego_camera
from ..shapes import (
    add_camera,
    add_collision,
    add_imu,
    add_servo,
    add_touch,
    set_inertia,
    start_robot,
)
from ..spec import RobotSpec
from .shell import dress_calf, dress_hip, dress_thigh, dress_trunk

LEGS = ("FL", "FR", "RL", "RR")
HIP_X_M, HIP_Y_M = 0.2399, 0.051
ABDUCTION_M = 0.083
LINK_M = 0.25  # thigh and calf
FOOT_RADIUS_M = 0.0265
FRICTIONLOSS_NM = 0.2  # of such actuators; not published, typical, as is their rotor inertia
UPPER = Servo(kp=40.0, kd=2.0, torque_nm=35.3, speed_rad_s=20.0, armature_kg_m2=0.01)
LOWER = Servo(kp=40.0, kd=2.0, torque_nm=44.4, speed_rad_s=15.9, armature_kg_m2=0.01)


def _leg(leg: str) -> tuple[Link, ...]:
    front, left = _signs(leg)
    return (
        # The abduction motor sits on the trunk's end, the thigh motor in the hip: near the axis.
        Link(f"{leg}_hip", "base", "x", UPPER, 0.0, (-1.22, 1.22),
             mass_kg=1.993, box_m=(0.12, 0.1, 0.1),
             position_m=(front * HIP_X_M, left * HIP_Y_M, 0.0),
             center_m=(-0.02 * front, 0.035 * left, 0.0)),
        # The published thigh joint has no limits; here it is limited to one full turn.
        Link(f"{leg}_thigh", f"{leg}_hip", "y", UPPER, 0.8, (-3.14, 3.14),
             mass_kg=0.639, box_m=(0.05, 0.04, 0.26),
             position_m=(0.0, left * ABDUCTION_M, 0.0), center_m=(0.0, 0.0, -0.1)),
        Link(f"{leg}_calf", f"{leg}_thigh", "y", LOWER, -1.5, (-2.775, -0.646),
             mass_kg=0.267, box_m=(0.02, 0.02, 0.25),
             position_m=(0.0, 0.0, -LINK_M), center_m=(0.0, 0.0, -0.135)),
    )  # fmt: skip


def _signs(leg: str) -> tuple[float, float]:
    """Return 1 for a front and a left leg, else −1."""
    return 1.0 if leg[0] == "F" else -1.0, 1.0 if leg[1] == "L" else -1.0


LINKS = tuple(link for leg in LEGS for link in _leg(leg))


def build_aliengo(robot: RobotSpec) -> mujoco.MjSpec:
    """Return the robot alone: collision and visual shapes, servos, sensors, ego camera."""
    spec, base = start_robot(robot)
    set_inertia(base, 13.04, center_m=(0.0, 0.0, 0.0), box_m=(0.55, 0.2, 0.112))
    add_collision(base, "trunk", "box", (0.3, 0.085, 0.056))
    add_collision(base, "head", "capsule", (0.05,), ends=((0.31, -0.03, 0.01), (0.31, 0.03, 0.01)))
    dress_trunk(base)
    add_imu(spec, base)
    add_camera(base, robot.camera)
    bodies = add_links(base, LINKS, FRICTIONLOSS_NM)
    for leg in LEGS:
        _cover_leg(spec, bodies, leg)
    for joint in robot.joints:
        add_servo(spec, joint)
    return spec


def _cover_leg(spec: mujoco.MjSpec, bodies: Bodies, leg: str) -> None:
    front, left = _signs(leg)
    hip, thigh, calf = (bodies[f"{leg}_{part}"] for part in ("hip", "thigh", "calf"))
    ends = ((0.0, left * 0.05, 0.0), (0.0, left * 0.06, 0.0))
    add_collision(hip, f"{leg}_hip", "capsule", (0.046,), ends=ends)
    dress_hip(hip, front=front, left=left)
    ends = ((0.0, 0.0, -0.03), (0.0, 0.0, -0.23))
    add_collision(thigh, f"{leg}_thigh", "capsule", (0.024,), ends=ends)
    dress_thigh(thigh, left)
    ends = ((0.0, 0.0, -0.03), (0.0, 0.0, -0.21))
    add_collision(calf, f"{leg}_calf", "capsule", (0.014,), ends=ends)
    foot = (0.0, 0.0, -LINK_M)
    add_collision(calf, f"{leg}_foot", "sphere", (FOOT_RADIUS_M,), position=foot, sole=True)
    # Its feet hit the floor at up to 2 m/s, 10 mm in a step. A soft layer of 5 mm, half of it above
    # the floor, brakes them before they arrive; they stand on the floor all the same.
    ball = spec.geom(f"{leg}_foot")
    ball.margin, ball.solimp = 0.0025, [0.4, 0.95, 0.005, 0.5, 2.0]
    add_touch(spec, calf, f"{leg}_foot", foot, FOOT_RADIUS_M + 0.005)
    dress_calf(calf)


ALIENGO = RobotSpec(
    name="aliengo",
    title="Unitree Aliengo",
    mass_kg=24.636,
    joints=tuple(link.joint for link in LINKS),
    policy_joints=12,
    action_scale_rad=0.5,
    root_body="base",
    feet=tuple(Foot(f"{leg}_foot", (f"{leg}_foot",)) for leg in LEGS),
    base_height_m=0.36,
    spawn_height_m=0.393,
    footprint_radius_m=0.30,
    # In front of its housing on top of the head, so that the robot never sees its own shell.
    camera=ego_camera("base", (0.372, 0.0, 0.088), 8.0),
    fall=FallThresholds(com_to_foot_m=0.18),
    command_limits=WALKING,
    sources=(
        "masses, link lengths, joint, torque and speed limits: Unitree's published robot "
        "description (unitree_ros, aliengo.urdf)",
        "fall thresholds, camera height (0.40–0.50 m) and HFOV 90°: VLN-PE",
        "PD gains and default pose: common practice of velocity-tracking policies on this robot",
        TORQUE_SOURCE,
        INERTIA_SOURCE,
    ),
    build=build_aliengo,
)
