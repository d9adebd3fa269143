"""Facts of a robot's parts: joints, feet, wheels, camera and limits, as frozen records."""

import math
from dataclasses import KW_ONLY, dataclass

import numpy as np

from ...formats.core.arrays import Array
from ...formats.core.camera import CameraModel

# Default fraction of a motor's no-load speed up to which it delivers its full torque.
FULL_TORQUE_SPEED = 0.6


@dataclass(frozen=True)
class JointFacts:
    """One actuated joint: limits, default pose and servo.

    Attributes:
        name: name of the joint and of its actuator.
        default_rad: default joint position [rad], the zero of the policy's action.
        range_rad: lower and upper limit [rad].
        kp, kd: PD gains of the position servo [Nm/rad], [Nm·s/rad]. A wheel's velocity servo has
            kp = 0 and the gain kd.
        torque_nm: torque limit [Nm].
        speed_rad_s: no-load speed of the motor, at which it has no torque left [rad/s]; inf for a
            servo whose torque does not depend on speed. See `shapes.add_servo`.
        full_torque_speed: share of that speed up to which it has its full torque.
    """

    name: str
    default_rad: float
    range_rad: tuple[float, float]
    _: KW_ONLY
    kp: float
    kd: float
    torque_nm: float
    speed_rad_s: float = math.inf
    full_torque_speed: float = FULL_TORQUE_SPEED


@dataclass(frozen=True, kw_only=True)
class CameraMount:
    """A camera fixed to a body of the robot.

    Attributes:
        position_body_m: (x, y, z) of the optical centre in that body's frame [m].
        pitch_down_deg: downward tilt of the optical axis [deg].
    """

    name: str
    body: str
    position_body_m: tuple[float, float, float]
    pitch_down_deg: float
    model: CameraModel


def ego_camera(
    body: str, position_body_m: tuple[float, float, float], down_deg: float
) -> CameraMount:
    """Return the camera of the built-in robots: 256 × 256 px, 90° wide."""
    return CameraMount(
        name="ego",
        body=body,
        position_body_m=position_body_m,
        pitch_down_deg=down_deg,
        model=CameraModel("ego", 256, 256, 90.0),
    )


@dataclass(frozen=True, kw_only=True)
class CommandLimits:
    """Range of velocity commands in the base frame (x forward, y left), [m/s] and [rad/s]."""

    vx_m_s: tuple[float, float]
    vy_m_s: tuple[float, float]
    yaw_rad_s: tuple[float, float]

    def clip(self, command: Array) -> Array:
        """Return commands (…, 3) of vx, vy and yaw rate, clipped to the limits."""
        limits = np.array([self.vx_m_s, self.vy_m_s, self.yaw_rad_s])
        return np.clip(command, limits[:, 0], limits[:, 1])


_ANY = (-math.inf, math.inf)
UNLIMITED = CommandLimits(vx_m_s=_ANY, vy_m_s=_ANY, yaw_rad_s=_ANY)
WALKING = CommandLimits(vx_m_s=(-0.3, 1.0), vy_m_s=(-0.3, 0.3), yaw_rad_s=(-1.05, 1.05))


@dataclass(frozen=True, kw_only=True)
class FallThresholds:
    """Limits beyond which a robot counts as fallen (rule of the VLN-PE paper).

    Attributes:
        com_to_foot_m: smallest height of the centre of mass above the lowest foot [m].
        roll_rad, pitch_rad: largest absolute roll and pitch of the base [rad].
    """

    com_to_foot_m: float
    roll_rad: float = float(np.deg2rad(15.0))
    pitch_rad: float = float(np.deg2rad(35.0))


@dataclass(frozen=True)
class Foot:
    """A foot or a wheel that the robot stands on.

    Attributes:
        name: name of the foot; its touch sensor is `<name>_touch`.
        soles: names of the geoms that touch the ground, the same number for every foot.
    """

    name: str
    soles: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class StepRhythm:
    """The rhythm of a user's own walking robot, from which the gait to be trained is derived.

    Attributes:
        frequency_hz: gait cycles per second.
        foot_offsets: (F,) phase offset of each foot in cycles; a foot swings during the first half
            of its cycle.
        swing_height_m: height of a foot's arc above the ground.
    """

    frequency_hz: float
    foot_offsets: tuple[float, ...]
    swing_height_m: float


@dataclass(frozen=True, kw_only=True)
class WheelDrive:
    """A differential drive: wheels on two sides, turned by velocity servos.

    Attributes:
        left, right: names of the wheel joints on either side; positive speed drives forward.
        wheel_radius_m: radius of all wheels [m].
        track_m: distance between the contact points of the two sides [m].
        ramp_m_s2, ramp_rad_s2: rate limits of speed and turn rate, low enough that the robot
            neither slips nor tips.
    """

    left: tuple[str, ...]
    right: tuple[str, ...]
    wheel_radius_m: float
    track_m: float
    ramp_m_s2: float
    ramp_rad_s2: float
