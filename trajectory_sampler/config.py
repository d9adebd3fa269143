"""Settings of the sampler."""

from dataclasses import dataclass

from ..formats.core.errors import InputError, check_name
from ..formats.scene import FULL_HEIGHT_M

FRECHET, DTW = "frechet", "dtw"
MEASURES = (FRECHET, DTW)
ALONG_PATH, RANDOM = "path", "random"
HEADINGS = (ALONG_PATH, RANDOM)
# Paths on one level, from one level to another, or as many of those as R2R has.
NO, CROSS, MIXED = "no", "cross", "mixed"
CROSS_SHARE = {NO: 0.0, CROSS: 1.0, MIXED: 0.19}


@dataclass(frozen=True)
class SampleConfig:
    """The number and kind of paths to sample.

    Attributes:
        count: how many paths, where no quotas are given.
        split: name written into the episodes, where no quotas are given.
        robot_radius_m: clearance that every point of a path has [m].
        roomy_radius_m: clearance asked for at first; only when the scene does not hold enough
            such paths, tighter ones down to `robot_radius_m` are taken [m].
        free_height_m: free height above every point of a path; less than `FULL_HEIGHT_M` lets
            paths for low robots lead under tables [m].
        climb_height_m: free height above treads, that of the tallest robot that climbs [m].
        end_clearance_m: clearance of starts and goals, room to turn on the spot; a robot that is
            wider has `ends_m` [m].
        clearance_preference: cost of a metre that grazes an obstacle, relative to one in the open.
        comfort_m: clearance beyond the radius above which more is no better [m].
        min_length_m: least geodesic distance from start to goal, as in `info` of the episodes; the
            reference path, which keeps clear of obstacles, is no shorter [m].
        max_length_m: greatest length of the reference path; the geodesic distance is no longer [m].
        typical_length_m: lengths are spread about this one [m] …
        length_spread_m: … with this standard deviation, as far as the scene has such paths [m].
        max_detour: longest reference path relative to the shortest way of the same robot.
        max_turning_deg: greatest sum of a path's turns [deg]; None sets no limit.
        min_crossings: how often a path must pass from one room into another (where there is
            more than one room).
        similarity: how paths are compared: `frechet` or `dtw`.
        min_gap_m: two paths closer than this are too similar [m].
        family_gap_m: paths of different splits are farther apart than this, forward and backward;
            paths of one split closer than this form a similarity group [m].
        relax: where a scene does not hold enough paths, also take closer ones, down to 0.4 m, and
            then ones whose ends face a near wall.
        min_view_m: least depth in the middle of the picture at the start and at the goal [m]; paths
            are cut short where that gives a better view. 0 accepts ends that face a near wall.
        waypoint_spacing_m: greatest distance of reference points [m].
        heading: starts look along the `path` or in a `random` direction.
        heading_noise_rad: starts that look along the path are turned by ± at most this [rad].
        goals_per_start: goals tried from one start before another start is drawn.
        patience: starts drawn in a row without a new path, before giving up.
        storeys: `no`: every path stays on a level; `cross`: every path takes a staircase; `mixed`:
            as many as in R2R do, 19 %. A staircase comes on top of `min_length_m` and the others.
    """

    count: int = 6
    split: str = "train"
    robot_radius_m: float = 0.30
    roomy_radius_m: float = 0.38
    free_height_m: float = FULL_HEIGHT_M
    climb_height_m: float = FULL_HEIGHT_M
    end_clearance_m: float = 0.45
    clearance_preference: float = 3.0
    comfort_m: float = 0.35
    min_length_m: float = 5.0
    max_length_m: float = 20.0
    typical_length_m: float = 9.0
    length_spread_m: float = 3.5
    max_detour: float = 1.3
    max_turning_deg: float | None = None
    min_crossings: int = 1
    similarity: str = FRECHET
    min_gap_m: float = 1.5
    family_gap_m: float = 2.0
    relax: bool = True
    min_view_m: float = 1.0
    waypoint_spacing_m: float = 1.0
    heading: str = ALONG_PATH
    heading_noise_rad: float = 0.25
    goals_per_start: int = 4
    patience: int = 30
    storeys: str = NO

    def __post_init__(self):
        check_name("similarity measure", self.similarity, MEASURES)
        check_name("start heading", self.heading, HEADINGS)
        check_name("choice of --storeys", self.storeys, CROSS_SHARE)
        if self.count < 1:
            raise InputError(f"count is {self.count}; valid: 1 or more")
        if not 0 < self.min_length_m < self.max_length_m:
            raise InputError(
                f"--min-length-m {self.min_length_m:g} and --max-length-m {self.max_length_m:g}; "
                "valid: above 0, and the first below the second"
            )
        if not (self.robot_radius_m > 0 and self.end_clearance_m > 0):
            raise InputError(
                f"robot radius {self.robot_radius_m} m and end clearance {self.end_clearance_m} m; "
                "valid: above 0"
            )
        if not 0 <= self.min_view_m <= 5:
            raise InputError(f"--min-view-m {self.min_view_m:g}; valid: 0 to 5")
        check_free_height(self.free_height_m)
        check_free_height(self.climb_height_m)
        if not (self.min_gap_m > 0 and self.family_gap_m > 0):
            raise InputError(
                f"gaps {self.min_gap_m} m and {self.family_gap_m} m between paths; valid: above 0"
            )
        if self.max_detour < 1 or (self.max_turning_deg is not None and self.max_turning_deg < 0):
            raise InputError(
                f"detour {self.max_detour}, turning {self.max_turning_deg}°; valid: at least 1 "
                "and at least 0"
            )

    @property
    def ends_m(self) -> float:
        """Clearance of starts and goals for this robot [m]."""
        return max(self.end_clearance_m, self.robot_radius_m)


def check_free_height(free_height_m: float) -> None:
    """Raise InputError unless `free_height_m` is above 0 and at most `FULL_HEIGHT_M`."""
    if not 0 < free_height_m <= FULL_HEIGHT_M:
        raise InputError(
            f"free height {free_height_m:g} m; valid: above 0, up to {FULL_HEIGHT_M:g} m"
        )
