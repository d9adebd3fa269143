"""The step of a gait, for any number of robots: from commands to observations to joint targets."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ....formats.core.arrays import Array, Floats, Mask
from ....formats.core.frames import quat_to_yaw
from ....formats.process.kernel import kernel
from ...physics.ground import Ground
from ...robots import CommandLimits, RobotHandles
from .estimator import StateEstimator
from .footholds import Footholds, FootingTables, place_feet, see_ground
from .footing import UNEVEN_M, Footing
from .gait import ClockState, GaitClock, GaitTables, aim_at, catch, refer, tick
from .observation import Places, body_width, layout, observe, true_body
from .sensors import Sensors


class GaitStep:
    """Observations and joint targets of N robots in one simulation.

    Attributes:
        observation: (N, D) in the order of `observation.layout`, as of the last `observe`.
        body: (N, `body_width`) what was seen of them, true or estimated, as of the last `observe`.
        clock: their gait clocks.
        action: (N, P) the policy's last output, clipped.
    """

    def __init__(
        self,
        qpos: Array,
        qvel: Array,
        handles: RobotHandles,
        gait: GaitClock,
        limits: CommandLimits,
        *,
        past: int = 0,
        dtype: DTypeLike = np.float32,
        sensed: tuple[Sensors, StateEstimator] | None = None,
        footing: Footing | None = None,
        ground: Ground | None = None,
        sees_ground: bool = True,
    ) -> None:
        """Prepare the step.

        Args:
            qpos, qvel: (N, nq), (N, nv) memory of the simulation, read in every step.
            handles: addresses of the robot in it.
            limits: commands are clipped to them.
            past: number of earlier steps in an observation.
            dtype: type of the observation.
            sensed: sensors of the robots, and the estimator of their state; the true state when
                None.
            footing: how the reference follows the ground; it takes the ground as level when None.
            ground: what is under the robots; level when None.
            sees_ground: whether it is part of the observation.
        """
        robot, count = handles.robot, len(qpos)
        # Plain tuples: kernels take named ones only after a slow look at their type.
        self._state = (qpos, qvel, *Places.of(handles))
        self._qpos, self._root = qpos, handles.root_qpos
        self._limits = np.array([limits.vx_m_s, limits.vy_m_s, limits.yaw_rad_s])
        self._default, self._tables = robot.default_joint_rad, tuple(gait.tables)
        self._scale_rad = robot.action_scale_rad
        self._footing, self._ground = footing, ground
        plain = sum(width for _, width in layout(robot.policy_joints, past))
        width = plain + (footing.width if footing and sees_ground else 0)
        self.observation = np.zeros((count, width), dtype)
        self.clock = ClockState.standing(count)
        self._clock = tuple(self.clock)
        self.action = np.zeros((count, robot.policy_joints))
        self._sensed = sensed
        self.body = np.zeros((count, body_width(robot.policy_joints)))
        self._command = np.zeros((count, 3))
        self._remembers = np.zeros(count, dtype=bool)
        self._reference = np.zeros((count, len(self._default)))
        self._footed, self._scan = None, np.zeros((count, 0, 0))
        if footing is not None:
            self.footholds = Footholds.none(count, len(robot.feet), len(self._default))
            self._scan = np.zeros((count, len(footing.scan_y_m), len(footing.scan_x_m)))
            self._footed = tuple(footing.tables(gait)), tuple(self.footholds), plain

    def reset(self, robots: NDArray[np.intp] | slice = slice(None)) -> None:
        """Forget the clock, the last action and the past, of some robots or all."""
        for array in (*self.clock, self.action, self._remembers):
            array[robots] = 0
        if self._footed is not None:
            self.footholds.ready[robots] = False
        for each in self._sensed or ():
            each.reset(robots)

    def reseed(self, seed: int) -> None:
        """Draw other errors of the sensors."""
        if self._sensed is not None:
            self._sensed[0].reseed(seed)

    def continue_from(self, other: GaitStep) -> None:
        """Take over the memory of another step of the same robots."""
        for new, old in zip(self.memory, other.memory, strict=True):
            new[:] = old

    @property
    def memory(self) -> tuple[NDArray, ...]:
        """Clock, last action and past, and those of the sensors and the estimator."""
        sensed = [array for each in self._sensed or () for array in each.memory]
        footed = () if self._footed is None else self.footholds
        return (*self.clock, self.action, self.observation, self._remembers, *sensed, *footed)

    def observe(self, command: ArrayLike) -> Floats:
        """Advance the clocks under commands (N, 3) in the base frame; return the observations."""
        self._command[:] = command
        if self._sensed is not None:
            sensors, estimator = self._sensed
            self.body[:] = estimator.update(sensors.read())
        if self._footing is not None and self._ground is not None:
            self._scan[:] = self._footing.scan(self._ground, self.pose)
        _advance(
            self._state, self._sensed is None, self.body, self._limits, self._command,
            self._tables, self._clock, self._default, self.action, self._remembers,
            self.observation, self._reference, self._footed, self._scan,
        )  # fmt: skip
        return self.observation

    @property
    def uneven(self) -> Mask:
        """(N,) whether the ground that was seen last is not level; never without a footing."""
        if self._footed is None:
            return np.zeros(len(self._scan), dtype=bool)
        return np.ptp(self._scan, axis=(1, 2)) > UNEVEN_M

    @property
    def pose(self) -> Array:
        """(N, 3) x, y [m] and heading [rad] of the bases."""
        return base_pose(self._qpos, self._root)

    def targets(self, output: Floats, clip: float) -> Array:
        """Return servo targets (N, J) [rad]: default pose, reference and clipped outputs (N, P)."""
        targets = self._default + self._reference
        _add_action(output, clip, self._scale_rad, self.action, targets)
        return targets


def base_pose(qpos: Array, root: int) -> Array:
    """Return x, y [m] and heading [rad], (N, 3), of bases at `root` in positions (N, nq)."""
    return np.column_stack([qpos[:, root : root + 2], quat_to_yaw(qpos[:, root + 3 : root + 7])])


@kernel()
def _advance(
    state,
    true,
    body,
    limits,
    command,
    tables,
    clock,
    default,
    action,
    remembers,
    seen,
    reference,
    footed,
    scan,
):
    """Clip the commands, advance the clocks, aim, observe and write the reference."""
    qpos, qvel, root_qpos, root_dof, joint_qpos, joint_dof = state
    places = Places(root_qpos, root_dof, joint_qpos, joint_dof)
    tables, clock = GaitTables(*tables), ClockState(*clock)
    if true:
        true_body(qpos, qvel, places, body)
    catch(tables, clock, body, command)
    for n in range(len(command)):
        for axis in range(3):
            command[n, axis] = min(max(command[n, axis], limits[axis, 0]), limits[axis, 1])
    tick(tables, clock, command)
    aim_at(tables, clock.command, command)
    plain = seen.shape[1]
    if footed is not None:
        footing, footholds, plain = FootingTables(*footed[0]), Footholds(*footed[1]), footed[2]
        place_feet(footing, tables, footholds, scan, clock, command)
        see_ground(footing, footholds, scan, body, seen[:, plain:])
    observe(body, default, command, clock, action, remembers, seen[:, :plain])
    refer(tables, clock.phase, clock.moving, command, reference)
    if footed is not None:
        footholds = Footholds(*footed[1])
        reference += footholds.shift + footholds.bear


@kernel()
def _add_action(output, clip, scale, action, targets):
    """Keep the clipped outputs (N, P) as actions; joints beyond P follow the reference alone."""
    for n in range(len(targets)):
        for j in range(output.shape[1]):
            action[n, j] = min(max(np.float64(output[n, j]), -clip), clip)
            targets[n, j] += scale * action[n, j]
