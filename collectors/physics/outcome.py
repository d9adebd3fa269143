"""The ends of an episode other than the robot's own decision.

Fall and stuck follow the VLN-PE paper (see the design, §2); on stairs, the pitch of a trunk that
leans counts against the slope underfoot.
"""

import math
from collections import deque
from dataclasses import dataclass

import mujoco
import numpy as np

from ...formats.core.rollout import EndReason
from ...formats.process.kernel import kernel
from ..robots import POLICY_DECIMATION, FallThresholds, RobotHandles
from .floor_surface import FloorSurface
from .ground import Ground, slopes
from .joined_floor import JoinedFloor


@dataclass(frozen=True)
class OutcomeConfig:
    """Limits beyond which an episode ends.

    Attributes:
        stuck_steps: physics steps over which a robot must get somewhere: 50 actions of 50 steps.
        stuck_actions: judge over so many discrete actions instead, whatever time they take, where
            actions have no fixed length; 0 = over `stuck_steps`.
        stuck_m, stuck_rad: less displacement and turn than this over those steps is stuck.
        timeout_factor: times the controller's nominal time.
        timeout_actions: discrete actions.
        success_m: a stop within this distance of the goal is a success.
        diverged_speed: greatest credible norm of all velocities [m/s and rad/s].
    """

    stuck_steps: int = 2500
    stuck_actions: int = 0
    stuck_m: float = 0.2
    stuck_rad: float = math.radians(15.0)
    timeout_factor: float = 3.0
    timeout_actions: int = 500
    success_m: float = 0.25
    diverged_speed: float = 500.0


class OutcomeWatch:
    """Looks at the robot after every policy step, 20 ms.

    Attributes:
        tilt: the last posture that would have been a fall on level ground, but is none on the slope
            of stairs; empty if there was none.
    """

    def __init__(
        self,
        data: mujoco.MjData,
        handles: RobotHandles,
        fall: FallThresholds,
        surface: FloorSurface | JoinedFloor,
        config: OutcomeConfig,
        ground: Ground | None = None,
    ) -> None:
        """Prepare to watch a robot.

        Args:
            ground: with stairs, on which the pitch of a trunk that leans counts against the slope.
        """
        self._fall, self._surface, self._config = fall, surface, config
        self._ground = ground if handles.robot.leans else None
        # Views of the simulation's memory: access through `data` costs more than the check.
        self._base = data.qpos[handles.root_qpos : handles.root_qpos + 7]
        self._qvel, self._geom_xpos = data.qvel, data.geom_xpos
        self._com = data.subtree_com[handles.root_body]
        self._feet = np.asarray(handles.sole_geoms.ravel(), dtype=np.int64)
        self._root_dof = handles.root_dof
        self._foot_radius = handles.sole_radius_m.ravel()
        self._base_height_m = handles.robot.base_height_m
        self.tilt = ""
        # Poses of the policy steps, or of the beginnings of actions, that stuck is judged over.
        self._trace: deque[tuple[float, float, float]] = deque(
            maxlen=config.stuck_actions + 1
            if config.stuck_actions
            else config.stuck_steps // POLICY_DECIMATION
        )

    @property
    def trace(self) -> tuple[tuple[float, float, float], ...]:
        """The poses that stuck is judged over, oldest first."""
        return tuple(self._trace)

    @trace.setter
    def trace(self, poses: tuple[tuple[float, float, float], ...]) -> None:
        self._trace.clear()
        self._trace.extend(poses)

    def diverged(self) -> str | None:
        """Describe a state that is not finite, or implausibly fast; None for any other."""
        speed = math.sqrt(self._qvel.dot(self._qvel))
        # The comparison is written so that NaN counts as diverged.
        if speed < self._config.diverged_speed:
            return None
        return f"joint speeds {speed:.3g} m/s or rad/s in all"

    def check(self) -> tuple[EndReason, str] | None:
        """Return fall or stuck with a description, or None."""
        down = self.down()
        if down is not None:
            return EndReason.FALL, down
        x, y, yaw, *_ = self._posture()
        return self._stuck(x, y, yaw)

    def acted(self) -> None:
        """Note that a discrete action begins."""
        if self._config.stuck_actions:
            self._trace.append(self._posture()[:3])

    def down(self) -> str | None:
        """Describe a posture that is a fall at this instant; None for any other."""
        fall = self._fall
        x, y, yaw, roll, pitch, height = self._posture()
        if abs(roll) > fall.roll_rad:
            return f"roll {math.degrees(roll):.0f}°"
        slope = self._slope(x, y, yaw)
        # A nose that points up counts as a negative pitch.
        if abs(pitch + slope) > fall.pitch_rad:
            on = f" on a slope of {math.degrees(slope):.0f}°" if slope else ""
            return f"pitch {math.degrees(pitch):.0f}°{on}"
        if abs(pitch) > fall.pitch_rad:
            self.tilt = f"pitch {math.degrees(pitch):.0f}°"
        if height < fall.com_to_foot_m:
            return f"centre of mass {height:.2f} m above the lowest foot"
        solid = self._surface.is_solid(x, y, float(self._base[2]) - self._base_height_m)
        return None if solid else f"no floor at ({x:.2f}, {y:.2f})"

    def _slope(self, x_m: float, y_m: float, yaw_rad: float) -> float:
        if self._ground is None:
            return 0.0
        return float(slopes(self._ground, np.array([[x_m, y_m, yaw_rad]]))[0])

    @property
    def position_m(self) -> tuple[float, float]:
        """Where the base is on the ground."""
        return float(self._base[0]), float(self._base[1])

    def speed_m_s(self) -> float:
        """Return the horizontal speed of the base."""
        dof = self._root_dof
        return math.hypot(self._qvel[dof], self._qvel[dof + 1])

    def _posture(self) -> tuple[float, float, float, float, float, float]:
        return _posture(self._base, self._com, self._geom_xpos, self._feet, self._foot_radius)

    def _stuck(self, x_m: float, y_m: float, yaw_rad: float) -> tuple[EndReason, str] | None:
        config, trace = self._config, self._trace
        if len(trace) == trace.maxlen:
            x, y, yaw = trace[0]
            moved = math.hypot(x_m - x, y_m - y)
            turned = abs(math.remainder(yaw_rad - yaw, 2 * math.pi))
            if moved < config.stuck_m and turned < config.stuck_rad:
                steps, actions = config.stuck_steps, config.stuck_actions
                over = f"{actions} actions" if actions else f"{steps} physics steps"
                return EndReason.STUCK, f"{moved:.2f} m in {over}"
        if not config.stuck_actions:
            trace.append((x_m, y_m, yaw_rad))
        return None


@kernel()
def _posture(base, com, geom_xpos, feet, foot_radius):
    """Return x, y, yaw, roll, pitch of a base (7,) and its centre of mass over the lowest foot."""
    w, i, j, k = base[3], base[4], base[5], base[6]
    yaw = np.arctan2(2 * (w * k + i * j), 1 - 2 * (j * j + k * k))
    roll = np.arctan2(2 * (w * i + j * k), 1 - 2 * (i * i + j * j))
    pitch = np.arcsin(min(max(2 * (w * j - k * i), -1.0), 1.0))
    lowest = np.inf
    for f in range(len(feet)):
        lowest = min(lowest, geom_xpos[feet[f], 2] - foot_radius[f])
    return base[0], base[1], yaw, roll, pitch, com[2] - lowest
