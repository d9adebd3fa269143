"""Many robots walking at once under one policy, measured; no learning involved."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from ....formats.core.arrays import Array, Mask
from ...physics.ground import slopes
from ...robots import (
    POLICY_DECIMATION,
    TIMESTEP_S,
    FallThresholds,
    RobotHandles,
    RobotSpec,
    apply_physics_options,
)
from ..runtime.observation import RobotState, states_of
from ..runtime.policy import GaitPolicy
from ..runtime.sensors import Simulation
from ..runtime.step import base_pose
from .pipe import TargetPipe
from .seen_ground import SeenGround
from .terrain import Terrain

STEP_S = TIMESTEP_S * POLICY_DECIMATION
TOUCH_N = 1.0  # as in a rollout's record
FLAT_M = 0.004  # soles this much above a foot's lowest one rest on the ground with it


@dataclass(frozen=True)
class Conditions:
    """Conditions of a trial; arrays hold one value per robot.

    Attributes:
        friction: of the feet, or None for the robot's own.
        latency_substeps: physics steps by which every action comes late.
        map_errors: a footing sees the ground in the map of a depth camera; see `SeenGround`.
        push_m_s, push_every_s: kicks of the base in random directions; none where 0.
    """

    terrain: Terrain = field(default_factory=Terrain)
    friction: float | Array | None = None
    latency_substeps: int | NDArray[np.intp] = 0
    map_errors: bool = False
    push_m_s: float = 0.0
    push_every_s: float = 3.0

    @staticmethod
    def mixed(
        count: int, rng: np.random.Generator, terrain: Terrain | None = None, push_m_s: float = 0.0
    ) -> Conditions:
        """Return the friction of 0.5–1.1 for each robot, and every second one acts 20 ms late."""
        return Conditions(
            terrain=terrain or Terrain(),
            friction=rng.uniform(0.5, 1.1, count),
            latency_substeps=np.arange(count) % 2 * POLICY_DECIMATION,
            push_m_s=push_m_s,
        )


def fallen(gravity: Array, com_height_m: Array, fall: FallThresholds, slack: float = 1.0) -> Mask:
    """Return which of N robots are beyond the thresholds, for roll and pitch times `slack`.

    Args:
        gravity: (N, 3) unit vector downwards in the base frames; on a slope see `levelled`.
        com_height_m: (N,) height of the centre of mass above the lowest sole.
    """
    roll = np.abs(np.arctan2(-gravity[:, 1], -gravity[:, 2]))
    pitch = np.abs(np.arcsin(np.clip(gravity[:, 0], -1, 1)))
    low = com_height_m < fall.com_to_foot_m
    return (roll > slack * fall.roll_rad) | (pitch > slack * fall.pitch_rad) | low


def levelled(gravity: Array, robot: RobotSpec, terrain: Terrain, pose: Array) -> Array:
    """Return gravity (N, 3) as robots would feel it if the stairs under them were level.

    Stairs rise in the direction of robots at poses (N, 3) x, y [m], heading [rad]. Other ground is
    taken as it is: its bumps are shorter than a robot. So are stairs by one that does not lean.
    """
    if not (terrain.blocks and robot.leans):
        return gravity
    slope = slopes(terrain, pose)
    cosine, sine, (x, y, z) = np.cos(slope), np.sin(slope), gravity.T
    return np.column_stack([cosine * x - sine * z, y, sine * x + cosine * z])


class Trial:
    """N copies of a robot, started at given poses and driven by commands at policy rate.

    A robot that falls stays where it fell, unmoved, and so does one passed to `leave`:
    neither costs time any more.

    Attributes:
        poses: (N, 2, 3) x, y [m] and heading [rad] of the base, 10 and 20 ms after the last step
            began.
        slip: (N, F) [m/s] speed of each foot's skin where it touched the ground during the last
            step; NaN for feet in the air, and for all feet if they are not recorded.
        estimate_error: (N, 2) error of the velocity [m/s] and of the attitude [rad] that the policy
            estimated at the start of the last step, if it does; NaN else.
        target_rate: (N, J) how fast the joint targets changed with the last step [rad/s].
        fallen: (N,) whether each robot has fallen.
    """

    def __init__(
        self,
        policy: GaitPolicy,
        conditions: Conditions,
        xy_m: Array,
        yaw_rad: Array,
        rng: np.random.Generator,
        *,
        watch_feet: bool = False,
        settle_s: float = 1.0,
        threads: int = 1,
    ) -> None:
        self.policy, self.conditions, self.rng = policy, conditions, rng
        robot = policy.robot
        spec = robot.spec()
        apply_physics_options(spec)
        conditions.terrain.add_to(spec)
        model = spec.compile()
        self.handles = h = RobotHandles.find(robot, model)
        self._sole_radius = h.sole_radius_m
        n = len(xy_m)
        self.batch = Batch(model, n, threads)
        if conditions.friction is not None:
            friction = np.broadcast_to(conditions.friction, n)
            self.batch.expand("geom_friction")[:, h.sole_geoms.ravel(), 0] = friction[:, None]
        self._pipe = TargetPipe(np.broadcast_to(conditions.latency_substeps, n))
        self._next_push = self.rng.uniform(0.0, conditions.push_every_s, n)
        self.batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._qpos, self._qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        self._geoms, self._com = self.batch.bind("geom_xpos"), self.batch.bind("subtree_com")
        self._geom_axes = self.batch.bind("geom_xmat")
        self._sensors = self.batch.bind("sensordata")
        data = mujoco.MjData(model)
        for i in range(n):
            around = xy_m[i] + self.rng.uniform(-0.35, 0.35, (32, 2))
            ground = float(conditions.terrain.at(around).max())
            x, y = xy_m[i]
            h.spawn(data, x_m=x, y_m=y, floor_z_m=ground, yaw_rad=float(yaw_rad[i]))
            self._qpos[i] = data.qpos
        self.batch.forward()
        self.fallen, self._gone = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
        self._target = np.tile(robot.default_joint_rad, (n, 1))
        self._pipe.fill(self._target)
        simulation = Simulation(
            self._qpos, self._qvel, self._sensors, self.batch.bind("actuator_force")
        )
        seed = int(rng.integers(2**32)) if policy.estimates else None
        # As in a replay, where a footing sees the ground on stairs alone.
        ground = conditions.terrain if conditions.terrain.lanes else None
        if ground is not None and conditions.map_errors:
            ground = SeenGround(ground, n, rng)
        self._step = policy.steps(simulation, model, h, seed, ground)
        self._output = np.zeros(self._step.action.shape, dtype=np.float32)
        self._soles = self._look_at_soles() if watch_feet else None
        # As in a replay, the robot first settles on its feet.
        self.time_s = -settle_s
        for _ in range(round(settle_s / STEP_S)):
            self.step(np.zeros((n, 3)))
        self.time_s = 0.0

    @property
    def going(self) -> Mask:
        """(N,) robots that still take part."""
        return ~self.fallen & ~self._gone

    def leave(self, robots: Mask) -> None:
        """Let the robots marked in (N,) take part no more."""
        self._gone |= robots

    def step(self, command: Array) -> None:
        """Advance by 20 ms under commands (N, 3) [m/s, rad/s] in the base frame."""
        ids = np.flatnonzero(self.going)
        self.poses = np.repeat(self._step.pose[:, None], 2, axis=1)
        self.slip = np.full((len(command), len(self.handles.sole_geoms)), np.nan)
        self.target_rate = np.full(self._target.shape, np.nan)
        self.estimate_error = np.full((len(command), 2), np.nan)
        if not len(ids):
            self.time_s += STEP_S
            return
        self._push()
        before, policy = self._target, self.policy
        policy.run(self._step, command, self._output)
        if policy.estimates:
            body, state = self._step.body, self.state()
            error = body[:, :3] - state.linear_velocity_m_s
            tilt = np.cross(body[:, 6:9], state.gravity)
            self.estimate_error = np.linalg.norm(np.stack([error, tilt]), axis=-1).T
        self._target = self._step.targets(self._output, policy.card.action_clip)
        control = self._pipe.push(self._target)
        order = np.argsort(self.handles.actuators)
        record = self.batch.rollout(
            POLICY_DECIMATION, control[ids][..., order], record=("qpos",), ids=ids
        )["qpos"]
        half = POLICY_DECIMATION // 2
        for k, at in enumerate((half - 1, POLICY_DECIMATION - 1)):
            self.poses[ids, k] = base_pose(record[:, at], self.handles.root_qpos)
        self.time_s += STEP_S
        if self._soles is not None:
            soles, self._soles = self._soles, self._look_at_soles()
            self.slip[ids] = self._slip(soles, self._soles)[ids]
        self.target_rate[ids] = ((self._target - before) / STEP_S)[ids]
        self.fallen |= self.going & self._falls()
        self._qvel[self.fallen] = 0.0

    def state(self) -> RobotState:
        """Return the current state of all robots."""
        return states_of(self._qpos, self._qvel, self.handles)

    @property
    def position_m(self) -> Array:
        """(N, 3) base positions."""
        return self._qpos[:, self.handles.root_qpos : self.handles.root_qpos + 3].copy()

    @property
    def velocity(self) -> Array:
        """(N, 3) vx, vy [m/s] and yaw rate [rad/s] in the base frame; 0 of the fallen."""
        state = self.state()
        return np.column_stack(
            [state.linear_velocity_m_s[:, :2], state.angular_velocity_rad_s[:, 2]]
        )

    @property
    def qpos(self) -> Array:
        """(N, nq) generalised positions."""
        return self._qpos.copy()

    @property
    def foot_clearance_m(self) -> Array:
        """(N, F) height of each foot's lowest sole above the ground."""
        soles = self._geoms[:, self.handles.sole_geoms]
        ground = self.conditions.terrain.at(soles[..., :2])
        return (soles[..., 2] - self._sole_radius - ground).min(axis=-1)

    def _look_at_soles(self) -> _Soles:
        h = self.handles
        position = self._geoms[:, h.sole_geoms]
        axes = self._geom_axes[:, h.sole_geoms].reshape(*position.shape[:-1], 3, 3)
        height = position[..., 2] - self._sole_radius
        lowest = height < height.min(axis=-1, keepdims=True) + FLAT_M
        touching = lowest & (self._sensors[:, h.foot_touch] > TOUCH_N)[..., None]
        return _Soles(position, axes, touching)

    def _slip(self, before: _Soles, now: _Soles) -> Array:
        """Return (N, F) speed [m/s] of each foot's skin where it touches the ground, else NaN.

        A round sole rolls: its centre moves while its lowest point rests.
        """
        down = np.zeros(3)
        down[2] = -1.0
        radius = self._sole_radius[..., None]
        skin = radius * np.einsum("nfsji,j->nfsi", before.axes, down)
        after = now.position_m + np.einsum("nfsij,nfsj->nfsi", now.axes, skin)
        moved = (after - before.position_m - radius * down)[..., :2]
        both = before.touching & now.touching
        speed = np.where(both, np.linalg.norm(moved, axis=-1), 0.0) / STEP_S
        count = both.sum(axis=-1)
        return np.where(count > 0, speed.sum(axis=-1) / np.maximum(count, 1), np.nan)

    def _falls(self) -> Mask:
        lowest = self._geoms[:, self.handles.sole_geoms, 2] - self._sole_radius
        height = self._com[:, self.handles.root_body, 2] - lowest.min(axis=(1, 2))
        broken = ~np.isfinite(self._qpos).all(axis=1)
        gravity = levelled(
            self.state().gravity, self.policy.robot, self.conditions.terrain, self._step.pose
        )
        return broken | fallen(gravity, height, self.policy.robot.fall)

    def kick(self, robots: Mask, speed_m_s: float) -> None:
        """Add a velocity in a random direction to the bases of the robots marked in (N,)."""
        angle = self.rng.uniform(0, 2 * np.pi, int(robots.sum()))
        v = self.handles.root_dof
        self._qvel[robots, v] += speed_m_s * np.cos(angle)
        self._qvel[robots, v + 1] += speed_m_s * np.sin(angle)

    def _push(self) -> None:
        """Kick those whose time has come; each has its own, or all were in the same step."""
        due = self.going & (self._next_push <= self.time_s)
        if self.conditions.push_m_s and due.any():
            self._next_push[due] += self.conditions.push_every_s
            self.kick(due, self.conditions.push_m_s)


@dataclass(frozen=True)
class _Soles:
    """Soles: positions (N, F, S, 3), axes (N, F, S, 3, 3), touching (N, F, S)."""

    position_m: Array
    axes: Array
    touching: Mask
