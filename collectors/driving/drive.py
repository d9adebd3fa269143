"""A drive: an episode that a person decides, step by step, on disk from the first one on."""

from collections.abc import Mapping
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ...formats.core.episode import Episode
from ...formats.core.errors import FileFormatError, InputError
from ...formats.core.geometry import path_length, space_evenly
from ...formats.core.rollout import HUMAN, STATE_RATE_HZ, EndReason, Event, Rollout
from ...formats.mcap.facts import episode_to_json
from ...wayfinding.distance import AGENT_RADIUS_M, distance_field
from ...wayfinding.planning import floor_z, simplify_path
from ..controllers import Decision
from ..replay.checkpoint import Checkpoint, checkpoint, rewind
from ..replay.config import ReplayConfig
from ..replay.episode_run import EpisodeRun
from ..replay.replay import warnings_logged
from ..replay.world import World
from .controls import ActionChooser, ActionControl, Controls, VelocityControl, WaitingError
from .journal import Journal, Recording, read_journal

DISCRETE = "speed"  # controller whose discrete actions the person chooses; others take velocities
UNDO_EVENT = "undo"  # kind of the events at which something was taken back
_EVERY = STATE_RATE_HZ  # ticks between two checkpoints, and two digests of the state
_MOST_CHECKPOINTS = 30  # of 2 MB each
_SHORTEST_M = 1.0
_EVEN_M, _SPACING_M, _TOLERANCE_M = 0.1, 1.5, 0.1


class Drive:
    """An episode in progress with a person at the controls; nothing of it is lost by a kill.

    Attributes:
        run: the episode.
        end: why it ended; None while it goes on. What ended it can be taken back.
    """

    def __init__(
        self,
        world: World,
        episode: Episode,
        config: ReplayConfig,
        controls: Controls,
        path: Path,
        header: Mapping[str, Any] | None = None,
    ) -> None:
        """Begin a drive, or go on with the one whose journal is in `path`.

        Args:
            config: with the controller `DISCRETE` for discrete actions; `path` for velocities.
            header: settings that the journal of a new drive begins with; there is none before the
                first decision.

        Raises:
            InputError: the robot stands in an obstacle at the start.
            FileFormatError: the journal is damaged, or physics now gives other states.
        """
        recording = read_journal(path) if header is None else None
        self.controls = controls
        self.run = _episode_run(world, episode, config, controls)
        self.end: EndReason | None = None
        ended = self.run.begin()
        if ended is not None:
            raise InputError(f"episode {episode.episode_id} cannot be started here: {ended}")
        self._path, self._header = path, header
        self._journal: Journal | None = None
        self.run.on_decision = self._decided
        self._first = checkpoint(self.run)
        self._checkpoints: list[Checkpoint] = []
        if recording is not None:
            self._catch_up(recording, path)

    @property
    def time_s(self) -> float:
        """Time since the start [s]."""
        return self.run.tick / STATE_RATE_HZ

    @property
    def own_episode(self) -> Episode:
        """The episode that a free drive is; see `driven_episode`."""
        run = self.run
        track = run.recorder.arrays()["position_world_m"][:, :2]
        return driven_episode(run.world, run.episode, track)

    def step(self) -> bool:
        """Simulate 20 ms; return whether time passed, which waits while nothing is asked for."""
        if self.end is not None:
            return False
        try:
            self.end = self.run.advance()
        except WaitingError:
            return False
        tick = self.run.tick
        if self.end is None and tick % _EVERY == 0 and not self.run.ending.begun:
            if not self.controls.recorded:
                self._written.state(tick, state_digest(self.run.world))
            self._checkpoints.append(checkpoint(self.run))
            del self._checkpoints[:-_MOST_CHECKPOINTS]
        return True

    def undo(self, seconds: float) -> None:
        """Go back to the last stored state that is at least so long ago; the first one at most."""
        tick, world = self.run.tick, self.run.world
        if tick == 0:
            return
        target = tick - seconds * STATE_RATE_HZ
        self._checkpoints = [c for c in self._checkpoints if c.tick <= target]
        back = self._checkpoints[-1] if self._checkpoints else self._first
        self._written.undo(tick, back.tick)
        self.controls.release()
        rewind(self.run, back)
        self._written.state(back.tick, state_digest(world))
        self.end = None

    def keep(self, episode: Episode) -> None:
        """Close a drive that has ended, as the walk of `episode`."""
        if self.end is None:
            raise ValueError("the drive goes on; it can be kept once it has ended")
        self._written.keep({"episode": episode_to_json(episode), "end_reason": str(self.end)})

    def close(self) -> None:
        """Leave the drive as it is, to be gone on with later."""
        if self._journal is not None:
            self._journal.close()

    @property
    def _written(self) -> Journal:
        """The journal, begun or gone on with now."""
        if self._journal is None:
            self._journal = Journal(self._path, self._header)
        return self._journal

    def _decided(self, tick: int, decision: Decision) -> None:
        if tick not in self.controls.recorded:
            self._written.decided(tick, decision)

    def _catch_up(self, recording: Recording, path: Path) -> None:
        """Repeat what was decided before."""
        self.controls.recorded = recording.decisions
        last = max(recording.decisions, default=-1)
        try:
            while self.run.tick <= last:
                if not self.step():  # it ended before, or has no decision here
                    raise _other_physics(self.run, path)
                _check(self.run, recording, path)
        finally:  # the next drive has the same controls
            self.controls.recorded = {}


def replay_drive(
    world: World, episode: Episode, config: ReplayConfig, path: Path, driver: str
) -> Rollout:
    """Return the rollout of the drive in a journal, as the walk of `episode`.

    Raises:
        FileFormatError: the journal is damaged or has no end, or physics now gives other states.
    """
    recording = read_journal(path)

    def refuse(tick: int, _: Decision) -> None:
        if tick not in recording.decisions:
            raise _no_end(path)

    run = _episode_run(world, episode, config, Controls(recording.decisions))
    run.on_decision = refuse
    with warnings_logged():
        end = run.begin()
        try:
            while end is None:
                end = run.advance()
                _check(run, recording, path)
        except WaitingError as error:
            raise _no_end(path) from error
    rollout = run.finish(end)
    undone = [(tick / STATE_RATE_HZ, to / STATE_RATE_HZ) for tick, to in recording.undone]
    last_s = rollout.metrics.duration_s
    events = [
        Event(to, UNDO_EVENT, f"{tick - to:.2f} s taken back")
        for tick, to in undone
        if to <= last_s
    ]
    return replace(
        rollout,
        controller=HUMAN,
        events=tuple(sorted([*rollout.events, *events], key=lambda event: event.time_s)),
        facts={**rollout.facts, "driver": driver, "undone": undone},
    )


def driven_episode(world: World, episode: Episode, track_xy_m: np.ndarray) -> Episode:
    """Return a free drive as an episode without words: its own way, and its end as the goal.

    Args:
        episode: what the drive began with.
        track_xy_m: (N, 2) where the base was.

    Raises:
        InputError: the drive is too short to be a path.
    """
    if path_length(track_xy_m) < _SHORTEST_M:
        raise InputError(f"a drive of less than {_SHORTEST_M:g} m is no path; drive on, or reset")
    even = space_evenly(track_xy_m, _EVEN_M)
    points = np.column_stack([even, floor_z(world.freemap, even)])
    path = simplify_path(
        world.freemap, points, radius_m=0.0, spacing_m=_SPACING_M, tolerance_m=_TOLERANCE_M
    )
    goal = path[-1]
    field = distance_field(world.freemap, goal[:2], AGENT_RADIUS_M)
    geodesic_m = float(field.at(episode.start_position_world_m[None, :2])[0])
    return replace(
        episode,
        goal_position_world_m=goal,
        reference_path_world_m=path,
        geodesic_distance_m=geodesic_m if np.isfinite(geodesic_m) else path_length(path),
    )


def state_digest(world: World) -> str:
    """Return a digest of the simulation's state."""
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(world.model, kind))
    mujoco.mj_getState(world.model, world.data, state, kind)
    return sha256(state.tobytes()).hexdigest()[:16]


def _episode_run(
    world: World, episode: Episode, config: ReplayConfig, controls: Controls
) -> EpisodeRun:
    if config.controller == DISCRETE:
        return EpisodeRun(
            world,
            episode,
            config,
            lambda task: ActionChooser(controls),
            lambda task: ActionControl(task, config.speed),
        )
    return EpisodeRun(world, episode, config, control=lambda task: VelocityControl(task, controls))


def _check(run: EpisodeRun, recording: Recording, path: Path) -> None:
    """Raise unless the state is the one that the journal has for this tick, if it has one."""
    digest = recording.digests.get(run.tick)
    if digest is not None and not run.ending.begun and digest != state_digest(run.world):
        raise _other_physics(run, path)


def _other_physics(run: EpisodeRun, path: Path) -> FileFormatError:
    return FileFormatError(
        path,
        f"physics gives another state at {run.tick / STATE_RATE_HZ:.0f} s than the drive had: it "
        "was driven in another version of the scene or of vlnpe, or on another kind of processor",
    )


def _no_end(path: Path) -> FileFormatError:
    return FileFormatError(path, "the drive has no end; go on with it, or end it with --finish")
