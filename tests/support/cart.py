"""A stand-in robot for tests of replay: a two-wheeled cart on a free base, and its "gait".

It has what any robot of the registry has (free base, servos, foot geoms with touch sensors, an
IMU, an ego camera), and drives by wheel speeds, so tests need no trained policy.
"""

from functools import partial

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vlnpe.collectors.robots import (
    CameraMount,
    CommandLimits,
    FallThresholds,
    Foot,
    JointFacts,
    RobotSpec,
)
from vlnpe.formats.core.camera import CameraModel

WHEEL_M, TRACK_M, CASTER_M = 0.1, 0.3, 0.05
GAP_M = 0.003  # casters only catch a tilting cart: the wheels must carry it to grip
FEET = ("left_wheel", "right_wheel", "front_caster", "rear_caster")


def build_cart(robot: RobotSpec, mast_kg: float, mast_m: float) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    base = spec.worldbody.add_body(name=robot.root_body)
    base.add_freejoint(name=robot.root_joint)
    sphere, box = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_BOX
    base.add_geom(name="chassis", type=box, size=[0.2, 0.12, 0.05], mass=10.0, pos=[0, 0, 0.05])
    base.add_geom(name="mast", type=sphere, size=[0.05, 0, 0], pos=[0, 0, mast_m], mass=mast_kg)
    for name, x in (("front_caster", 0.17), ("rear_caster", -0.17)):
        base.add_geom(
            name=name,
            type=sphere,
            size=[CASTER_M, 0, 0],
            pos=[x, 0, CASTER_M - WHEEL_M + GAP_M],
            mass=0.1,
            friction=[0.01, 0, 0],
            priority=1,
        )
        _touch(spec, base, name, [x, 0, CASTER_M - WHEEL_M + GAP_M], CASTER_M)
    for name, y in (("left_wheel", TRACK_M / 2), ("right_wheel", -TRACK_M / 2)):
        wheel = base.add_body(name=name, pos=[0, y, 0])
        wheel.add_joint(name=name, axis=[0, 1, 0], damping=0.01, armature=0.03)
        wheel.add_geom(name=name, type=sphere, size=[WHEEL_M, 0, 0], mass=1.0, friction=[1, 0, 0])
        _touch(spec, wheel, name, [0, 0, 0], WHEEL_M)
    for joint in robot.joints:
        servo = spec.add_actuator(
            name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        servo.set_to_velocity(kv=joint.kd)
        servo.forcerange = [-joint.torque_nm, joint.torque_nm]
    base.add_site(name="imu")
    for name, kind in (
        ("gyro", mujoco.mjtSensor.mjSENS_GYRO),
        ("accelerometer", mujoco.mjtSensor.mjSENS_ACCELEROMETER),
    ):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="imu")
    base.add_camera(name="ego", pos=[0.2, 0, 0.2])
    return spec


def _touch(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, pos: list[float], radius: float
) -> None:
    body.add_site(name=name, pos=pos, size=[radius + 0.005, 0, 0])
    spec.add_sensor(
        name=f"{name}_touch",
        type=mujoco.mjtSensor.mjSENS_TOUCH,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=name,
    )


def make_cart(mast_kg: float = 0.1, mast_m: float = 0.4) -> RobotSpec:
    """The cart; a high and heavy mast makes it tip over when it starts or brakes."""
    return RobotSpec(
        name="cart",
        title="Cart",
        mass_kg=12.2 + mast_kg,
        joints=tuple(
            JointFacts(name, 0.0, (-1e9, 1e9), kp=0.0, kd=3.0, torque_nm=40.0)
            for name in ("left_wheel", "right_wheel")
        ),
        policy_joints=2,
        action_scale_rad=1.0,
        root_body="base",
        feet=tuple(Foot(name, (name,)) for name in FEET),
        base_height_m=WHEEL_M,
        spawn_height_m=WHEEL_M,
        footprint_radius_m=0.28,
        camera=CameraMount(
            name="ego",
            body="base",
            position_body_m=(0.2, 0.0, 0.2),
            pitch_down_deg=0.0,
            model=CameraModel("ego", 64, 64, 90.0),
        ),
        fall=FallThresholds(com_to_foot_m=0.02),
        command_limits=CommandLimits(vx_m_s=(-0.3, 1.0), vy_m_s=(0.0, 0.0), yaw_rad_s=(-1.5, 1.5)),
        sources=(),
        build=partial(build_cart, mast_kg=mast_kg, mast_m=mast_m),
    )


class CartGait:
    """Wheel speeds [rad/s] from a velocity command, gently enough not to slip; logs targets."""

    def __init__(self, brisk: float = 1.0) -> None:
        self._step = brisk * np.array([0.08, 0.12])  # m/s and rad/s per 20 ms
        self._speed = np.zeros(2)
        self.reset()

    @property
    def memory(self) -> tuple[NDArray[np.float64], ...]:
        return (self._speed,)

    def reset(self, seed: int | None = None) -> None:
        self._speed[:] = 0.0
        self.targets: list[NDArray[np.float64]] = []

    def act(self, data: mujoco.MjData, command: ArrayLike) -> NDArray[np.float64]:
        wanted = np.asarray(command, dtype=float)[[0, 2]]
        self._speed += np.clip(wanted - self._speed, -self._step, self._step)
        vx, yaw = self._speed
        self.targets.append(np.array([vx - yaw * TRACK_M / 2, vx + yaw * TRACK_M / 2]) / WHEEL_M)
        return self.targets[-1]
