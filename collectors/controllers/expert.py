"""The expert that turns a route and a true pose into the next discrete action."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...formats.core.rollout import Action
from .geometry import RouteCursor, wrap_angle
from .interface import Pose
from .route import STEP_M, Route

FORWARD_M = 0.25
TURN_RAD = math.radians(15.0)


@dataclass(frozen=True)
class ExpertConfig:
    """How the expert chooses.

    Attributes:
        lookahead_m: distance along the route to the point aimed at.
        stop_within_m: distance to the goal at which it stops at once.
        goal_tolerance_m: at the end of the route a stop this near is good enough.
    """

    lookahead_m: float = 0.5
    stop_within_m: float = 0.1
    goal_tolerance_m: float = 0.15


class Expert:
    """Closes the loop on the true pose with every action, so that drift never accumulates."""

    def __init__(self, route: Route, config: ExpertConfig) -> None:
        self._config = config
        self._cursor = RouteCursor(route.xy_m, STEP_M)
        self._off_m = 0.0
        self._last = Action.FORWARD

    @property
    def off_route_m(self) -> float:
        """Distance to the route at the last choice [m]."""
        return self._off_m

    def next_action(self, pose: Pose) -> Action:
        """The action to take from `pose`.

        Turns while the bearing of the point ahead is off by more than half a turn action (a whole
        one to turn back at once), walks otherwise, and stops when the goal is near, or when the
        next step would lead past it.
        """
        config = self._config
        self._off_m = self._cursor.advance(pose.x_m, pose.y_m)
        goal_x, goal_y = self._cursor.point(self._cursor.last)
        to_goal_m = math.hypot(goal_x - pose.x_m, goal_y - pose.y_m)
        if to_goal_m <= config.stop_within_m:
            return Action.STOP
        x, y = self._cursor.point(self._cursor.ahead(config.lookahead_m, STEP_M))
        error = wrap_angle(math.atan2(y - pose.y_m, x - pose.x_m) - pose.yaw_rad)
        if to_goal_m <= config.goal_tolerance_m:
            after_m = math.hypot(
                goal_x - pose.x_m - FORWARD_M * math.cos(pose.yaw_rad),
                goal_y - pose.y_m - FORWARD_M * math.sin(pose.yaw_rad),
            )
            if after_m >= to_goal_m:
                return Action.STOP
        # A body keeps some of its turn; answering that with the opposite turn would go on for ever.
        left = TURN_RAD if self._last is Action.RIGHT else 0.5 * TURN_RAD
        right = TURN_RAD if self._last is Action.LEFT else 0.5 * TURN_RAD
        if error > left:
            self._last = Action.LEFT
        elif error < -right:
            self._last = Action.RIGHT
        else:
            self._last = Action.FORWARD
        return self._last
