"""The expert: VLN-CE's next discrete action from any true pose toward an episode's reference path.

The controllers of discrete actions execute its choice, robots that follow their path continuously
are labelled with it, and it can be queried online, at poses that no recorded robot was in.
"""

import math
from dataclasses import dataclass

from ...formats.core.rollout import FORWARD_STEP_M, TURN_STEP_RAD, Action
from .geometry import RouteCursor, wrap_angle
from .interface import Pose, Task
from .route import STEP_M, Route, plan_route, rejoin


@dataclass(frozen=True)
class ExpertConfig:
    """Parameters of the expert.

    Attributes:
        lookahead_m: distance along the route to the point aimed at.
        stop_within_m: distance to the goal at which it stops at once.
        goal_tolerance_m: at the end of the route a stop this near is good enough.
        replan_off_m: distance from the route beyond which a way back to it is planned.
        rejoin_m: that way meets the route so far ahead.
    """

    lookahead_m: float = 0.5
    stop_within_m: float = 0.1
    goal_tolerance_m: float = 0.2
    replan_off_m: float = 0.5
    rejoin_m: float = 1.0


class Expert:
    """Chooses every action from the true pose, so that drift does not accumulate.

    One object serves one episode: it keeps the progress along the route and the sense of the last
    turn.

    Attributes:
        stairs_m: length of the part of the route that leads over stairs [m].
    """

    def __init__(self, task: Task, config: ExpertConfig = ExpertConfig()) -> None:
        """Plan the route along the task's reference path."""
        self._task, self._config = task, config
        self.route: Route = plan_route(task.freemap, task.reference_xy_m, task.radius_m)
        self._cursor = RouteCursor(self.route.xy_m, STEP_M)
        self._last = Action.FORWARD
        self._notes = [("unplannable", problem) for problem in self.route.problems]

    stairs_m = 0.0

    def notes(self) -> list[tuple[str, str]]:
        """Return events (kind, detail) since the last call: re-plans and unplannable segments."""
        notes, self._notes = self._notes, []
        return notes

    @property
    def length_m(self) -> float:
        """Length of the route on level ground [m]."""
        return self.route.length_m

    @property
    def turning_rad(self) -> float:
        """Sum of all changes of direction of the route [rad]."""
        return self.route.turning_rad

    @property
    def remaining_m(self) -> float:
        """Length of the route ahead of the pose asked about last [m]."""
        return (self._cursor.last - self._cursor.index) * STEP_M

    def next_action(self, pose: Pose, rest: Pose | None = None) -> Action:
        """Return the action to take from `pose`.

        Turns while the bearing of the point ahead is off by more than half a turn action (a whole
        one to turn back at once), walks otherwise, and stops when the goal is near, or when the
        next step would lead past it. A pose too far from the route is led back to it.

        Args:
            pose: where the agent is.
            rest: where a moving body would come to rest if it stopped now; `pose` when None.
        """
        rest = rest or pose
        config = self._config
        self._locate(pose)
        goal_x, goal_y = self._cursor.point(self._cursor.last)
        to_goal_m = math.hypot(goal_x - rest.x_m, goal_y - rest.y_m)
        if to_goal_m <= config.stop_within_m:
            return Action.STOP
        x, y = self._cursor.point(self._cursor.ahead(config.lookahead_m, STEP_M))
        error = wrap_angle(math.atan2(y - pose.y_m, x - pose.x_m) - pose.yaw_rad)
        if to_goal_m <= config.goal_tolerance_m:
            after_m = math.hypot(
                goal_x - rest.x_m - FORWARD_STEP_M * math.cos(rest.yaw_rad),
                goal_y - rest.y_m - FORWARD_STEP_M * math.sin(rest.yaw_rad),
            )
            if after_m >= to_goal_m:
                return Action.STOP
        # A body keeps some of its turn; answering that with the opposite turn would go on for ever.
        left = TURN_STEP_RAD if self._last is Action.RIGHT else 0.5 * TURN_STEP_RAD
        right = TURN_STEP_RAD if self._last is Action.LEFT else 0.5 * TURN_STEP_RAD
        if error > left:
            self._last = Action.LEFT
        elif error < -right:
            self._last = Action.RIGHT
        else:
            self._last = Action.FORWARD
        return self._last

    def _locate(self, pose: Pose) -> None:
        """Find the pose's place on the route, or a way back to the route."""
        off_m = self._cursor.advance(pose.x_m, pose.y_m)
        if off_m <= self._config.replan_off_m:
            return
        ahead = self._cursor.ahead(self._config.rejoin_m, STEP_M)
        back = rejoin(self._task.freemap, pose, self._cursor.xy_m[ahead:], self._task.radius_m)
        if back is not None:
            self._notes.append(("replan", f"{off_m:.2f} m off the route"))
            self._cursor = RouteCursor(back.xy_m, STEP_M)
