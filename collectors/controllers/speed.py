"""Move-by-speed: discrete actions carried out as velocity commands.

Timing is VLN-PE's by default: 1.0 m/s and 60°/s over 50 physics steps per action, whatever the
robot made of it; the expert corrects with the next action. Commands are ramped, not jumped. With
`end_on_displacement` an action ends when its 0.25 m or 15° are reached, at `longest_steps` at the
latest.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from ...formats.rollout import Action
from ..robots import TIMESTEP_S
from .expert import FORWARD_M, TURN_RAD, Expert, ExpertConfig
from .geometry import clip, wrap_angle
from .interface import STOPPED, Decision, Pose, Task
from .route import plan_route

RECENT = 5  # samples of 10 ms over which the velocity is taken


@dataclass(frozen=True)
class SpeedConfig:
    """How discrete actions are carried out.

    Attributes:
        linear_m_s, yaw_rad_s: commanded while walking and while turning.
        steps_per_action: physics steps of one action.
        end_on_displacement: actions may last longer, until their displacement is reached.
        longest_steps: physics steps after which an action ends in any case.
        replan_off_m: distance from the route that calls for a new one.
        ramp_m_s2, ramp_rad_s2: how fast the command changes; jumping between full speed and a
            full turn four times a second throws walking robots off balance. inf jumps.
        carry_s: a moving body goes on for about this long; the expert chooses from where it will
            then be, or it would correct every turn by the opposite one.
        expert: how actions are chosen.
    """

    linear_m_s: float = 1.0
    yaw_rad_s: float = math.radians(60.0)
    steps_per_action: int = 50
    end_on_displacement: bool = False
    longest_steps: int = 100
    replan_off_m: float = 0.5
    ramp_m_s2: float = 3.0
    ramp_rad_s2: float = 4.0
    carry_s: float = 0.1
    expert: ExpertConfig = field(default_factory=ExpertConfig)


class SpeedController:
    """See the module; satisfies `Controller`."""

    def __init__(self, task: Task, config: SpeedConfig) -> None:
        self._task, self._config = task, config
        route = plan_route(task.freemap, task.reference_xy_m, task.radius_m)
        self._notes = [("unplannable", problem) for problem in route.problems]
        action_s = config.steps_per_action * TIMESTEP_S
        # A slow robot needs more actions than the path has steps.
        forward_m = min(FORWARD_M, task.limits.vx_m_s[1] * action_s)
        turns = route.turning_rad / TURN_RAD + 6
        self._nominal = (route.length_m / forward_m + turns) * action_s
        self._expert = Expert(route, config.expert)
        self._action: Action | None = None
        self._start_s, self._start = 0.0, Pose(0.0, 0.0, 0.0)
        self._command: tuple[float, float, float] = STOPPED
        self._recent: deque[Pose] = deque(maxlen=RECENT + 1)

    rate_hz = 100

    @property
    def nominal_s(self) -> float:
        """All forward steps and turns of the route, and half a right angle at the start."""
        return self._nominal

    def step(self, time_s: float, pose: Pose) -> Decision:
        """See `Controller.step`."""
        self._recent.append(pose)
        started = None
        if self._action is None or self._over(time_s, pose):
            started = self._action = self._expert.next_action(self._carried())
            self._start_s, self._start = time_s, pose
            if self._expert.off_route_m > self._config.replan_off_m:
                self._replan(pose)
        notes, self._notes = tuple(self._notes), []
        return Decision(
            self._ramped(self._action), started, done=self._action is Action.STOP, notes=notes
        )

    def _over(self, time_s: float, pose: Pose) -> bool:
        config = self._config
        steps = round((time_s - self._start_s) / TIMESTEP_S)
        if not config.end_on_displacement:
            return steps >= config.steps_per_action
        return steps >= config.longest_steps or self._displaced(pose)

    def _carried(self) -> Pose:
        """Where the body's momentum will take it, by its mean velocity over the last samples."""
        old, new = self._recent[0], self._recent[-1]
        if len(self._recent) < 2:
            return new
        ratio = self._config.carry_s * self.rate_hz / (len(self._recent) - 1)
        return Pose(
            new.x_m + ratio * (new.x_m - old.x_m),
            new.y_m + ratio * (new.y_m - old.y_m),
            wrap_angle(new.yaw_rad + ratio * wrap_angle(new.yaw_rad - old.yaw_rad)),
        )

    def _displaced(self, pose: Pose) -> bool:
        start = self._start
        if self._action is Action.FORWARD:
            dx, dy = pose.x_m - start.x_m, pose.y_m - start.y_m
            return dx * math.cos(start.yaw_rad) + dy * math.sin(start.yaw_rad) >= FORWARD_M
        sign = 1.0 if self._action is Action.LEFT else -1.0
        return sign * wrap_angle(pose.yaw_rad - start.yaw_rad) >= TURN_RAD

    def _ramped(self, action: Action) -> tuple[float, float, float]:
        """The command one sample further on the way to what the action asks for."""
        config, wanted = self._config, self._wanted(action)
        most = (config.ramp_m_s2 / self.rate_hz, 0.0, config.ramp_rad_s2 / self.rate_hz)
        vx, vy, yaw = (
            old + clip(new - old, -step, step)
            for old, new, step in zip(self._command, wanted, most, strict=True)
        )
        self._command = (vx, vy, yaw)
        return self._command

    def _wanted(self, action: Action) -> tuple[float, float, float]:
        config, limits = self._config, self._task.limits
        if action is Action.FORWARD:
            return clip(config.linear_m_s, *limits.vx_m_s), 0.0, 0.0
        if action is Action.STOP:
            return STOPPED
        sign = 1.0 if action is Action.LEFT else -1.0
        return 0.0, 0.0, clip(sign * config.yaw_rad_s, *limits.yaw_rad_s)

    def _replan(self, pose: Pose) -> None:
        task = self._task
        route = plan_route(
            task.freemap, [(pose.x_m, pose.y_m), tuple(task.goal_xy_m)], task.radius_m
        )
        self._notes.append(("replan", f"{self._expert.off_route_m:.2f} m off the route"))
        self._expert = Expert(route, self._config.expert)
