"""One episode in progress: spawn, settle, drive until it ends, and collect the rollout."""

import math
from collections.abc import Callable
from dataclasses import asdict, replace
from hashlib import sha256
from typing import cast

import mujoco
import numpy as np

from ...formats.core.episode import Episode
from ...formats.core.rollout import (
    REST_EVENT,
    STATE_RATE_HZ,
    Action,
    ActionSpan,
    EndReason,
    Event,
    Rollout,
)
from ...wayfinding.storeys import ground_of
from ..controllers import (
    STOPPED,
    Chooser,
    Coasting,
    Controller,
    Decision,
    Pose,
    Task,
    Teleporter,
)
from ..physics.joined_floor import STOREY_M
from ..physics.outcome import OutcomeWatch
from ..robots import POLICY_DECIMATION, TIMESTEP_S
from .config import ReplayConfig
from .ending import Ending
from .jumps import place_along
from .metrics import rollout_metrics
from .recorder import STEPS_PER_SAMPLE, Recorder
from .rollout_facts import expert_labels, provenance, state_in_words
from .tasks import entry_of, task_of
from .world import World

TILT_EVENT = "tilt"  # kind of the first posture on stairs that were a fall on level ground
SAMPLES_PER_POLICY = POLICY_DECIMATION // STEPS_PER_SAMPLE


class EpisodeRun:
    """An episode of one robot and one controller, from spawning to its rollout.

    Attributes:
        tick: samples since the start; the time is `tick / STATE_RATE_HZ`.
        command: the one in force.
        touched: tick of the last contact of each part that touched an obstacle.
        on_decision: called with the tick and each decision, before the robot obeys.
    """

    def __init__(
        self,
        world: World,
        episode: Episode,
        config: ReplayConfig,
        choose: Callable[[Task], Chooser] | None = None,
        control: Callable[[Task], Controller] | None = None,
    ) -> None:
        """Prepare an episode.

        Args:
            choose: see `replay_in`.
            control: returns the controller of a task; the one that `config` names when None.
        """
        self.world, self.episode, self.config = world, episode, config
        self.choose, self.control = choose, control
        self.entry = entry_of(world, config, choose is not None, control is not None)
        self.controller_config = getattr(config, config.controller)
        self.recorder = Recorder(world)
        self.watch = OutcomeWatch(
            world.data, world.handles, world.robot.fall, world.surface, config.outcome, world.ground
        )
        self.events: list[Event] = []
        self.actions: list[tuple[Action, int]] = []
        self.motions = 0  # continuous ones that a policy chose
        self.facts: dict[str, object] = {}
        self.touched: dict[str, int] = {}
        self.ending = Ending(self.watch, config)
        self.tick, self.command = 0, STOPPED
        self.on_decision: Callable[[int, Decision], None] | None = None

    def rollout(self) -> Rollout:
        """Replay the episode; call it once."""
        end = self.begin()
        while end is None:
            end = self.advance()
        return self.finish(end)

    def begin(self) -> EndReason | None:
        """Spawn the robot and let it settle; return why the episode ended, None if it goes on.

        Without physics in between, the whole episode is done here.
        """
        x, y, z = self.episode.start_position_world_m.tolist()
        coasting = Coasting() if self.entry.teleports else self.world.coasting
        self.task = task = task_of(self.world, self.episode, self.config, coasting)
        self.facts["coasting"] = asdict(task.coasting)
        if self.choose is not None:
            self.task = task = replace(task, chooser=self.choose(task))
        text = f"{self.config.seed}/{self.episode.episode_id}".encode()
        rng = np.random.default_rng(np.frombuffer(sha256(text).digest(), dtype=np.uint32))
        noise_rad = self.config.spawn_joint_noise_rad
        self.world.spawn(
            Pose(x, y, self.episode.start_yaw_rad),
            rng.normal(0.0, noise_rad, len(self.world.robot.joints)),
            z,
        )
        estimated = self.config.state == "estimated"
        self.world.gait.reset(int(rng.integers(2**32)) if estimated else None)
        stuck_in = self.world.in_collision()
        if stuck_in:
            self.recorder.sample(STOPPED)
            self.note("collision_start", ", ".join(sorted(stuck_in)))
            return EndReason.COLLISION_START
        driver = (
            self.entry.build(task, self.controller_config)
            if self.control is None
            else self.control(task)
        )
        if self.entry.teleports:
            return place_along(self, cast(Teleporter, driver))
        # Kept only if physics diverges while settling: a rollout has at least one sample.
        self.recorder.sample(STOPPED)
        if not self._settle():
            return EndReason.DIVERGED
        self.recorder.drop_after(0)
        self.controller = controller = cast(Controller, driver)
        self._control_every = STATE_RATE_HZ // controller.rate_hz
        limit = self.config.outcome.timeout_factor * controller.nominal_s * STATE_RATE_HZ
        self._limit = round(limit) if math.isfinite(limit) else limit
        self.facts["nominal_s"] = round(controller.nominal_s, 3)
        return None

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

    def advance(self) -> EndReason | None:
        """Simulate to the next policy step; return why the episode ended, None if it goes on.

        Raises:
            Exception: whatever the controller raised. Nothing has happened since the last step
                then, or since the sample before, and the same call goes on from there.
        """
        world, ending = self.world, self.ending
        while not ending.complete(self.tick):
            if not ending.begun and self.tick % self._control_every == 0:
                end = self._decide()
                if end is not None:
                    return end
            self.recorder.sample(self.command)
            if self.tick % SAMPLES_PER_POLICY == 0:
                world.act(self.command)
            mujoco.mj_step(world.model, world.data, nstep=STEPS_PER_SAMPLE)
            self.tick += 1
            if self.tick % SAMPLES_PER_POLICY == 0:
                return self._judge()
        self.recorder.sample(STOPPED)
        if ending.fallen:
            return EndReason.FALL
        if ending.rest_tick is not None:
            self.recorder.drop_after(ending.rest_end + 1)
            last_s = ending.rest_end / STATE_RATE_HZ
            self.events = [event for event in self.events if event.time_s <= last_s]
            self.events.append(Event(ending.rest_tick / STATE_RATE_HZ, REST_EVENT, ""))
        return self.end_of_stop()

    def _decide(self) -> EndReason | None:
        """Let the controller decide; return a timeout, or None."""
        decision = self.controller.step(self.tick / STATE_RATE_HZ, self.world.pose)
        if self.on_decision is not None:
            self.on_decision(self.tick, decision)
        self.command = self.world.paced(decision.command)
        for kind, detail in decision.notes:
            self.note(kind, detail)
        if decision.action is not None:
            self.actions.append((decision.action, self.tick))
        self.motions += decision.chosen
        if decision.chosen or decision.action is not None:
            self.watch.acted()
        if decision.done:
            self.command = STOPPED
            self.note("stop", "")
            self.ending.stop(self.tick)
        elif self.tick >= self._limit or self._choices > self.config.outcome.timeout_actions:
            self.note("timeout", f"{self.tick / STATE_RATE_HZ:.1f} s")
            return EndReason.TIMEOUT
        return None

    def _judge(self) -> EndReason | None:
        """Look at the robot after a policy step; return why the episode ended, or None."""
        ending = self.ending
        if self._diverged():
            self.recorder.drop_broken()
            return EndReason.DIVERGED
        self._watch_contacts(self.tick)
        verdict = None if ending.fallen else self.watch.check()
        if self.watch.tilt and not any(event.kind == TILT_EVENT for event in self.events):
            self.note(TILT_EVENT, self.watch.tilt)
        self.watch.tilt = ""
        if verdict is None:
            ending.look(self.tick)
            return None
        reason, detail = verdict
        if reason is EndReason.FALL:
            self.note(reason.value, detail)
            self.command = STOPPED
            ending.fall(self.tick)
        elif not ending.begun:
            self.note(reason.value, detail)
            return reason
        return None

    @property
    def _choices(self) -> int:
        """Number of actions or motions so far."""
        return len(self.actions) + self.motions

    def end_of_stop(self) -> EndReason:
        """Return whether a stop here is a success; `finish` tells near from far."""
        pose = self.world.pose
        x, y, z = self.episode.goal_position_world_m.tolist()
        near = math.hypot(pose.x_m - x, pose.y_m - y) <= self.config.outcome.success_m
        if self.world.staircase is not None:
            near &= abs(self.world.foot_z_m - z) < STOREY_M
        return EndReason.SUCCESS if near else EndReason.STOPPED_FAR

    def _watch_contacts(self, tick: int) -> None:
        """Note when a part of the robot begins to touch an obstacle, not while it goes on."""
        for part in sorted(self.world.touched_parts()):
            if tick - self.touched.get(part, -STATE_RATE_HZ) > 0.2 * STATE_RATE_HZ:
                self.note("contact", part)
            self.touched[part] = tick

    def note(self, kind: str, detail: str) -> None:
        """Add an event at the present sample."""
        self.events.append(Event(len(self.recorder) / STATE_RATE_HZ, kind, detail))

    def _diverged(self) -> bool:
        """Return whether physics diverged, and keep the diverged state among the facts."""
        what = self.watch.diverged()
        if what is None:
            return False
        self.note(EndReason.DIVERGED.value, what)
        self.facts["diverged_state"] = state_in_words(self.world.data)
        return True

    def finish(self, end: EndReason) -> Rollout:
        """Return the record of an episode that ended."""
        arrays = self.recorder.arrays()
        world, config, count = self.world, self.config, len(self.recorder)
        stops = [start for _, start in self.actions[1:]] + [count]
        spans = [
            ActionSpan(action, start, stop)
            for (action, start), stop in zip(self.actions, stops, strict=bool(self.actions))
        ]
        place, quat = arrays["position_world_m"], arrays["quat_wxyz"]
        facts = provenance(world, config, teleports=self.entry.teleports)
        over = self.episode.staircases
        ground = ground_of(world.bundle, self.episode) if over else world.freemap
        metrics = rollout_metrics(self.episode, ground, place, end)
        if end is EndReason.STOPPED_FAR and metrics.success:
            end = EndReason.STOPPED_NEAR
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
