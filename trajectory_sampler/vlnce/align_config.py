"""Thresholds by which VLN-CE episodes are fitted into a scene."""

from dataclasses import dataclass

from ...formats.core.errors import InputError
from ...formats.scene import FULL_HEIGHT_M
from ..config import check_free_height


@dataclass(frozen=True)
class AlignConfig:
    """Tolerances of the alignment.

    Attributes:
        split: name written into the episodes; None takes it from the file's name.
        robot_radius_m: clearance that starts, goals and paths need: the footprint of the widest
            robot that will walk them [m].
        free_height_m: free height that they need; less than `FULL_HEIGHT_M` lets low robots pass
            under tables [m].
        climb_height_m: free height above treads, that of the tallest robot that climbs [m].
        max_start_nudge_m: farthest that a start in collision may be moved [m].
        max_goal_nudge_m: farthest that a goal may be moved; no farther than a start [m].
        goal_beyond_start: let a path's goal be moved farther than its own start is. By default such
            a path is rejected: moving the goal changes the task, moving the start hardly does.
        max_waypoint_nudge_m: farthest that an inner waypoint may be moved; one that would need more
            is bypassed [m].
        max_bypassed_share: greatest share of the inner waypoints that may be bypassed.
        max_floor_gap_m: farthest that a point may float above or lie below its floor [m].
        recorded_snap_m: changes of height above this are recorded point by point [m].
        waypoint_spacing_m: of points put in where the straight way is blocked [m].
        keep_climbable: also align paths over one climbable staircase; they then follow its middle
            line.
    """

    split: str | None = None
    robot_radius_m: float = 0.30
    free_height_m: float = FULL_HEIGHT_M
    climb_height_m: float = FULL_HEIGHT_M
    max_start_nudge_m: float = 0.5
    max_goal_nudge_m: float = 0.5
    goal_beyond_start: bool = False
    max_waypoint_nudge_m: float = 0.5
    max_bypassed_share: float = 0.5
    max_floor_gap_m: float = 1.0
    recorded_snap_m: float = 0.03
    waypoint_spacing_m: float = 1.0
    keep_climbable: bool = False

    def __post_init__(self):
        if not 0 <= self.max_goal_nudge_m <= self.max_start_nudge_m:
            raise InputError(
                f"goals may be moved by {self.max_goal_nudge_m:g} m and starts by "
                f"{self.max_start_nudge_m:g} m; valid: 0 ≤ goals ≤ starts"
            )
        if not self.robot_radius_m > 0:
            raise InputError(f"robot radius {self.robot_radius_m:g} m; valid: above 0")
        check_free_height(self.free_height_m)
        check_free_height(self.climb_height_m)
