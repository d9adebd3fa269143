"""What is known about a robot, as frozen records."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...formats.core.camera import CameraModel
from .drive import WheelDrive
from .physics import apply_physics_options


@dataclass(frozen=True)
class JointFacts:
    """One actuated joint: limits, default pose and servo.

    Attributes:
        name: joint and actuator name.
        default_rad: default joint position [rad], the zero of the policy's action.
        range_rad: lower and upper limit [rad].
        kp, kd: PD gains of the position servo [Nm/rad], [Nm·s/rad]; for a wheel's velocity servo
            kp is 0 and kd its gain.
        torque_nm: torque limit [Nm].
        speed_rad_s: speed at which the motor has no torque left [rad/s]; inf for a servo that is
            as strong at any speed. See `shapes.add_servo`.
    """

    name: str
    default_rad: float
    range_rad: tuple[float, float]
    kp: float
    kd: float
    torque_nm: float
    speed_rad_s: float = math.inf


@dataclass(frozen=True)
class CameraMount:
    """An onboard camera fixed to a body.

    Attributes:
        name: camera name in the model.
        body: name of the body that carries it.
        position_body_m: (x, y, z) of the optical centre in that body's frame [m].
        pitch_down_deg: downward tilt of the optical axis [deg].
        model: the pinhole camera.
    """

    name: str
    body: str
    position_body_m: tuple[float, float, float]
    pitch_down_deg: float
    model: CameraModel


@dataclass(frozen=True)
class CommandLimits:
    """Range of velocity commands in the base frame (x forward, y left), [m/s] and [rad/s]."""

    vx_m_s: tuple[float, float]
    vy_m_s: tuple[float, float]
    yaw_rad_s: tuple[float, float]

    def clip(self, command: NDArray[np.float64]) -> NDArray[np.float64]:
        """Clip (…, 3) commands (vx, vy, yaw rate) into the limits."""
        limits = np.array([self.vx_m_s, self.vy_m_s, self.yaw_rad_s])
        return np.clip(command, limits[:, 0], limits[:, 1])


@dataclass(frozen=True)
class FallThresholds:
    """A robot has fallen when it leans or sinks beyond these (rule of the VLN-PE paper).

    Attributes:
        roll_rad, pitch_rad: largest absolute lean of the base [rad].
        com_to_foot_m: least height of the centre of mass above the lowest foot [m].
    """

    com_to_foot_m: float
    roll_rad: float = float(np.deg2rad(15.0))
    pitch_rad: float = float(np.deg2rad(35.0))


@dataclass(frozen=True)
class Foot:
    """What a robot stands on: a foot, or a wheel.

    Attributes:
        name: of the foot; its touch sensor is `<name>_touch`.
        soles: names of the spheres that touch the ground, the same number for every foot.
    """

    name: str
    soles: tuple[str, ...]


@dataclass(frozen=True)
class RobotSpec:
    """Facts of one robot and the recipe of its model.

    Attributes:
        name: registry name.
        title: how a person calls it.
        mass_kg: total mass.
        link_mass_kg: mass of each body by body name.
        joints: actuated joints; those that a policy moves come first, in its order.
        policy_joints: how many of them a policy moves; the others follow the gait's reference.
        action_scale_rad: joint target = default + scale × policy action.
        root_body, root_joint: the floating base.
        feet: what it stands on.
        base_height_m: height of the base frame above the floor when it stands settled.
        spawn_height_m: height of the base frame at which the default pose just touches the floor.
        footprint_radius_m: radius of the disc that planners keep free.
        camera: the ego camera.
        fall: when it counts as fallen.
        command_limits: velocities the controllers may ask for.
        sources: where the facts come from, one line each.
        build: makes a fresh `MjSpec` of the robot alone.
        drive: the wheels of a robot that drives; None for one that walks.
        folder: where the files of a user's own robot lie; None for ours.
        content_sha256: of those files; empty for ours, which are part of the code.
    """

    name: str
    title: str
    mass_kg: float
    link_mass_kg: Mapping[str, float]
    joints: tuple[JointFacts, ...]
    policy_joints: int
    action_scale_rad: float
    root_body: str
    root_joint: str
    feet: tuple[Foot, ...]
    base_height_m: float
    spawn_height_m: float
    footprint_radius_m: float
    camera: CameraMount
    fall: FallThresholds
    command_limits: CommandLimits
    sources: tuple[str, ...]
    build: Callable[[RobotSpec], mujoco.MjSpec] = field(repr=False)
    drive: WheelDrive | None = None
    folder: Path | None = None
    content_sha256: str = ""

    def __getstate__(self) -> dict[str, Any]:
        """Worker processes get a copy; a read-only view of a mapping cannot travel."""
        return {**self.__dict__, "link_mass_kg": dict(self.link_mass_kg)}

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the actuated joints, in policy order."""
        return tuple(joint.name for joint in self.joints)

    @property
    def policy_joint_names(self) -> tuple[str, ...]:
        """Names of the joints that a policy moves, in its order."""
        return self.joint_names[: self.policy_joints]

    @property
    def foot_names(self) -> tuple[str, ...]:
        """Names of the feet, in order."""
        return tuple(foot.name for foot in self.feet)

    @property
    def sole_names(self) -> tuple[str, ...]:
        """Names of all geoms that touch the ground, foot by foot."""
        return tuple(name for foot in self.feet for name in foot.soles)

    @property
    def default_joint_rad(self) -> NDArray[np.float64]:
        """(J,) default joint positions [rad]."""
        return np.array([joint.default_rad for joint in self.joints])

    def spec(self) -> mujoco.MjSpec:
        """A fresh, attachable spec of the robot alone, its base at the origin."""
        return self.build(self)

    def build_model(self, floor: bool = True) -> mujoco.MjModel:
        """Compile the robot alone, on an infinite plane at z = 0 unless `floor` is False."""
        spec = self.spec()
        apply_physics_options(spec)
        spec.body(self.root_body).pos = [0.0, 0.0, self.spawn_height_m]
        if floor:
            spec.worldbody.add_geom(
                name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0]
            )
        return spec.compile()

    def physics_hash(self) -> str:
        """SHA-256 over what shapes the robot's motion: options, bodies, joints, servos, contacts.

        What none of our robots has stays out: springs, excluded contacts, meshes, equalities,
        tendons. Colours, cameras and visual shapes do not enter, so that a prettier robot keeps its
        policy; masses, joints, servos and collision shapes do. Values are rounded to six
        significant digits, which leaves room for the last bits of another compiler.
        """
        model = self.build_model(floor=False)
        colliding = model.geom_contype + model.geom_conaffinity > 0
        parts = {
            **{key: getattr(model.opt, key) for key in _OPTION_FIELDS},
            **{key: getattr(model, key) for key in _DYNAMIC_FIELDS},
            **{key: getattr(model, key)[colliding] for key in _COLLISION_FIELDS},
        }
        digest = hashlib.sha256("/".join(self.joint_names).encode())
        for key, value in parts.items():
            text = ",".join(f"{number:.6g}" for number in np.ravel(value) + 0.0)
            digest.update(f"{key}={text};".encode())
        return digest.hexdigest()


_OPTION_FIELDS = ("timestep", "integrator", "cone", "impratio")
_DYNAMIC_FIELDS = (
    "body_parentid",
    "body_pos",
    "body_quat",
    "body_mass",
    "body_ipos",
    "body_iquat",
    "body_inertia",
    "jnt_type",
    "jnt_pos",
    "jnt_axis",
    "jnt_range",
    "dof_armature",
    "dof_damping",
    "dof_frictionloss",
    "actuator_gainprm",
    "actuator_biasprm",
    "actuator_forcerange",
    "actuator_gear",
)
_COLLISION_FIELDS = (
    "geom_bodyid",
    "geom_type",
    "geom_size",
    "geom_pos",
    "geom_quat",
    "geom_friction",
    "geom_solref",
    "geom_solimp",
    "geom_priority",
)
