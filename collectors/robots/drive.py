"""Facts of a robot that drives on wheels instead of walking."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WheelDrive:
    """A differential drive: wheels on two sides, turned by velocity servos.

    Attributes:
        left, right: names of the wheel joints on either side; forward turns them about +y.
        wheel_radius_m: of all wheels [m].
        track_m: distance between the contact points of the two sides [m].
        ramp_m_s2, ramp_rad_s2: how fast speed and turn rate change; gently enough that the robot
            neither slips nor tips.
    """

    left: tuple[str, ...]
    right: tuple[str, ...]
    wheel_radius_m: float
    track_m: float
    ramp_m_s2: float
    ramp_rad_s2: float
