"""One robot's step of a gait in compiled code.

What is computed is defined elsewhere, for N robots at once and to be read: `observation.observe`,
`gait.GaitClock`, `gait.joint_targets`. For a single robot numpy's cost per call is ten times that
of the numbers, and is paid fifty times a second; a test holds both to the same results.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import DTypeLike, NDArray

from ....formats.core.kernel import kernel
from ...robots import RobotHandles
from .gait import FACTORS, GaitClock
from .observation import layout

Array = NDArray[np.float64]


class QuickStep:
    """Observation and joint targets of one robot in one simulation.

    Attributes:
        observation: (1, D) in the order of `observation.layout`, as of the last `look`.
        phase: (1,) gait phase in cycles.
        action: (1, P) the policy's last output, clipped.
    """

    def __init__(
        self,
        data: mujoco.MjData,
        handles: RobotHandles,
        gait: GaitClock,
        rate_hz: float,
        past: int = 0,
        dtype: DTypeLike = np.float32,
    ) -> None:
        """Get ready.

        Args:
            data: the simulation, kept and looked at from now on.
            handles: of the robot in it.
            gait: its clock.
            rate_hz: how often `look` will be called.
            past: number of earlier steps in an observation.
            dtype: of the observation.
        """
        robot = handles.robot
        joints, limits = robot.policy_joints, robot.command_limits
        self.data = data
        # Accessing the arrays of `data` again costs as much as reading the state.
        self._qpos, self._qvel = data.qpos, data.qvel
        self._at = np.array([handles.root_qpos, handles.root_dof])
        self._joint_qpos = handles.joint_qpos[:joints]
        self._joint_dof = handles.joint_dof[:joints]
        self._limits = np.array([limits.vx_m_s, limits.vy_m_s, limits.yaw_rad_s])
        self._default = robot.default_joint_rad
        self._stand = np.array(gait.stand_rad)
        turn = gait.turn_rad or np.zeros_like(gait.swing_rad)
        self._motion = np.array(
            [gait.swing_rad, gait.stance_rad, gait.forward_rad, gait.left_rad, turn]
        )
        offsets = np.array(gait.foot_offsets) + gait.lead_cycles
        self._feet = np.column_stack([offsets, gait.foot_xy_m])
        self._aim = np.array(gait.aim).reshape(-1, len(FACTORS))
        self._factors = np.array([(*f, 3, 3)[:3] for f in FACTORS])
        self._aim_limits = np.array(gait.aim_limits).reshape(-1, 2)
        self._clock = np.array(
            [
                gait.frequency_hz / rate_hz,
                gait.stand_linear_m_s,
                gait.stand_yaw_rad_s,
                gait.turn_lead_s,
                *(brake / rate_hz for brake in gait.brakes),
                gait.last_steps,
            ]
        )
        width = sum(width for _, width in layout(joints, past))
        self.observation = np.zeros((1, width), dtype)
        self.reset()

    def reset(self) -> None:
        """Forget clock, last action and what was seen before."""
        self.phase = np.zeros(1)
        self._remembers = np.zeros(1, dtype=bool)
        # The command that is followed, and the steps left to take; see `gait.ClockState`.
        self._followed = np.zeros(4)
        self.action = np.zeros((1, self._joint_qpos.size))
        self._reference = np.zeros_like(self._default)

    def take_over(self, other: QuickStep) -> None:
        """Continue from the gait phase of another step of the same robot."""
        self.phase[:], self.action[:] = other.phase, other.action
        self._followed[:] = other._followed
        self.observation[:], self._remembers[:] = other.observation, other._remembers

    def look(self, vx_m_s: float, vy_m_s: float, yaw_rad_s: float) -> NDArray[np.floating]:
        """Advance the clock under a command in the base frame; returns the observation (1, D)."""
        _look(
            self._qpos,
            self._qvel,
            self._at,
            self._joint_qpos,
            self._joint_dof,
            self._default,
            vx_m_s,
            vy_m_s,
            yaw_rad_s,
            self._limits,
            self._aim,
            self._factors,
            self._aim_limits,
            self._clock,
            self._feet,
            self._motion,
            self._stand,
            self.action,
            self.phase,
            self._followed,
            self._remembers,
            self.observation,
            self._reference,
        )
        return self.observation

    def targets(self, output: NDArray[np.float32], clip: float, scale_rad: float) -> Array:
        """Return servo targets (J,) [rad] from the network's output (1, P) for the last look."""
        targets = self._default + self._reference
        _add_action(output, clip, scale_rad, self.action, targets)
        return targets


@kernel()
def _followed(old, wanted, most):
    """Return what is followed after `old`: `wanted`, but slowed down by no more than `most`."""
    if abs(wanted) < abs(old) or wanted * old < 0.0:
        return old + min(max(wanted - old, -most), most)
    return wanted


@kernel()
def _look(
    qpos,
    qvel,
    at,
    joint_qpos,
    joint_dof,
    default,
    vx,
    vy,
    yaw,
    limits,
    aim,
    factors,
    aim_limits,
    clock,
    feet,
    motion,
    stand,
    action,
    phase,
    followed,
    remembers,
    seen,
    reference,
):
    """Fill the observation (1, D) and the reference (J,); advance the phase (1,) and `followed`.

    `followed` (4,) is the command that is followed and the steps left to take; `remembers` (1,)
    says whether `seen` holds the step before.
    """
    vx = min(max(vx, limits[0, 0]), limits[0, 1])
    vy = min(max(vy, limits[1, 0]), limits[1, 1])
    yaw = min(max(yaw, limits[2, 0]), limits[2, 1])
    vx = _followed(followed[0], vx, clock[4])
    vy = _followed(followed[1], vy, clock[4])
    yaw = _followed(followed[2], yaw, clock[5])
    followed[0], followed[1], followed[2] = vx, vy, yaw
    ahead_phase = phase[0] + clock[0]
    moving = np.hypot(vx, vy) > clock[1] or abs(yaw) > clock[2]
    if moving:
        followed[3] = clock[6]
    elif followed[3] > 0.0:
        if np.floor(2.0 * ahead_phase) > np.floor(2.0 * phase[0]):
            followed[3] -= 1.0
        moving = followed[3] > 0.0
    phase[0] = ahead_phase % 1.0 if moving else 0.0
    if len(aim):
        asked = np.array([vx, vy, yaw])
        wanted = asked.copy()
        for term in range(len(factors)):
            value = 1.0
            for factor in factors[term]:
                # Index 3 stands for no further factor.
                if factor < 3:
                    value *= wanted[factor]
            for axis in range(3):
                asked[axis] += aim[axis, term] * value
        vx = min(max(asked[0], aim_limits[0, 0]), aim_limits[0, 1])
        vy = min(max(asked[1], aim_limits[1, 0]), aim_limits[1, 1])
        yaw = min(max(asked[2], aim_limits[2, 0]), aim_limits[2, 1])

    q, v = at[0], at[1]
    w, x, y, z = qpos[q + 3], qpos[q + 4], qpos[q + 5], qpos[q + 6]
    # v' = v − 2w (q × v) + 2 q × (q × v), the inverse rotation.
    a, b, c = qvel[v], qvel[v + 1], qvel[v + 2]
    i, j, k = y * c - z * b, z * a - x * c, x * b - y * a
    seen[0, 0] = a - 2.0 * w * i + 2.0 * (y * k - z * j)
    seen[0, 1] = b - 2.0 * w * j + 2.0 * (z * i - x * k)
    seen[0, 2] = c - 2.0 * w * k + 2.0 * (x * j - y * i)
    seen[0, 3], seen[0, 4], seen[0, 5] = qvel[v + 3], qvel[v + 4], qvel[v + 5]
    seen[0, 6] = 2.0 * (w * y - x * z)
    seen[0, 7] = -2.0 * (w * x + y * z)
    seen[0, 8] = 2.0 * (x * x + y * y) - 1.0
    seen[0, 9], seen[0, 10], seen[0, 11] = vx, vy, yaw
    angle = 2.0 * np.pi * phase[0]
    seen[0, 12] = np.sin(angle) if moving else 0.0
    seen[0, 13] = np.cos(angle) if moving else 0.0
    count = len(joint_qpos)
    width, tail = 14 + 3 * count, 3 * count
    for n in range(seen.shape[1] - 1, width - 1, -1):
        seen[0, n] = seen[0, n - tail]
    for n in range(count):
        seen[0, 14 + n] = qpos[joint_qpos[n]] - default[n]
        seen[0, 14 + count + n] = qvel[joint_dof[n]]
        seen[0, 14 + 2 * count + n] = action[0, n]
    if not remembers[0]:
        for n in range(width, seen.shape[1]):
            seen[0, n] = seen[0, n - tail]
        remembers[0] = True

    reference[:] = stand
    if not moving:
        return
    ahead = clock[3] * yaw
    for f in range(len(feet)):
        turn = 2.0 * np.pi * (phase[0] + feet[f, 0])
        sine, cosine = np.sin(turn), np.cos(turn)
        bump = sine * sine
        swing = bump if sine > 0.0 else 0.0
        forward = cosine * (vx - ahead * vy - yaw * feet[f, 2])
        left = cosine * (vy + ahead * vx + yaw * feet[f, 1])
        for n in range(len(reference)):
            reference[n] += (
                swing * motion[0, f, n]
                + (bump - swing) * motion[1, f, n]
                + forward * motion[2, f, n]
                + left * motion[3, f, n]
                + cosine * yaw * motion[4, f, n]
            )


@kernel()
def _add_action(output, clip, scale, action, targets):
    """Keep the clipped output (1, P) as the action and add it to the targets (J,)."""
    for n in range(output.shape[1]):
        action[0, n] = min(max(np.float64(output[0, n]), -clip), clip)
        targets[n] += scale * action[0, n]
