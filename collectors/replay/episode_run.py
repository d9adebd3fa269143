"""One episode in progress: spawn, settle, drive until it ends, and collect the rollout."""

import math
from collections.abc import Callable
from copy import copy, deepcopy
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from typing import Any, cast

import mujoco
import numpy as np
from numpy.typing import NDArray

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
from ...wayfinding.storeys import ground_of
from ..controllers import (
    CONTROLLERS,
    STOPPED,
    Chooser,
    Coasting,
    Controller,
    Decision,
    Pose,
    Task,
    Teleporter,
    controller_for,
)
from ..physics.joined_floor import STOREY_M
from ..physics.outcome import OutcomeWatch
from ..robots import POLICY_DECIMATION, TIMESTEP_S
from .config import ReplayConfig
from .ending import Ending
from .metrics import rollout_metrics
from .recorder import Recorder
from .rollout_facts import expert_labels, provenance
from .tasks import task_of
from .world import World

TILT_EVENT = "tilt"  # kind of the first posture on stairs that were a fall on level ground
STEPS_PER_SAMPLE = round(1.0 / (STATE_RATE_HZ * TIMESTEP_S))
SAMPLES_PER_POLICY = POLICY_DECIMATION // STEPS_PER_SAMPLE


@dataclass(frozen=True)
class Checkpoint:
    """An episode at one of its policy steps, before it began to end; see `EpisodeRun.rewind`.

    Attributes:
        tick: samples since the start.
        data: a copy of the simulation.
        gait: copies of the gait's memory.
        controller: a copy, which shares the task and what commands it.
        trace: poses that stuck is judged over.
        counts: numbers of samples, events, actions and motions.
    """

    tick: int
    data: mujoco.MjData
    gait: tuple[NDArray[Any], ...]
    controller: Controller
    command: tuple[float, float, float]
    trace: tuple[tuple[float, float, float], ...]
    counts: tuple[int, int, int, int]
    touched: dict[str, int]


class EpisodeRun:
    """An episode of one robot and one controller, from spawning to its rollout.

    Attributes:
        tick: samples since the start; the time is `tick / STATE_RATE_HZ`.
        command: the one in force.
        on_decision: called with the tick and each decision of the controller, before the robot
            obeys.
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
        self.entry = controller_for(world.robot, config.controller)
        if choose is not None and not self.entry.discrete:
            valid = ", ".join(name for name, entry in CONTROLLERS.items() if entry.discrete)
            raise InputError(
                f"controller {config.controller!r} takes no discrete actions; valid: {valid}"
            )
        if control is not None and self.entry.teleports:
            valid = ", ".join(name for name, entry in CONTROLLERS.items() if not entry.teleports)
            raise InputError(
                f"controller {config.controller!r} takes no velocities or waypoints; valid: {valid}"
            )
        self.controller_config = getattr(config, config.controller)
        self.recorder = Recorder(world)
        self.watch = OutcomeWatch(
            world.data, world.handles, world.robot.fall, world.surface, config.outcome, world.ground
        )
        self.events: list[Event] = []
        self.actions: list[tuple[Action, int]] = []
        self.motions = 0  # continuous ones that a policy chose
        self.facts: dict[str, object] = {}
        self._touched: dict[str, int] = {}
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
            self._note("collision_start", ", ".join(sorted(stuck_in)))
            return EndReason.COLLISION_START
        driver = (
            self.entry.build(task, self.controller_config)
            if self.control is None
            else self.control(task)
        )
        if self.entry.teleports:
            return self._jump(cast(Teleporter, driver))
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
        return self._stop()

    def _decide(self) -> EndReason | None:
        """Let the controller decide; return a timeout, or None."""
        decision = self.controller.step(self.tick / STATE_RATE_HZ, self.world.pose)
        if self.on_decision is not None:
            self.on_decision(self.tick, decision)
        self.command = self.world.paced(decision.command)
        for kind, detail in decision.notes:
            self._note(kind, detail)
        if decision.action is not None:
            self.actions.append((decision.action, self.tick))
        self.motions += decision.chosen
        if decision.chosen or decision.action is not None:
            self.watch.acted()
        if decision.done:
            self.command = STOPPED
            self._note("stop", "")
            self.ending.stop(self.tick)
        elif self.tick >= self._limit or self._choices > self.config.outcome.timeout_actions:
            self._note("timeout", f"{self.tick / STATE_RATE_HZ:.1f} s")
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
            self._note(TILT_EVENT, self.watch.tilt)
        self.watch.tilt = ""
        if verdict is None:
            ending.look(self.tick)
            return None
        reason, detail = verdict
        if reason is EndReason.FALL:
            self._note(reason.value, detail)
            self.command = STOPPED
            ending.fall(self.tick)
        elif not ending.begun:
            self._note(reason.value, detail)
            return reason
        return None

    def checkpoint(self) -> Checkpoint:
        """Return a copy of the state between two policy steps, before the episode begins to end."""
        world = self.world
        return Checkpoint(
            tick=self.tick,
            data=copy(world.data),
            gait=tuple(array.copy() for array in world.gait.memory),
            controller=self._copied(self.controller),
            command=self.command,
            trace=self.watch.trace,
            counts=(len(self.recorder), len(self.events), len(self.actions), self.motions),
            touched=dict(self._touched),
        )

    def rewind(self, to: Checkpoint) -> None:
        """Go back to a checkpoint of this run; the same decisions then give the same bits."""
        world = self.world
        mujoco.mj_copyData(world.data, world.model, to.data)
        for array, kept in zip(world.gait.memory, to.gait, strict=True):
            array[:] = kept
        self.tick, self.command = to.tick, to.command
        self.controller, self.watch.trace = self._copied(to.controller), to.trace
        samples, events, actions, self.motions = to.counts
        self.recorder.drop_after(samples)
        del self.events[events:], self.actions[actions:]
        self._touched = dict(to.touched)
        self.ending = Ending(self.watch, self.config)
        self.facts.pop("diverged_state", None)

    def _copied(self, controller: Controller) -> Controller:
        tasks = (self.task, *self.task.legs)
        shared = (*tasks, *(v for task in tasks for v in vars(task).values()))
        shared = (*shared, getattr(controller, "source", None))
        return deepcopy(controller, {id(value): value for value in shared})

    @property
    def _choices(self) -> int:
        """Number of actions or motions so far."""
        return len(self.actions) + self.motions

    def _stop(self) -> EndReason:
        """Return whether a stop here is a success."""
        pose = self.world.pose
        x, y, z = self.episode.goal_position_world_m.tolist()
        near = math.hypot(pose.x_m - x, pose.y_m - y) <= self.config.outcome.success_m
        if self.world.staircase is not None:
            near &= abs(self.world.foot_z_m - z) < STOREY_M
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
            world.spawn(jump.pose, near_z_m=world.foot_z_m)
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
