"""When an episode is over, other than by the robot's own decision.

Fall and stuck follow the VLN-PE paper (see the design, §2).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from ..formats.rollout import EndReason
from .robots import POLICY_DECIMATION
from .world import World


@dataclass(frozen=True)
class OutcomeConfig:
    """Limits beyond which an episode ends.

    Attributes:
        stuck_steps: physics steps over which a robot must get somewhere: 50 actions of 50 steps.
        stuck_m, stuck_rad: less displacement and turn than this over those steps is stuck.
        timeout_factor: times the controller's nominal time.
        timeout_actions: discrete actions.
        success_m: a stop within this distance of the goal is a success.
        diverged_speed: greatest credible velocity of any joint [m/s or rad/s].
    """

    stuck_steps: int = 2500
    stuck_m: float = 0.2
    stuck_rad: float = math.radians(15.0)
    timeout_factor: float = 3.0
    timeout_actions: int = 500
    success_m: float = 0.25
    diverged_speed: float = 500.0


class OutcomeWatch:
    """Looks at the robot: `diverged` after every sample, `check` after every policy step."""

    def __init__(self, world: World, config: OutcomeConfig) -> None:
        self._world, self._config = world, config
        self._trace: deque[tuple[float, float, float]] = deque(
            maxlen=config.stuck_steps // POLICY_DECIMATION
        )

    def check(self) -> tuple[EndReason, str] | None:
        """Whether the robot has fallen or is stuck, with a detail in words; else None."""
        return self._fallen() or self._stuck()

    def diverged(self) -> str | None:
        """In words, when the state is not finite, or moves faster than anything real."""
        fastest = float(np.abs(self._world.data.qvel).max())
        finite = math.isfinite(float(self._world.data.qpos.sum()))
        # The comparison is written so that NaN counts as diverged.
        if finite and fastest < self._config.diverged_speed:
            return None
        return f"fastest joint {fastest:.3g} m/s or rad/s"

    def _fallen(self) -> tuple[EndReason, str] | None:
        world, fall = self._world, self._world.robot.fall
        q = world.handles.root_qpos
        x, y, _, w, i, j, k = world.data.qpos[q : q + 7].tolist()
        roll = math.atan2(2 * (w * i + j * k), 1 - 2 * (i * i + j * j))
        pitch = math.asin(min(max(2 * (w * j - k * i), -1.0), 1.0))
        if abs(roll) > fall.roll_rad:
            return EndReason.FALL, f"roll {math.degrees(roll):.0f}°"
        if abs(pitch) > fall.pitch_rad:
            return EndReason.FALL, f"pitch {math.degrees(pitch):.0f}°"
        height = world.handles.com_to_foot_m(world.data)
        if height < fall.com_to_foot_m:
            return EndReason.FALL, f"centre of mass {height:.2f} m above the lowest foot"
        if not world.surface.is_solid(x, y):
            return EndReason.FALL, f"no floor at ({x:.2f}, {y:.2f})"
        return None

    def _stuck(self) -> tuple[EndReason, str] | None:
        pose, config = self._world.pose, self._config
        trace = self._trace
        full = len(trace) == trace.maxlen
        if full:
            x, y, yaw = trace[0]
            moved = math.hypot(pose.x_m - x, pose.y_m - y)
            turned = abs(math.remainder(pose.yaw_rad - yaw, 2 * math.pi))
            if moved < config.stuck_m and turned < config.stuck_rad:
                return EndReason.STUCK, f"{moved:.2f} m in {config.stuck_steps} physics steps"
        trace.append((pose.x_m, pose.y_m, pose.yaw_rad))
        return None
