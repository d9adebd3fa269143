"""Unitree Aliengo: a 24.6 kg quadruped with twelve joints."""

import mujoco

from ..humanoid import INERTIA_SOURCE, TORQUE_SOURCE
from ..parts import WALKING, FallThresholds, Foot, JointFacts, ego_camera
from ..shapes import (
    add_camera,
    add_collision,
    add_imu,
    add_joint,
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
BASE_KG, HIP_KG, THIGH_KG, CALF_KG = 13.04, 1.993, 0.639, 0.267
LINK_M = 0.25  # thigh and calf
FOOT_RADIUS_M = 0.0265
# Rotor inertia seen through the gears and dry friction of such actuators; not published, typical.
ARMATURE_KG_M2 = 0.01
FRICTIONLOSS_NM = 0.2


def _leg_joints(leg: str) -> tuple[JointFacts, ...]:
    upper = {"kp": 40.0, "kd": 2.0, "torque_nm": 35.3, "speed_rad_s": 20.0}
    lower = {"kp": 40.0, "kd": 2.0, "torque_nm": 44.4, "speed_rad_s": 15.9}
    return (
        JointFacts(f"{leg}_hip_joint", 0.0, (-1.22, 1.22), **upper),
        # The published thigh joint has no limits; here it is limited to one full turn.
        JointFacts(f"{leg}_thigh_joint", 0.8, (-3.14, 3.14), **upper),
        JointFacts(f"{leg}_calf_joint", -1.5, (-2.775, -0.646), **lower),
    )


def build_aliengo(robot: RobotSpec) -> mujoco.MjSpec:
    """Return the robot alone: collision and visual shapes, servos, sensors, ego camera."""
    spec, base = start_robot(robot)
    set_inertia(base, BASE_KG, center_m=(0.0, 0.0, 0.0), box_m=(0.55, 0.2, 0.112))
    add_collision(base, "trunk", "box", (0.3, 0.085, 0.056))
    add_collision(base, "head", "capsule", (0.05,), ends=((0.31, -0.03, 0.01), (0.31, 0.03, 0.01)))
    dress_trunk(base)
    add_imu(spec, base)
    add_camera(base, robot.camera)
    facts = {joint.name: joint for joint in robot.joints}
    for leg in LEGS:
        _add_leg(spec, base, leg, facts)
    for joint in robot.joints:
        add_servo(spec, joint)
    return spec


def _add_leg(
    spec: mujoco.MjSpec,
    base: mujoco.MjsBody,
    leg: str,
    facts: dict[str, JointFacts],
) -> None:
    front = 1.0 if leg[0] == "F" else -1.0
    left = 1.0 if leg[1] == "L" else -1.0

    def joint(body: mujoco.MjsBody, part: str, axis: tuple[float, float, float]) -> None:
        add_joint(
            body,
            facts[f"{leg}_{part}_joint"],
            axis,
            armature_kg_m2=ARMATURE_KG_M2,
            frictionloss_nm=FRICTIONLOSS_NM,
        )

    hip = base.add_body(name=f"{leg}_hip", pos=[front * HIP_X_M, left * HIP_Y_M, 0.0])
    joint(hip, "hip", (1.0, 0.0, 0.0))
    # The abduction motor sits on the trunk's end, the thigh motor in the hip: both near the axis.
    hip_center = (-0.02 * front, 0.035 * left, 0.0)
    set_inertia(hip, HIP_KG, center_m=hip_center, box_m=(0.12, 0.1, 0.1))
    add_collision(
        hip,
        f"{leg}_hip",
        "capsule",
        (0.046,),
        ends=((0.0, left * 0.05, 0.0), (0.0, left * 0.06, 0.0)),
    )
    dress_hip(hip, front=front, left=left)

    thigh = hip.add_body(name=f"{leg}_thigh", pos=[0.0, left * ABDUCTION_M, 0.0])
    joint(thigh, "thigh", (0.0, 1.0, 0.0))
    thigh_center = (0.0, 0.0, -0.1)
    set_inertia(thigh, THIGH_KG, center_m=thigh_center, box_m=(0.05, 0.04, 0.26))
    add_collision(
        thigh, f"{leg}_thigh", "capsule", (0.024,), ends=((0.0, 0.0, -0.03), (0.0, 0.0, -0.23))
    )
    dress_thigh(thigh, left)

    calf = thigh.add_body(name=f"{leg}_calf", pos=[0.0, 0.0, -LINK_M])
    joint(calf, "calf", (0.0, 1.0, 0.0))
    set_inertia(
        calf,
        CALF_KG,
        center_m=(0.0, 0.0, -0.135),
        box_m=(0.02, 0.02, 0.25),
    )
    add_collision(
        calf, f"{leg}_calf", "capsule", (0.014,), ends=((0.0, 0.0, -0.03), (0.0, 0.0, -0.21))
    )
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
    joints=tuple(joint for leg in LEGS for joint in _leg_joints(leg)),
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
