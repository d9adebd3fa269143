"""One episode in progress: spawn, settle, drive until it ends, and collect the rollout."""

import math
from collections.abc import Callable
from dataclasses import asdict, replace
from hashlib import sha256
from typing import cast

import mujoco
import numpy as np

from ...formats.core.episode import Episode
from ...formats.core.errors import InputError
from ...formats.core.rollout import (
    REST_EVENT,
    STATE_RATE_HZ,
    Action,
    ActionSpan,
    EndReason,
    Event,
    Rollout,
)
from ..controllers import (
    CONTROLLERS,
    STOPPED,
    Chooser,
    Coasting,
    Controller,
    Pose,
    SteeredController,
    Steerer,
    Task,
    Teleporter,
    controller_for,
)
from ..physics.outcome import OutcomeWatch
from ..robots import POLICY_DECIMATION, TIMESTEP_S
from .config import ReplayConfig
from .ending import Ending
from .metrics import rollout_metrics
from .recorder import Recorder
from .rollout_facts import expert_labels, provenance
from .world import World

STEPS_PER_SAMPLE = round(1.0 / (STATE_RATE_HZ * TIMESTEP_S))
SAMPLES_PER_POLICY = POLICY_DECIMATION // STEPS_PER_SAMPLE


class EpisodeRun:
    """An episode of one robot and one controller, from spawning to its rollout."""

    def __init__(
        self,
        world: World,
        episode: Episode,
        config: ReplayConfig,
        choose: Callable[[Task], Chooser] | None = None,
        steer: Callable[[Task], Steerer] | None = None,
    ) -> None:
        self.world, self.episode, self.config = world, episode, config
        self.choose, self.steer = choose, steer
        self.entry = controller_for(world.robot, config.controller)
        if choose is not None and not self.entry.discrete:
            valid = ", ".join(name for name, entry in CONTROLLERS.items() if entry.discrete)
            raise InputError(
                f"controller {config.controller!r} takes no discrete actions; valid: {valid}"
            )
        if steer is not None and self.entry.teleports:
            valid = ", ".join(name for name, entry in CONTROLLERS.items() if not entry.teleports)
            raise InputError(
                f"controller {config.controller!r} takes no velocities or waypoints; valid: {valid}"
            )
        self.controller_config = getattr(config, config.controller)
        self.recorder = Recorder(world)
        self.watch = OutcomeWatch(
            world.data, world.handles, world.robot.fall, world.surface, config.outcome
        )
        self.events: list[Event] = []
        self.actions: list[tuple[Action, int]] = []
        self.motions = 0  # continuous ones that a policy chose
        self.facts: dict[str, object] = {}
        self._touched: dict[str, int] = {}
        self.ending = Ending(self.watch, config)

    def rollout(self) -> Rollout:
        """Replay the episode; call it once."""
        x, y, _ = self.episode.start_position_world_m.tolist()
        self.task = task = Task(
            reference_xy_m=self.episode.reference_path_world_m[:, :2],
            goal_xy_m=self.episode.goal_position_world_m[:2],
            freemap=self.world.freemap,
            radius_m=self.world.robot.footprint_radius_m,
            limits=self.world.robot.command_limits,
            goal_tolerance_m=self.config.outcome.success_m,
            coasting=self.world.coasting if self.entry.coasts else Coasting(),
        )
        self.facts["coasting"] = asdict(task.coasting)
        if self.choose is not None:
            self.task = task = replace(task, chooser=self.choose(task))
        self.world.gait.reset()
        self.world.spawn(Pose(x, y, self.episode.start_yaw_rad), self._joint_noise())
        stuck_in = self.world.in_collision()
        if stuck_in:
            self.recorder.sample(STOPPED)
            self._note("collision_start", ", ".join(sorted(stuck_in)))
            return self._finish(EndReason.COLLISION_START)
        driver = (
            self.entry.build(task, self.controller_config)
            if self.steer is None
            else SteeredController(task, self.steer(task))
        )
        if self.entry.teleports:
            return self._finish(self._jump(cast(Teleporter, driver)))
        # Kept only if physics diverges while settling: a rollout has at least one sample.
        self.recorder.sample(STOPPED)
        if not self._settle():
            return self._finish(EndReason.DIVERGED)
        self.recorder.drop_last()
        return self._finish(self._drive(cast(Controller, driver)))

    def _joint_noise(self) -> np.ndarray:
        text = f"{self.config.seed}/{self.episode.episode_id}".encode()
        rng = np.random.default_rng(np.frombuffer(sha256(text).digest(), dtype=np.uint32))
        return rng.normal(0.0, self.config.spawn_joint_noise_rad, len(self.world.robot.joints))

    def _settle(self) -> bool:
        """Stand under zero command until at rest, unrecorded; return False if physics diverged."""
        world, config = self.world, self.config
        data, handles = world.data, world.handles
        period_s = POLICY_DECIMATION * TIMESTEP_S
        for k in range(round(config.settle_most_s / period_s)):
            if k * period_s >= config.settle_least_s:
                base = data.qvel[handles.root_dof : handles.root_dof + 3]
                joints = data.qvel[handles.joint_dof]
                quiet = np.abs(base).max() < config.settled_m_s
                if quiet and np.abs(joints).max() < config.settled_rad_s:
                    break
            world.act(STOPPED)
            mujoco.mj_step(world.model, data, nstep=POLICY_DECIMATION)
            if self._diverged():
                return False
        self.facts["settle_s"] = round(float(data.time), 3)
        return True

    def _drive(self, controller: Controller) -> EndReason:
        """Let the controller drive until the episode has ended and the robot is at rest."""
        world, config, ending = self.world, self.config, self.ending
        model, data = world.model, world.data
        control_every = STATE_RATE_HZ // controller.rate_hz
        limit = config.outcome.timeout_factor * controller.nominal_s * STATE_RATE_HZ
        limit = round(limit) if math.isfinite(limit) else limit
        self.facts["nominal_s"] = round(controller.nominal_s, 3)
        command, tick = STOPPED, 0
        while not ending.complete(tick):
            if not ending.begun and tick % control_every == 0:
                decision = controller.step(tick / STATE_RATE_HZ, world.pose)
                command = decision.command
                for kind, detail in decision.notes:
                    self._note(kind, detail)
                if decision.action is not None:
                    self.actions.append((decision.action, tick))
                self.motions += decision.chosen
                if decision.chosen or decision.action is not None:
                    self.watch.acted()
                if decision.done:
                    command = STOPPED
                    self._note("stop", "")
                    ending.stop(tick)
                elif tick >= limit or self._choices > config.outcome.timeout_actions:
                    self._note("timeout", f"{tick / STATE_RATE_HZ:.1f} s")
                    return EndReason.TIMEOUT
            self.recorder.sample(command)
            if tick % SAMPLES_PER_POLICY == 0:
                world.act(command)
            mujoco.mj_step(model, data, nstep=STEPS_PER_SAMPLE)
            tick += 1
            if tick % SAMPLES_PER_POLICY:
                continue
            if self._diverged():
                self.recorder.drop_broken()
                return EndReason.DIVERGED
            self._watch_contacts(tick)
            verdict = None if ending.fallen else self.watch.check()
            if verdict is None:
                ending.look(tick)
                continue
            reason, detail = verdict
            if reason is EndReason.FALL:
                self._note(reason.value, detail)
                command = STOPPED
                ending.fall(tick)
            elif not ending.begun:
                self._note(reason.value, detail)
                return reason
        self.recorder.sample(STOPPED)
        if ending.fallen:
            return EndReason.FALL
        if ending.rest_tick is not None:
            self.events.append(Event(ending.rest_tick / STATE_RATE_HZ, REST_EVENT, ""))
        return self._stop()

    @property
    def _choices(self) -> int:
        """Number of actions or motions so far."""
        return len(self.actions) + self.motions

    def _stop(self) -> EndReason:
        """Return whether a stop here is a success."""
        pose = self.world.pose
        x, y = self.episode.goal_position_world_m[:2].tolist()
        near = math.hypot(pose.x_m - x, pose.y_m - y) <= self.config.outcome.success_m
        return EndReason.SUCCESS if near else EndReason.STOPPED_FAR

    def _jump(self, teleporter: Teleporter) -> EndReason:
        """Place the robot pose by pose; there is no physics in between."""
        world, config = self.world, self.config
        flash = config.flash
        hold = flash.steps_per_action // STEPS_PER_SAMPLE
        pose = world.pose
        for _ in range(config.outcome.timeout_actions + 1):
            jump = teleporter.jump(pose)
            for note in self.task.chooser.notes() if self.task.chooser else ():
                self._note(*note)
            self.actions.append((jump.action, len(self.recorder)))
            self.recorder.sample(STOPPED)
            self.recorder.repeat(hold - 1)
            if jump.action is Action.STOP:
                return self._stop()
            world.spawn(jump.pose)
            inside = world.in_collision()
            if inside:
                self._note("collision_target", ", ".join(sorted(inside)))
                if flash.refuse_collisions:
                    return EndReason.STUCK
            pose = jump.pose
        return EndReason.TIMEOUT

    def _watch_contacts(self, tick: int) -> None:
        """Note when a part of the robot begins to touch an obstacle, not while it goes on."""
        for part in sorted(self.world.touched_parts()):
            if tick - self._touched.get(part, -STATE_RATE_HZ) > 0.2 * STATE_RATE_HZ:
                self._note("contact", part)
            self._touched[part] = tick

    def _note(self, kind: str, detail: str) -> None:
        self.events.append(Event(len(self.recorder) / STATE_RATE_HZ, kind, detail))

    def _diverged(self) -> bool:
        """Return whether physics diverged, and keep the diverged state among the facts."""
        what = self.watch.diverged()
        if what is None:
            return False
        self._note(EndReason.DIVERGED.value, what)
        data = self.world.data
        # JSON knows no NaN, so numbers go as text.
        self.facts["diverged_state"] = {
            "qpos": [repr(v) for v in data.qpos.tolist()],
            "qvel": [repr(v) for v in data.qvel.tolist()],
            "ctrl": [repr(v) for v in data.ctrl.tolist()],
        }
        return True

    def _finish(self, end: EndReason) -> Rollout:
        arrays = self.recorder.arrays()
        world, config, count = self.world, self.config, len(self.recorder)
        stops = [start for _, start in self.actions[1:]] + [count]
        spans = [
            ActionSpan(action, start, stop)
            for (action, start), stop in zip(self.actions, stops, strict=bool(self.actions))
        ]
        place, quat = arrays["position_world_m"], arrays["quat_wxyz"]
        facts = provenance(world, config, teleports=self.entry.teleports)
        metrics = rollout_metrics(self.episode, world.freemap, place, end)
        return Rollout(
            episode=self.episode,
            robot=world.robot.name,
            controller=config.controller,
            joint_names=world.robot.joint_names,
            foot_names=world.robot.foot_names,
            actions=tuple(spans),
            events=tuple(sorted(self.events, key=lambda event: event.time_s)),
            end_reason=end,
            metrics=replace(metrics, recovered=self.ending.recovered, down=self.ending.down),
            labels=() if self.actions else expert_labels(self.task, place, quat),
            facts=facts | self.facts,
            **arrays,
        )
