"""Hundreds of robots in `mujoco.batch`, as the vectorised environment `rsl_rl` expects."""

from dataclasses import asdict

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch
from numpy.typing import NDArray
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from ....formats.core.arrays import Array, Mask
from ...robots import POLICY_DECIMATION, RobotHandles, RobotSpec, apply_physics_options
from ...robots.parts import UNLIMITED
from ..runtime.observation import layout, present, states_of
from ..runtime.step import GaitStep
from ..trials.pipe import TargetPipe
from ..trials.terrain import Terrain
from ..trials.trial import STEP_S, fallen, levelled
from .config import TrainingConfig
from .mirror import Symmetry
from .randomize import draw_latency, randomize_models
from .recipes import recipe
from .rewards import SMOOTHNESS_TERMS, BodyFacts, StepFacts, reward_terms
from .schedule import Schedule
from .stairs.base import Base
from .stairs.course import course
from .stairs.reach import footing

# Where the critic sees the ground, ahead and left of the base.
AROUND_XY_M = np.array([(x, y) for x in (-0.15, 0.1, 0.35) for y in (-0.2, 0.2)])


class GaitEnv(VecEnv):
    """Velocity tracking on a terrain, with randomised bodies, latency and pushes.

    A policy with a `base` adds to the actions of that gait.
    """

    def __init__(
        self,
        robot: RobotSpec,
        config: TrainingConfig,
        terrain: Terrain,
        rng: np.random.Generator,
        threads: int,
        base: Base | None = None,
    ) -> None:
        self.robot, self.config, self.terrain, self.rng = robot, config, terrain, rng
        self.base, self.gait = base, base.card.gait if base else recipe(robot).gait
        self.footing = footing(robot, self.gait) if terrain.lanes else None
        self.course = course(terrain, config.envs, rng)
        self.cfg = asdict(config)
        self.device = "cpu"
        self.num_envs, self.num_actions = config.envs, robot.policy_joints
        self.max_episode_length = round(config.episode_s / STEP_S)
        self.episode_length_buf = torch.zeros(config.envs, dtype=torch.long)
        spec = robot.spec()
        apply_physics_options(spec)
        terrain.add_to(spec)
        model = spec.compile()
        self.handles = RobotHandles.find(robot, model)
        self._sole_radius = self.handles.sole_radius_m
        self.symmetry = Symmetry.of(robot, 0, self.footing)
        self._default = robot.default_joint_rad
        self.batch = Batch(model, config.envs, threads)
        self.physical = randomize_models(self.batch, self.handles, config, rng)
        self._qpos, self._qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        self._geom_xpos = self.batch.bind("geom_xpos")
        self._com = self.batch.bind("subtree_com")
        self._force = self.batch.bind("actuator_force")
        self._sensors = self.batch.bind("sensordata")
        past = base.card.past if base else 0
        blocks = layout(self.num_actions, past, self.footing)
        self._noise = np.concatenate([np.full(w, config.noise.get(n, 0.0)) for n, w in blocks])
        self._present = present(blocks)
        self._body = BodyFacts(
            base_height_m=robot.base_height_m,
            default_joint_rad=self._default[: robot.policy_joints],
            stand_joint_rad=np.tile(config.stand_joint_rad, len(robot.feet))
            if config.stand_joint_rad
            else self._default[: robot.policy_joints],
            joint_range_rad=np.array([j.range_rad for j in robot.joints[: robot.policy_joints]]),
            sideways=self.symmetry.joint_signs.numpy() < 0,
        )
        latency = draw_latency(rng, config)
        self._pipe = TargetPipe(latency)
        self.physical = np.column_stack([self.physical, latency])
        self._schedule = Schedule(robot, config, rng)
        # Control vectors follow the model's actuator order, which is the policy's here.
        self._ctrl_order = np.argsort(self.handles.actuators)
        self._allocate(past)
        self._reset(np.arange(self.num_envs))
        self._step.observe(np.zeros(3))

    def _allocate(self, past: int) -> None:
        n, j, f = self.num_envs, self.num_actions, len(self.robot.feet)
        self._previous, self._older = np.zeros((n, j)), np.zeros((n, j))
        self._pipe.fill(np.tile(self._default, (n, 1)))
        self._step = GaitStep(
            self._qpos, self._qvel, self.handles, self.gait, UNLIMITED, dtype=np.float64,
            past=past, footing=self.footing, ground=self.course.ground,
        )  # fmt: skip
        self._linear_mean, self._yaw_mean = np.zeros((n, 2)), np.zeros(n)
        self._foot_position, self._joint_velocity = np.zeros((n, f, 3)), np.zeros((n, j))
        self._foot_contact = np.ones((n, f), dtype=bool)
        self._foot_height, self._height = np.zeros((n, f)), np.zeros(n)
        self._age = np.zeros(n, dtype=np.int64)
        self.push_scale = self.smoothness_scale = 1.0
        self._statistics: dict[str, list[float]] = {}

    def get_observations(self) -> TensorDict:
        """Return the observations: group `policy` (noisy) and group `privileged` (critic only)."""
        clean = self._step.observation
        self._noisy = noisy = clean + self._noise * self.rng.uniform(-1, 1, clean.shape)
        privileged = np.concatenate(
            [
                self._linear_mean,
                self._yaw_mean[:, None],
                self._height[:, None],
                self._foot_contact,
                self._foot_height,
                self.physical,
                self._future(),
            ],
            axis=1,
        )
        return TensorDict(
            {
                "policy": torch.from_numpy(noisy[:, self._present].astype(np.float32)),
                "privileged": torch.from_numpy(privileged.astype(np.float32)),
            },
            batch_size=[self.num_envs],
        )

    def _future(self) -> Array:
        """Return (N, 16) what happens to each robot whatever it does, and the shape of the ground.

        A critic may know it: the next command and the next kick, weighted by how near they are,
        and the heights around the robot. Without it, advantages are mostly noise.
        """
        pose = self._step.pose
        cosine, sine = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        to_world = np.stack([cosine, -sine, sine, cosine], axis=-1).reshape(-1, 2, 2)
        kick = np.einsum("nij,ni->nj", to_world, self._schedule.kick)
        around = pose[:, None, :2] + np.einsum("nij,kj->nki", to_world, AROUND_XY_M)
        heights = self.terrain.at(around)
        heights -= heights.mean(axis=1, keepdims=True)
        return np.concatenate([self._schedule.future(self._age, kick), 10.0 * heights], axis=1)

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict]:
        """Return one policy step of every simulation; see `rsl_rl.env.VecEnv.step`."""
        self._older, self._previous = self._previous, self._step.action.copy()
        # Each simulation applies the new target some physics steps late.
        action = actions.numpy()
        if self.base is not None:
            # On level ground the finished gait acts alone.
            action = action * self._step.uneven[:, None] + self.base.act(self._noisy)
        target = self._step.targets(action, self.config.action_clip)
        control = self._pipe.push(target)
        self.batch.rollout(POLICY_DECIMATION, control[..., self._ctrl_order], record=())
        self._age += 1
        facts = self._measure()
        terms = reward_terms(facts, self._body, self.config)
        reward = sum(self._weight(name) * value for name, value in terms.items())
        reward = np.clip(np.nan_to_num(np.asarray(reward)), -20.0, 20.0) * STEP_S

        fell = self._fallen(facts)
        expired = self._age >= self.max_episode_length
        pose = self._step.pose
        time_out = (expired | self.course.left(pose)) & ~fell
        self._note(facts, terms, fell, reward)
        done = fell | time_out
        self._schedule.change_commands(self._age)
        kicked, kicks = self._schedule.kicks(self._age)
        v = self.handles.root_dof
        self._qvel[kicked, v : v + 2] += self.push_scale * kicks
        if done.any():
            self.course.finish(np.flatnonzero(done), pose, fell)
            self._reset(np.flatnonzero(done))
        self.course.steer(self._schedule.target, self._step.pose)
        self._step.observe(self._schedule.target)
        self.episode_length_buf = torch.from_numpy(self._age.copy())
        return (
            self.get_observations(),
            torch.from_numpy(reward.astype(np.float32)),
            torch.from_numpy(done),
            {"time_outs": torch.from_numpy(time_out)},
        )

    def take_statistics(self) -> tuple[dict[str, float], NDArray[np.int64]]:
        """Return means by name since the last call, and walks of the course; see `Course`."""
        means = {name: float(np.mean(values)) for name, values in self._statistics.items()}
        self._statistics.clear()
        return means, self.course.take_walks()

    def _weight(self, name: str) -> float:
        # Punished for every jerk from the start, a robot would learn to stand still.
        scale = self.smoothness_scale if name in SMOOTHNESS_TERMS else 1.0
        return scale * getattr(self.config.rewards, name)

    def _measure(self) -> StepFacts:
        state, clock = states_of(self._qpos, self._qvel, self.handles), self._step.clock
        linear, angular = state.linear_velocity_m_s, state.angular_velocity_rad_s
        # The gait makes the velocity swing: means go over about half a cycle.
        blend = STEP_S * 2.0 * self.gait.frequency_hz
        self._linear_mean = self._linear_mean + blend * (linear[:, :2] - self._linear_mean)
        self._yaw_mean = self._yaw_mean + blend * (angular[:, 2] - self._yaw_mean)
        soles = self._geom_xpos[:, self.handles.sole_geoms]
        position = soles.mean(axis=2)
        # A robot that was just placed has no foot velocity yet.
        speed = np.linalg.norm((position - self._foot_position)[..., :2], axis=-1) / STEP_S
        speed *= self._age[:, None] > 1
        self._foot_position = position.copy()
        self._sole_z = soles[..., 2] - self._sole_radius
        self._foot_height = (self._sole_z - self.terrain.at(soles[..., :2])).min(axis=-1)
        self._foot_contact = self._sensors[:, self.handles.foot_touch] > 1.0
        base_z = self._qpos[:, self.handles.root_qpos + 2]
        self._height = base_z - self.terrain.at(position[..., :2]).mean(axis=1)
        joint_rad = state.joint_rad
        if self.footing is not None:
            joint_rad = joint_rad - self._step.footholds.shown[0, :, : self.num_actions]
        acceleration = (state.joint_rad_s - self._joint_velocity) / STEP_S
        self._joint_velocity = state.joint_rad_s.copy()
        return StepFacts(
            command=clock.command,
            moving=clock.moving,
            linear_velocity=linear,
            angular_velocity=angular,
            linear_mean=self._linear_mean,
            yaw_mean=self._yaw_mean,
            gravity=levelled(state.gravity, self.robot, self.terrain, self._step.pose),
            height_m=self._height,
            torque_nm=self._force[:, self.handles.actuators[: self.num_actions]],
            joint_rad=joint_rad,
            joint_rad_s=state.joint_rad_s,
            joint_acceleration=acceleration,
            action=self._step.action,
            previous_action=self._previous,
            older_action=self._older,
            foot_phase=self.gait.foot_phase(clock.phase),
            foot_contact=self._foot_contact,
            foot_height_m=self._foot_height,
            foot_speed_m_s=speed,
        )

    def _fallen(self, facts: StepFacts) -> Mask:
        height = self._com[:, self.handles.root_body, 2] - self._sole_z.min(axis=(1, 2))
        broken = ~np.isfinite(self._qpos).all(axis=1) | (np.abs(self._qvel).max(axis=1) > 100)
        return broken | fallen(facts.gravity, height, self.robot.fall, self.config.fall_slack)

    def _reset(self, ids: NDArray[np.intp]) -> None:
        n, rng, h = len(ids), self.rng, self.handles
        self.batch.reset(ids, stage=mujoco.mjtStage.mjSTAGE_NONE)
        q, v = h.root_qpos, h.root_dof
        xy, yaw = self.course.place(ids)
        around = xy[:, None] + rng.uniform(-0.35, 0.35, (n, 16, 2))
        self._qpos[ids, q : q + 2] = xy
        ground = self.terrain.at(around).max(axis=1)
        self._qpos[ids, q + 2] = ground + self.robot.spawn_height_m + rng.uniform(-0.03, 0.02, n)
        half = np.stack([np.cos(yaw / 2), np.zeros(n), np.zeros(n), np.sin(yaw / 2)], axis=1)
        self._qpos[ids, q + 3 : q + 7] = half
        joints = self._default + rng.uniform(-0.12, 0.12, (n, len(self._default)))
        self._qpos[np.ix_(ids, h.joint_qpos)] = joints
        self._qvel[ids, v : v + 6] = rng.uniform(-0.2, 0.2, (n, 6))
        self._age[ids] = 0
        self._pipe.refill(ids, self._default)
        self._step.reset(ids)
        for array in (self._previous, self._older, self._linear_mean):
            array[ids] = 0.0
        self._yaw_mean[ids], self._joint_velocity[ids] = 0.0, 0.0
        self._height[ids], self._foot_height[ids] = self.robot.base_height_m, 0.0
        self._foot_contact[ids] = True
        self._schedule.reset(ids, self._age)

    def _note(self, facts: StepFacts, terms: dict[str, Array], fell: Mask, reward: Array) -> None:
        walking = facts.moving & (self._age > 50)
        note = {
            "reward": float(reward.mean()) / STEP_S,
            "falls_per_minute": float(fell.mean()) / STEP_S * 60.0,
            "linear_error": _mean(
                np.linalg.norm(facts.linear_mean - facts.command[:, :2], axis=1), walking
            ),
            "stand_speed": _mean(np.linalg.norm(facts.linear_velocity[:, :2], axis=1), ~walking),
            "roll_deg": _mean(np.rad2deg(np.abs(facts.gravity[:, 1])), walking),
            "yaw_error": _mean(np.abs(facts.yaw_mean - facts.command[:, 2]), walking),
        }
        for name, value in terms.items():
            note[f"term_{name}"] = float(value.mean()) * self._weight(name)
        for name, value in note.items():
            self._statistics.setdefault(name, []).append(value)


def _mean(values: Array, where: Mask) -> float:
    return float(values[where].mean()) if where.any() else 0.0
