"""Going back in an episode: copies of its state between two policy steps."""

from __future__ import annotations

from copy import copy, deepcopy
from dataclasses import dataclass
from typing import Any

import mujoco
from numpy.typing import NDArray

from ..controllers import Controller
from .ending import Ending
from .episode_run import EpisodeRun


@dataclass(frozen=True)
class Checkpoint:
    """An episode at one of its policy steps, before it began to end; see `rewind`.

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


def checkpoint(run: EpisodeRun) -> Checkpoint:
    """Return a copy of the state between two policy steps, before the episode begins to end."""
    world = run.world
    return Checkpoint(
        tick=run.tick,
        data=copy(world.data),
        gait=tuple(array.copy() for array in world.gait.memory),
        controller=_copied(run, run.controller),
        command=run.command,
        trace=run.watch.trace,
        counts=(len(run.recorder), len(run.events), len(run.actions), run.motions),
        touched=dict(run.touched),
    )


def rewind(run: EpisodeRun, to: Checkpoint) -> None:
    """Go back to a checkpoint of this run; the same decisions then give the same bits."""
    world = run.world
    mujoco.mj_copyData(world.data, world.model, to.data)
    for array, kept in zip(world.gait.memory, to.gait, strict=True):
        array[:] = kept
    run.tick, run.command = to.tick, to.command
    run.controller, run.watch.trace = _copied(run, to.controller), to.trace
    samples, events, actions, run.motions = to.counts
    run.recorder.drop_after(samples)
    del run.events[events:], run.actions[actions:]
    run.touched = dict(to.touched)
    run.ending = Ending(run.watch, run.config)
    run.facts.pop("diverged_state", None)


def _copied(run: EpisodeRun, controller: Controller) -> Controller:
    tasks = (run.task, *run.task.legs)
    shared = (*tasks, *(v for task in tasks for v in vars(task).values()))
    shared = (*shared, getattr(controller, "source", None))
    return deepcopy(controller, {id(value): value for value in shared})
