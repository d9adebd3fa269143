"""Move-along-path: follow the reference path with pure pursuit and VLN-PE's proportional gains.

Every control step aims at a point of the route some way ahead (pure pursuit), never through an
obstacle; the turn rate is proportional to the heading error (gain 2.5), speed is limited by the
distance to the goal (gain 1.5), by the curves ahead and by the heading error. Large heading errors
are corrected by turning on the spot. A lasting error of the robot's velocity is learned from its
poses and absorbed. A robot pushed off its route, or one that makes no progress, backs off if needed
and re-plans on the freemap.
"""

import math
from dataclasses import dataclass

import numpy as np

from .geometry import RouteCursor, clip, clip_command, wrap_angle
from .interface import STOPPED, Command, Decision, Pose, Task
from .route import STEP_M, Route, plan_route, rejoin
from .trim import VelocityTrim

NEAR_M = 0.15  # the point so far ahead is aimed at even out of sight


@dataclass(frozen=True)
class PathConfig:
    """Parameters of path following.

    Attributes:
        linear_gain, angular_gain: VLN-PE's proportional gains [1/s].
        goal_threshold_m: the robot stops this close to the goal, VLN-PE's threshold [m].
        cruise_m_s: speed on straight, open ground.
        lookahead_m: distance along the route to the point aimed at.
        lateral_gain: sideways correction of the distance from the route [1/s], for robots that
            can step sideways.
        lateral_m_s: greatest sideways speed.
        turn_on_spot_rad, turn_until_rad: heading errors at which turning on the spot begins, ends.
        curve_yaw_rad_s: curves are taken no faster than this turn rate allows.
        decelerate_m_s2: how early the robot slows down.
        replan_off_m: distance from the route beyond which a new one is planned.
        replan_heading_rad, replan_heading_s: heading error that, lasting this long, does so too.
        replan_every_s: shortest time between two plans.
        rejoin_m: a new plan leads back to the route this far ahead.
        blocked_s, blocked_m: less progress than this in that time means blocked.
        back_off_s, back_off_m_s: what a blocked robot does before it re-plans.
        trim_s, trim_m_s: time constant and greatest size of the correction of velocities; see
            `VelocityTrim`.
        trim_stop_s: the error, corrected no more, carries a robot that stops for so long.
    """

    linear_gain: float = 1.5
    angular_gain: float = 2.5
    goal_threshold_m: float = 0.15
    cruise_m_s: float = 0.8
    lookahead_m: float = 0.45
    lateral_gain: float = 2.0
    lateral_m_s: float = 0.25
    turn_on_spot_rad: float = math.radians(50.0)
    turn_until_rad: float = math.radians(15.0)
    curve_yaw_rad_s: float = 0.5
    decelerate_m_s2: float = 0.6
    replan_off_m: float = 0.5
    replan_heading_rad: float = math.radians(30.0)
    replan_heading_s: float = 4.0
    replan_every_s: float = 2.0
    rejoin_m: float = 1.0
    blocked_s: float = 3.0
    blocked_m: float = 0.1
    back_off_s: float = 1.0
    back_off_m_s: float = 0.2
    trim_s: float = 2.0
    trim_m_s: float = 0.15
    trim_stop_s: float = 1.0


class PathController:
    """See the module; satisfies `Controller`."""

    def __init__(self, task: Task, config: PathConfig) -> None:
        self._task, self._config = task, config
        self._clearance = task.freemap.clearance_m
        route = plan_route(task.freemap, task.reference_xy_m, task.radius_m)
        self._notes = [("unplannable", problem) for problem in route.problems]
        self._follow(route)
        self._route_length_m, self._turning_rad = route.length_m, route.turning_rad
        self._turning = False
        self._heading_ok_s = 0.0
        self._planned_s = -math.inf
        self._progress = (0.0, -math.inf)  # time, remaining distance when progress was last made
        self._back_off_until_s = -math.inf
        self._trim = VelocityTrim(
            task.coasting.lag_s, self.rate_hz, time_s=config.trim_s, most_m_s=config.trim_m_s
        )

    rate_hz = 25  # a body answers no faster, and each step costs 10 µs or more

    @property
    def nominal_s(self) -> float:
        """Time of the route at cruising speed, all its turns, and one turn at the start."""
        config = self._config
        turns = (self._turning_rad + math.pi / 2) / config.curve_yaw_rad_s
        cruise_m_s = min(config.cruise_m_s, self._task.limits.vx_m_s[1])
        return self._route_length_m / cruise_m_s + turns

    def step(self, time_s: float, pose: Pose) -> Decision:
        """See `Controller.step`."""
        config = self._config
        off_m = self._cursor.advance(pose.x_m, pose.y_m)
        goal_x, goal_y = self._task.goal_xy_m
        x_m, y_m = self._trim.carried(pose, config.trim_stop_s)
        to_goal_m = math.hypot(goal_x - x_m, goal_y - y_m)
        if self._arrived(to_goal_m):
            return self._decide(STOPPED, done=True)
        if time_s < self._back_off_until_s:
            return self._decide(self._trimmed(pose, (-config.back_off_m_s, 0.0, 0.0)))
        target = self._target(pose)
        error = wrap_angle(math.atan2(target[1] - pose.y_m, target[0] - pose.x_m) - pose.yaw_rad)
        if abs(error) < config.replan_heading_rad:
            self._heading_ok_s = time_s
        reason = self._why_replan(time_s, off_m)
        if reason:
            self._replan(time_s, pose, reason)
        return self._decide(self._trimmed(pose, self._velocity(pose, target, error, to_goal_m)))

    def _trimmed(self, pose: Pose, command: Command) -> Command:
        return clip_command(self._trim.corrected(pose, command), self._task.limits)

    def _arrived(self, to_goal_m: float) -> bool:
        if to_goal_m <= self._config.goal_threshold_m:
            return True
        # Beside the goal at the route's end: one more turn would not come nearer by much.
        at_end = self._cursor.index == self._cursor.last
        return at_end and to_goal_m <= 0.8 * self._task.goal_tolerance_m

    def _target(self, pose: Pose) -> tuple[float, float]:
        """Return the farthest point of the route within the lookahead that is in free sight."""
        cursor, task = self._cursor, self._task
        # A robot off its line is in a tighter spot already; it may come back along that.
        needed_m = task.radius_m - task.freemap.grid.cell_m
        nearest = cursor.ahead(NEAR_M, STEP_M)
        farthest = max(cursor.ahead(self._config.lookahead_m, STEP_M), nearest)
        return cursor.point(
            cursor.in_sight(
                (pose.x_m, pose.y_m),
                farthest=farthest,
                nearest=nearest,
                clearance_m=self._clearance,
                needed_m=needed_m,
                grid=task.freemap.grid,
            )
        )

    def _velocity(
        self, pose: Pose, target: tuple[float, float], error: float, to_goal_m: float
    ) -> Command:
        config, limits = self._config, self._task.limits
        yaw_rate = clip(config.angular_gain * error, *limits.yaw_rad_s)
        self._turning = abs(error) > (
            config.turn_until_rad if self._turning else config.turn_on_spot_rad
        )
        if self._turning:
            return 0.0, 0.0, yaw_rate
        speed = min(
            self._speed_limit[self._cursor.index],
            math.inf if self._task.passes_on else config.linear_gain * to_goal_m,
            config.cruise_m_s * max(0.0, math.cos(error)) ** 2,
        )
        px, py = self._cursor.point(self._cursor.index)
        left = -math.sin(pose.yaw_rad) * (px - pose.x_m) + math.cos(pose.yaw_rad) * (py - pose.y_m)
        sideways = clip(config.lateral_gain * left, -config.lateral_m_s, config.lateral_m_s)
        return clip_command((speed, sideways, yaw_rate), limits)

    def _why_replan(self, time_s: float, off_m: float) -> str:
        config = self._config
        remaining_m = self._remaining_m[self._cursor.index]
        since_s, best_m = self._progress
        if self._turning or remaining_m < best_m - config.blocked_m or best_m < 0:
            self._progress = (time_s, remaining_m)
        elif time_s - since_s > config.blocked_s:
            self._back_off_until_s = time_s + config.back_off_s
            self._progress = (self._back_off_until_s, remaining_m)
            return f"no progress for {config.blocked_s:g} s"
        if time_s - self._planned_s < config.replan_every_s:
            return ""
        if off_m > config.replan_off_m:
            return f"{off_m:.2f} m off the route"
        if time_s - self._heading_ok_s > config.replan_heading_s:
            self._heading_ok_s = time_s
            return f"heading off for {config.replan_heading_s:g} s"
        return ""

    def _replan(self, time_s: float, pose: Pose, reason: str) -> None:
        """Plan a way back to the route some way ahead, and continue as before."""
        self._planned_s = time_s
        rest = self._cursor.xy_m[self._cursor.ahead(self._config.rejoin_m, STEP_M) :]
        back = rejoin(self._task.freemap, pose, rest, self._task.radius_m)
        if back is None:
            self._notes.append(("replan_failed", reason))
            return
        self._notes.append(("replan", reason))
        self._follow(back)
        self._progress = (max(time_s, self._back_off_until_s), self._remaining_m[0])

    def _follow(self, route: Route) -> None:
        config = self._config
        curve = np.maximum(route.curvature_per_m(), 1e-6)
        limit = np.minimum(config.cruise_m_s, config.curve_yaw_rad_s / curve)
        # Slow down before the curve, not in it: v² = v_next² + 2 a s, backwards.
        steps = np.diff(route.along_m)
        for i in range(len(steps) - 1, -1, -1):
            reach = math.sqrt(limit[i + 1] ** 2 + 2 * config.decelerate_m_s2 * steps[i])
            limit[i] = min(limit[i], reach)
        self._speed_limit: list[float] = limit.tolist()
        self._remaining_m: list[float] = (route.along_m[-1] - route.along_m).tolist()
        self._cursor = RouteCursor(route.xy_m, STEP_M)

    def _decide(self, command: Command, done: bool = False) -> Decision:
        notes, self._notes = tuple(self._notes), []
        return Decision(command, done=done, notes=notes)
