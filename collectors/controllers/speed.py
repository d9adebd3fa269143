"""Move-by-speed: discrete actions carried out as velocity commands.

Timing is VLN-PE's by default: 1.0 m/s and 60°/s over 50 physics steps per action, whatever the
robot made of it; the expert corrects with the next action. Commands are ramped, not jumped. So
each action is one frame at 4 frames/s.

A walking body cannot do 0.25 m in 0.25 s from standing. With `end_on_displacement` the loop is
closed on each single action instead: it lasts until its 0.25 m or 15° are reached (see `servo`),
and the expert chooses one action ahead, so that the robot knows in time whether to slow down.
"""

import math
from collections import deque
from dataclasses import dataclass, field

from ...formats.core.rollout import FORWARD_STEP_M, TURN_STEP_RAD, Action
from ..robots import TIMESTEP_S
from .expert import ExpertConfig
from .flight import PACE_M_S
from .geometry import clip_command, ramped, wrap_angle
from .interface import STOPPED, Command, Decision, Pose, Task
from .legs import expert_for
from .servo import ServoConfig, Track, braking, steer

RECENT = 5  # samples of 10 ms over which the velocity is taken
CLOSED_LOOP_S = 0.7  # an action takes a walking robot about so long in closed loop


@dataclass(frozen=True)
class SpeedConfig:
    """Parameters of the controller `speed`.

    Attributes:
        linear_m_s, yaw_rad_s: commanded while walking and while turning.
        steps_per_action: physics steps of one action.
        end_on_displacement: an action lasts until its displacement is reached, steered by `servo`
            in place of the two settings above.
        servo: how it is held to its displacement then.
        ramp_m_s2, ramp_rad_s2: how fast the command changes; jumping between full speed and a
            full turn four times a second throws walking robots off balance. inf jumps.
        carry_s: a moving body goes on for about this long; the expert chooses a direction from
            where it will then be, turned as far as commanded (`Coasting.turn_lag_s`), or it would
            correct every turn by the opposite one. It stops by where the robot will come to rest
            (`Coasting.distance`, `lag_s`).
    """

    linear_m_s: float = 1.0
    yaw_rad_s: float = math.radians(60.0)
    steps_per_action: int = 50
    end_on_displacement: bool = False
    servo: ServoConfig = field(default_factory=ServoConfig)
    ramp_m_s2: float = 3.0
    ramp_rad_s2: float = 4.0
    carry_s: float = 0.1
    expert: ExpertConfig = field(default_factory=ExpertConfig)


class SpeedController:
    """See the module; satisfies `Controller`."""

    def __init__(self, task: Task, config: SpeedConfig) -> None:
        self._task, self._config = task, config
        expert = expert_for(task, config.expert)
        self._chooser = task.chooser or expert
        forward_m, turn_rad, action_s = FORWARD_STEP_M, TURN_STEP_RAD, CLOSED_LOOP_S
        if not config.end_on_displacement:
            action_s = config.steps_per_action * TIMESTEP_S
            # A slow robot, or a short action, needs more of them than its route has steps.
            forward_m = min(forward_m, action_s * min(config.linear_m_s, task.limits.vx_m_s[1]))
            fastest = max(map(abs, task.limits.yaw_rad_s))
            if fastest > 0:  # what cannot turn ends as stuck, not here
                turn_rad = min(turn_rad, action_s * min(config.yaw_rad_s, fastest))
        turns_rad = expert.turning_rad + math.pi / 2
        actions = expert.length_m / forward_m + turns_rad / turn_rad
        actions += expert.stairs_m / min(forward_m, action_s * PACE_M_S)
        self._nominal = actions * action_s
        self._track: Track | None = None
        self._start_s = 0.0
        self._coming: Action | None = None
        self._command: Command = STOPPED
        self._recent: deque[Pose] = deque(maxlen=RECENT + 1)
        # What was commanded so recently that the body has not done it yet.
        self._pending_m_s = self._no_commands(task.coasting.lag_s)
        self._pending_rad_s = self._no_commands(task.coasting.turn_lag_s)

    rate_hz = 100

    @property
    def nominal_s(self) -> float:
        """Time of all steps and turns of the route, and of a right angle at the start."""
        return self._nominal

    def step(self, time_s: float, pose: Pose) -> Decision:
        """See `Controller.step`."""
        self._recent.append(pose)
        started, track = None, self._track
        if track is None or self._over(track, time_s, pose):
            # One in closed loop that has not arrived is no ground to have chosen the next one from.
            if self._coming is None or (track and track.remaining(pose) > 0):
                self._coming = self._chooser.next_action(self._about_to_be(), self._at_rest())
            started, self._coming = self._coming, None
            self._track = track = Track(started, pose)
            self._start_s = time_s
        config = self._config
        target = self._steered(track, pose) if config.end_on_displacement else self._timed(track)
        linear, turn = config.ramp_m_s2 / self.rate_hz, config.ramp_rad_s2 / self.rate_hz
        self._command = ramped(self._command, target, linear, turn)
        self._pending_m_s.append(self._command[0])
        self._pending_rad_s.append(self._command[2])
        notes = tuple(self._chooser.notes())
        return Decision(self._command, started, done=track.action is Action.STOP, notes=notes)

    def _over(self, track: Track, time_s: float, pose: Pose) -> bool:
        config, spent_s = self._config, time_s - self._start_s
        if not config.end_on_displacement:
            return round(spent_s / TIMESTEP_S) >= config.steps_per_action
        return track.remaining(pose) <= 0 or spent_s >= config.servo.longest_s

    def _steered(self, track: Track, pose: Pose) -> Command:
        """Return the closed-loop command; choose the next action when braking depends on it."""
        servo = self._config.servo
        fast = servo.cruise_m_s if track.action is Action.FORWARD else servo.turn_rad_s
        slow = braking(track, pose, self._carried(servo.reaction_s), servo)
        if slow is not None and self._coming is None:
            self._coming = self._chooser.next_action(track.end)
        speed = fast if slow is None or self._coming is track.action else slow
        return steer(track, pose, speed, servo, self._task.limits)

    def _timed(self, track: Track) -> Command:
        config = self._config
        forward = config.linear_m_s if track.action is Action.FORWARD else 0.0
        command = (forward, 0.0, track.sense * config.yaw_rad_s)
        return clip_command(command, self._task.limits)

    def _carried(self, seconds: float) -> Pose:
        """Return the pose after `seconds` at the mean velocity of the last samples."""
        count = min(RECENT, len(self._recent) - 1)
        old, new = self._recent[-1 - count], self._recent[-1]
        if not count:
            return new
        ratio = seconds * self.rate_hz / count
        return Pose(
            new.x_m + ratio * (new.x_m - old.x_m),
            new.y_m + ratio * (new.y_m - old.y_m),
            wrap_angle(new.yaw_rad + ratio * wrap_angle(new.yaw_rad - old.yaw_rad)),
        )

    def _about_to_be(self) -> Pose:
        """Return the pose at which the next action takes effect, all commanded turning included.

        A body turns later than commanded, and the command itself falls to zero on a ramp: most of
        a single turn action happens during the next action. The angle follows from the commands
        alone, without a gait's sway.
        """
        soon, now = self._carried(self._config.carry_s), self._recent[-1]
        rate = self._command[2]
        lagging_rad = sum(self._pending_rad_s) / self.rate_hz
        ramp_rad = rate * abs(rate) / (2.0 * self._config.ramp_rad_s2)
        return Pose(soon.x_m, soon.y_m, wrap_angle(now.yaw_rad + lagging_rad + ramp_rad))

    def _at_rest(self) -> Pose:
        """Return the pose at which the robot would come to rest if it were stopped now.

        From the commands alone: between two actions a robot is still far from the speed that it
        was last told, and by its speed alone it would seem to stop sooner or later than it does.
        """
        now, speed_m_s = self._recent[-1], self._command[0]
        steady_m = math.copysign(self._task.coasting.distance(abs(speed_m_s)), speed_m_s)
        unsteady_m = sum(past_m_s - speed_m_s for past_m_s in self._pending_m_s) / self.rate_hz
        distance_m = steady_m + unsteady_m
        x_m = now.x_m + distance_m * math.cos(now.yaw_rad)
        return Pose(x_m, now.y_m + distance_m * math.sin(now.yaw_rad), now.yaw_rad)

    def _no_commands(self, seconds: float) -> deque[float]:
        samples = round(seconds * self.rate_hz)
        return deque([0.0] * samples, maxlen=samples)
