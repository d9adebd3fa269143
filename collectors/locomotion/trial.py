"""Many robots walking at once under one policy, measured; no learning involved."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from ..robots import POLICY_DECIMATION, TIMESTEP_S, RobotHandles, apply_physics_options
from .gait import joint_targets
from .observation import RobotState, observe, states_of
from .policy import GaitPolicy
from .terrain import Terrain

Array = NDArray[np.float64]
STEP_S = TIMESTEP_S * POLICY_DECIMATION


@dataclass(frozen=True)
class Conditions:
    """What a trial is run in.

    Attributes:
        terrain: the ground.
        friction: of the feet, or None for the robot's own.
        latency_substeps: physics steps by which every action comes late.
        push_m_s, push_every_s: kicks of the base in random directions; none where 0.
    """

    terrain: Terrain = field(default_factory=Terrain)
    friction: float | None = None
    latency_substeps: int = 0
    push_m_s: float = 0.0
    push_every_s: float = 3.0


class Trial:
    """N copies of a robot, started at given poses and driven by commands at policy rate."""

    def __init__(
        self,
        policy: GaitPolicy,
        conditions: Conditions,
        xy_m: Array,
        yaw_rad: Array,
        rng: np.random.Generator,
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
        if conditions.friction is not None:
            model.geom_friction[h.sole_geoms.ravel(), 0] = conditions.friction
        self._sole_radius = model.geom_rbound[h.sole_geoms]
        n = len(xy_m)
        self.batch = Batch(model, n, threads)
        self.batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._qpos, self._qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        self._geoms, self._com = self.batch.bind("geom_xpos"), self.batch.bind("subtree_com")
        self._sensors = self.batch.bind("sensordata")
        data = mujoco.MjData(model)
        for i in range(n):
            around = xy_m[i] + self.rng.uniform(-0.35, 0.35, (32, 2))
            ground = float(conditions.terrain.at(around).max())
            h.spawn(data, xy_m[i, 0], xy_m[i, 1], ground, float(yaw_rad[i]))
            self._qpos[i] = data.qpos
        self.batch.forward()
        self.fallen = np.zeros(n, dtype=bool)
        self._target = np.tile(robot.default_joint_rad, (n, 1))
        self.action, self._phase = np.zeros((n, robot.policy_joints)), np.zeros(n)
        self.foot_position, self.foot_contact = self._feet()
        # As in a replay, the robot first settles on its feet.
        self.time_s = -settle_s
        for _ in range(round(settle_s / STEP_S)):
            self.step(np.zeros((n, 3)))
        self.time_s = 0.0

    def step(self, command: Array) -> None:
        """Advance all by 20 ms under commands (N, 3); sets `slip`, `fallen` and the foot fields."""
        robot, gait, previous = self.policy.robot, self.policy.card.gait, self.action
        wanted = robot.command_limits.clip(command)
        moving = gait.moving(wanted)
        self._phase = gait.advance(self._phase, moving, STEP_S)
        default, policed = robot.default_joint_rad, robot.policy_joints
        self.action = self.policy.infer(
            observe(self.state(), default[:policed], wanted, self._phase, moving, previous)
        )
        before_target = self._target
        reference = gait.reference(self._phase, moving, wanted)
        self._target = joint_targets(default, reference, robot.action_scale_rad, self.action)
        fresh = np.arange(POLICY_DECIMATION) >= self.conditions.latency_substeps
        control = np.where(fresh[:, None], self._target[:, None], before_target[:, None])
        order = np.argsort(self.handles.actuators)
        self.batch.rollout(POLICY_DECIMATION, control[..., order], record=())
        self.time_s += STEP_S
        self._push()
        before, was_down = self.foot_position, self.foot_contact
        self.foot_position, self.foot_contact = self._feet()
        moved = np.linalg.norm((self.foot_position - before)[..., :2], axis=-1) / STEP_S
        # Slip is the motion of a foot that was down at both ends of the step.
        self.slip = np.where(was_down & self.foot_contact, moved, np.nan)
        self.target_rate = (self._target - before_target) / STEP_S
        self.fallen |= self._falls()

    def state(self) -> RobotState:
        """Current state of all robots."""
        return states_of(self._qpos, self._qvel, self.handles)

    @property
    def position_m(self) -> Array:
        """(N, 3) base positions."""
        return self._qpos[:, self.handles.root_qpos : self.handles.root_qpos + 3].copy()

    @property
    def yaw_rad(self) -> Array:
        """(N,) headings."""
        q = self.handles.root_qpos
        w, x, y, z = self._qpos[:, q + 3 : q + 7].T
        return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    @property
    def velocity(self) -> Array:
        """(N, 3) vx, vy [m/s] and yaw rate [rad/s] in the base frame."""
        state = self.state()
        return np.column_stack(
            [state.linear_velocity_m_s[:, :2], state.angular_velocity_rad_s[:, 2]]
        )

    @property
    def foot_clearance_m(self) -> Array:
        """(N, F) height of each foot's lowest sole above the ground."""
        soles = self._geoms[:, self.handles.sole_geoms]
        ground = self.conditions.terrain.at(soles[..., :2])
        return (soles[..., 2] - self._sole_radius - ground).min(axis=-1)

    def _feet(self) -> tuple[Array, NDArray[np.bool_]]:
        h = self.handles
        return self._geoms[:, h.sole_geoms].mean(axis=2), self._sensors[:, h.foot_touch] > 1.0

    def _falls(self) -> NDArray[np.bool_]:
        fall, g = self.policy.robot.fall, self.state().gravity
        roll = np.abs(np.arctan2(-g[:, 1], -g[:, 2]))
        pitch = np.abs(np.arcsin(np.clip(g[:, 0], -1, 1)))
        lowest = self._geoms[:, self.handles.sole_geoms, 2] - self._sole_radius
        sole = lowest.min(axis=(1, 2))
        low = self._com[:, self.handles.root_body, 2] - sole < fall.com_to_foot_m
        broken = ~np.isfinite(self._qpos).all(axis=1)
        return (roll > fall.roll_rad) | (pitch > fall.pitch_rad) | low | broken

    def _push(self) -> None:
        speed, every = self.conditions.push_m_s, self.conditions.push_every_s
        if speed and self.time_s > 0 and round(self.time_s / STEP_S) % round(every / STEP_S) == 0:
            angle = self.rng.uniform(0, 2 * np.pi, len(self._qvel))
            v = self.handles.root_dof
            self._qvel[:, v] += speed * np.cos(angle)
            self._qvel[:, v + 1] += speed * np.sin(angle)
