"""What to sample."""

from __future__ import annotations

from dataclasses import dataclass

from ..formats.core.errors import InputError


@dataclass(frozen=True)
class SampleConfig:
    """What to sample.

    Attributes:
        count: how many episodes.
        split: name written into the episodes.
        robot_radius_m: clearance that every point of a path has [m].
        roomy_radius_m: clearance asked for at first; only when the scene does not hold enough
            such episodes, tighter ones down to `robot_radius_m` are taken [m].
        end_clearance_m: clearance of starts and goals, room to turn on the spot [m].
        clearance_preference: how many times longer a metre feels when it grazes an obstacle.
        comfort_m: clearance beyond the radius from which on more is no better [m].
        min_length_m: least geodesic distance from start to goal, as in `info` of the episodes; the
            reference path, which keeps clear of obstacles, is no shorter [m].
        max_length_m: greatest length of the reference path; the geodesic distance is no longer [m].
        max_detour: longest reference path relative to the geodesic distance.
        min_crossings: how often a path must pass from one room into another (where there is
            more than one room).
        min_gap_m: two paths closer than this on average are too similar; less, down to 0.4 m, is
            taken where a scene does not hold enough such paths [m].
        waypoint_spacing_m: greatest distance of reference waypoints [m].
        heading_noise_rad: starts look along the path, ± at most this [rad].
        goals_per_start: goals tried from one start before another start is drawn.
        patience: starts drawn in a row without a new episode, before giving up.
    """

    count: int = 6
    split: str = "train"
    robot_radius_m: float = 0.30
    roomy_radius_m: float = 0.38
    end_clearance_m: float = 0.45
    clearance_preference: float = 3.0
    comfort_m: float = 0.35
    min_length_m: float = 5.0
    max_length_m: float = 20.0
    max_detour: float = 1.3
    min_crossings: int = 1
    min_gap_m: float = 1.5
    waypoint_spacing_m: float = 1.0
    heading_noise_rad: float = 0.25
    goals_per_start: int = 4
    patience: int = 30

    def __post_init__(self):
        if self.count < 1:
            raise InputError(f"count is {self.count}; valid: 1 or more")
        if not 0 < self.min_length_m < self.max_length_m:
            raise InputError(
                f"lengths {self.min_length_m} … {self.max_length_m} m; valid: 0 < min < max"
            )
        if not 0 < self.robot_radius_m <= self.end_clearance_m:
            raise InputError(
                f"robot radius {self.robot_radius_m} m and end clearance {self.end_clearance_m} m; "
                "valid: 0 < radius ≤ end clearance"
            )
