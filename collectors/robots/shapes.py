"""Functions that build robots of primitive shapes with `MjSpec`."""

import math
from collections.abc import Sequence

import mujoco
import numpy as np

from .parts import CameraMount, JointFacts
from .spec import RobotSpec

Vector = Sequence[float]
Color = tuple[float, float, float]

VISUAL_GROUP = 2
COLLISION_GROUP = 3
SOLE_TIME_S = 0.01  # of a walker's contacts, the shortest that is stable at steps of 5 ms
POSITION_INPUT = 1  # MuJoCo's mjINPUT_POS, which its Python module does not name
_GEOM = mujoco.mjtGeom
SHAPES = {
    "box": _GEOM.mjGEOM_BOX,
    "capsule": _GEOM.mjGEOM_CAPSULE,
    "cylinder": _GEOM.mjGEOM_CYLINDER,
    "ellipsoid": _GEOM.mjGEOM_ELLIPSOID,
    "sphere": _GEOM.mjGEOM_SPHERE,
}


def _placement(
    position: Vector | None, ends: tuple[Vector, Vector] | None, euler_deg: Vector | None
) -> dict[str, object]:
    placement: dict[str, object] = {}
    if ends is not None:
        placement["fromto"] = [*ends[0], *ends[1]]
    else:
        placement["pos"] = list(position or (0.0, 0.0, 0.0))
    if euler_deg is not None:
        quat = np.zeros(4)
        mujoco.mju_euler2Quat(quat, np.deg2rad(euler_deg), "xyz")
        placement["quat"] = quat
    return placement


def start_robot(robot: RobotSpec) -> tuple[mujoco.MjSpec, mujoco.MjsBody]:
    """Return an empty model in radians with the robot's name, and its floating base."""
    spec = mujoco.MjSpec()
    spec.modelname = robot.name
    spec.compiler.degree = False
    base = spec.worldbody.add_body(name=robot.root_body)
    base.add_freejoint(name=robot.root_joint)
    return spec, base


def add_visual(
    body: mujoco.MjsBody,
    shape: str,
    size: Vector,
    color: Color,
    position: Vector | None = None,
    *,
    ends: tuple[Vector, Vector] | None = None,
    euler_deg: Vector | None = None,
) -> None:
    """Add a massless geom that is drawn but does not collide.

    Args:
        shape: key of `SHAPES`.
        size: MuJoCo half sizes [m]; for capsule and cylinder with `ends` only the radius.
        color: linear RGB in 0…1.
        position: centre in the body frame [m].
        ends: both ends of the axis of a capsule or cylinder [m], instead of `position`.
        euler_deg: intrinsic x-y-z rotation [deg].
    """
    body.add_geom(
        type=SHAPES[shape],
        size=_padded(size),
        rgba=[*color, 1.0],
        group=VISUAL_GROUP,
        contype=0,
        conaffinity=0,
        mass=0.0,
        **_placement(position, ends, euler_deg),
    )


def add_collision(
    body: mujoco.MjsBody,
    name: str,
    shape: str,
    size: Vector,
    position: Vector | None = None,
    *,
    ends: tuple[Vector, Vector] | None = None,
    foot: bool = False,
    sole: bool = False,
) -> None:
    """Add a massless geom that collides but is not drawn; see `add_visual`.

    With `foot`, the geom's own friction decides that of its contacts; `sole` is a walker's foot,
    whose contacts are stiffer, so that it does not sink
    into the floor.
    """
    foot |= sole
    body.add_geom(
        name=name,
        type=SHAPES[shape],
        size=_padded(size),
        rgba=[0.9, 0.3, 0.3, 0.4],
        group=COLLISION_GROUP,
        contype=1,
        conaffinity=1,
        condim=3,
        mass=0.0,
        # A rubber foot on any indoor floor: priority makes MuJoCo use the foot's friction alone.
        priority=1 if foot else 0,
        friction=[0.8, 0.02, 0.01] if foot else [0.6, 0.02, 0.01],
        **({"solref": [SOLE_TIME_S, 1.0]} if sole else {}),
        **_placement(position, ends, None),
    )


def set_inertia(body: mujoco.MjsBody, mass_kg: float, *, center_m: Vector, box_m: Vector) -> None:
    """Give a body the mass and inertia of a uniform box of full sides `box_m` at `center_m`."""
    x, y, z = (side**2 for side in box_m)
    body.explicitinertial = True
    body.mass = mass_kg
    body.ipos = list(center_m)
    body.inertia = [mass_kg / 12 * (y + z), mass_kg / 12 * (x + z), mass_kg / 12 * (x + y)]


def add_joint(
    body: mujoco.MjsBody,
    facts: JointFacts,
    axis: Vector,
    *,
    armature_kg_m2: float,
    frictionloss_nm: float,
) -> None:
    """Add a limited hinge at the body's origin."""
    body.add_joint(
        name=facts.name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=list(axis),
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        range=list(facts.range_rad),
        armature=armature_kg_m2,
        frictionloss=frictionloss_nm,
    )


def add_servo(spec: mujoco.MjSpec, facts: JointFacts) -> None:
    """Add a PD position servo with its motor's limits: force = kp (ctrl − q) − kd q̇, ctrl in rad.

    The torque is limited to `torque_nm`. Beyond `full_torque_speed` of the motor's no-load speed
    the limit falls linearly to zero at that speed, as the supply voltage makes it in a DC motor;
    braking is not limited further. MuJoCo's `dcmotor` computes this when its constants are chosen
    so that 1 V is 1 rad/s.
    """
    servo = _add_actuator(spec, facts)
    if math.isinf(facts.speed_rad_s):
        servo.set_to_position(kp=facts.kp, kv=facts.kd)
        return
    servo.set_to_dcmotor(
        motorconst=[1.0, 1.0],
        resistance=(1.0 - facts.full_torque_speed) * facts.speed_rad_s / facts.torque_nm,
        controller=[facts.kp, 0.0, facts.kd, 0.0, 0.0, facts.speed_rad_s],
        ctrlspec=POSITION_INPUT,
    )


def add_wheel(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, facts: JointFacts, armature_kg_m2: float
) -> None:
    """Add a hinge about the body's y axis with a torque-limited velocity servo, ctrl in rad/s."""
    body.add_joint(
        name=facts.name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0.0, 1.0, 0.0],
        armature=armature_kg_m2,
    )
    _add_actuator(spec, facts).set_to_velocity(kv=facts.kd)


def _add_actuator(spec: mujoco.MjSpec, facts: JointFacts) -> mujoco.MjsActuator:
    return spec.add_actuator(
        name=facts.name,
        target=facts.name,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        forcelimited=mujoco.mjtLimited.mjLIMITED_TRUE,
        forcerange=[-facts.torque_nm, facts.torque_nm],
    )


def add_camera(body: mujoco.MjsBody, mount: CameraMount) -> None:
    """Fix a camera to `body`, looking along +x tilted down by the mount's pitch."""
    pitch = np.deg2rad(mount.pitch_down_deg)
    right = np.array([0.0, -1.0, 0.0])
    up = np.array([np.sin(pitch), 0.0, np.cos(pitch)])
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.column_stack([right, up, np.cross(right, up)]).ravel())
    aspect = mount.model.height_px / mount.model.width_px
    half_width = np.tan(0.5 * np.deg2rad(mount.model.hfov_deg))
    body.add_camera(
        name=mount.name,
        pos=list(mount.position_body_m),
        quat=quat,
        fovy=float(np.rad2deg(2 * np.arctan(aspect * half_width))),
        resolution=[mount.model.width_px, mount.model.height_px],
    )


def add_imu(spec: mujoco.MjSpec, body: mujoco.MjsBody) -> None:
    """Add the site `imu` at the body's origin with the sensors `gyro` and `accelerometer`."""
    body.add_site(name="imu", group=4)
    for name, kind in (
        ("gyro", mujoco.mjtSensor.mjSENS_GYRO),
        ("accelerometer", mujoco.mjtSensor.mjSENS_ACCELEROMETER),
    ):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="imu")


def add_touch(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    foot: str,
    position: Vector,
    size_m: float | Vector,
) -> None:
    """Add a touch sensor `<foot>_touch` [N]: a sphere of that radius or a box of half sides."""
    size = [size_m, 0.0, 0.0] if isinstance(size_m, float | int) else list(size_m)
    shape = "box" if all(size) else "sphere"
    body.add_site(name=foot, type=SHAPES[shape], pos=list(position), size=size, group=4)
    spec.add_sensor(
        name=f"{foot}_touch",
        type=mujoco.mjtSensor.mjSENS_TOUCH,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=foot,
    )


def _padded(size: Vector) -> list[float]:
    return [*size, *[0.0] * (3 - len(size))]
