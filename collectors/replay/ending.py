"""The end of an episode's record: how long a robot that stops or falls is watched."""

import math

from ...formats.core.rollout import STATE_RATE_HZ
from ..physics.outcome import OutcomeWatch
from .config import ReplayConfig

STAYS_M = 0.05  # a robot that moves farther from where it came to rest did not rest there


class Ending:
    """Decides when a robot that has stopped or fallen has been watched for long enough.

    After a stop the robot coasts, and it may still fall, even slowly: it is watched for a fixed
    time, and its record ends where it came to rest. After a fall it is watched for a fixed time,
    too, to see whether it stands up. Ticks are samples of the record, at `STATE_RATE_HZ`.

    Attributes:
        stopped_tick: when the controller stopped the robot, or None.
        rest_tick: since when it has been at rest; None if it did not come to rest.
        rest_end: last tick of the record of a robot at rest.
        down: whether it is still down at the end of the record.
        recovered: whether it was up for the second half of the time after its fall.
    """

    def __init__(self, watch: OutcomeWatch, config: ReplayConfig) -> None:
        self._watch, self._config = watch, config
        self._last: float = math.inf
        self._quiet_since: int | None = None
        self._rest_m = (0.0, 0.0)
        self._up_since: int | None = None
        self.stopped_tick: int | None = None
        self.rest_tick: int | None = None
        self.rest_end = 0
        self.fallen = self.down = self.recovered = False

    @property
    def begun(self) -> bool:
        """Whether the robot has stopped or fallen."""
        return self.fallen or self.stopped_tick is not None

    def stop(self, tick: int) -> None:
        """Begin to watch a robot whose controller has stopped it."""
        self.stopped_tick = tick
        self._last = tick + round(self._config.watch_s * STATE_RATE_HZ)

    def fall(self, tick: int) -> None:
        """Begin to watch a robot that has fallen."""
        self.fallen, self._up_since = True, None
        self._last = tick + round(self._config.after_fall_s * STATE_RATE_HZ)

    def look(self, tick: int) -> None:
        """Look at the robot after a policy step."""
        if self.fallen:
            if self._watch.down() is not None:
                self._up_since = None
            elif self._up_since is None:
                self._up_since = tick
        elif self.rest_tick is not None:
            if math.dist(self._watch.position_m, self._rest_m) > STAYS_M:
                self.rest_tick = self._quiet_since = None
        elif self.stopped_tick is not None:
            if self._watch.speed_m_s() >= self._config.settled_m_s:
                self._quiet_since = None
            elif self._quiet_since is None:
                self._quiet_since = tick
            elif tick - self._quiet_since >= self._config.rest_s * STATE_RATE_HZ:
                self.rest_tick, self.rest_end = self._quiet_since, tick
                self._rest_m = self._watch.position_m

    def complete(self, tick: int) -> bool:
        """Return whether the robot is watched no longer; a fall is judged then."""
        if tick < self._last:
            return False
        if self.fallen:
            self.down = self._up_since is None
            half = self._config.after_fall_s * STATE_RATE_HZ / 2
            self.recovered = self._up_since is not None and tick - self._up_since >= half
        return True
