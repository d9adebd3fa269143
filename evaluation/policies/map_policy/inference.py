"""Finds where an instruction leads on the map seen so far: to its end, or to a frontier."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ....formats.core.frames import Array
from ....instruction_gen.language.reader import read_text
from ..follower.costs import prefix_costs
from ..follower.goals import Part, SubGoal, UnfollowableError, parts_of
from ..follower.ways import Ways, ways_from
from .frontiers import Frontier, find_frontiers, promise
from .routes import Routes, bearing
from .seen_map import SeenMap
from .seen_world import SeenWorld, seen_world

_SAME_M = 0.7  # frontiers this close are one


@dataclass(frozen=True)
class Weights:
    """Weights of the choice between ends and frontiers; tuned on four generated homes.

    Attributes:
        per_metre: cost of a metre of the way that the instruction describes.
        detour: cost of a way that is not the shortest.
        good: an end that costs less is walked to at once; the limit grows by `patience` per action
            taken, so that after a long search a worse end will do.
        met: worth of a sub-goal that is met on the way to a frontier.
        promise: worth of a frontier that fits the next landmark.
        distance: per metre from the robot.
        facing: per radian that the robot must turn; VLN-PE's α.
        size: per metre of border, up to three.
        keep: worth of the frontier that the robot is already on its way to.
    """

    per_metre: float = 0.03
    detour: float = 0.6
    good: float = 1.3
    patience: float = 0.008
    met: float = 1.0
    promise: float = 1.0
    distance: float = 0.12
    facing: float = 0.25
    size: float = 0.2
    keep: float = 0.8


@dataclass(frozen=True)
class Target:
    """The place to go to next.

    Attributes:
        xy_m: (2,) in the start frame.
        is_end: the instruction ends there; a frontier otherwise.
        why: in words.
    """

    xy_m: Array
    is_end: bool
    why: str


@dataclass(frozen=True)
class _Reading:
    """One tree of ways, and what meeting the first sub-goals costs at its cells."""

    ways: Ways
    costs: list[Array]
    extra: float

    @property
    def met(self) -> int:
        return len(self.costs) - 1


def parts_of_text(text: str) -> Sequence[Part]:
    """Return the parts of an instruction; one that never says to stop ends with a stop.

    Raises:
        UnfollowableError: If it says nothing at all.
    """
    try:
        return parts_of(read_text(text))
    except UnfollowableError:
        return parts_of(read_text(f"{text.rstrip(' .')}. Stop."))


def choose_target(
    goals: Sequence[SubGoal],
    seen: SeenMap,
    routes: Routes,
    pose: Array,
    exhausted: Sequence[Array],
    *,
    begin: Array,
    current: Target | None = None,
    step: int = 0,
    explore: bool = True,
    weights: Weights | None = None,
) -> Target | None:
    """Return where the instruction leads on the map seen so far.

    All that it says of a level is read from the first pose there on, as `policies.follower` does on
    a complete map. If it fits a way well, the way's end is the target. Otherwise a frontier is, by
    a score of distance, of how much of the instruction leads there, and of how well what is seen
    around it fits the next sub-goal.

    Args:
        routes: ways from where the robot stands.
        pose: (3,) x, y [m], yaw [rad] of the robot.
        exhausted: points (2,) of frontiers that showed nothing new.
        begin: (3,) pose at which the robot came to the level.
        current: where the robot is going.
        step: number of actions taken so far.
        explore: whether frontiers may be chosen.

    Returns:
        The target; None if nothing can be reached.
    """
    weights = weights or Weights()
    world = seen_world(seen)
    if not world.free.any():
        return None
    readings = [
        _Reading(ways, prefix_costs(goals, ways, world), weights.detour * (number > 0))
        for number, ways in enumerate(ways_from(world, begin[:2], float(begin[2])))
    ]
    end = _best_end(readings, len(goals), weights)
    if end is not None and end[1] <= weights.good + weights.patience * step:
        return Target(end[0], True, f"the instruction ends here, cost {end[1]:.2f}")
    best: tuple[float, Frontier, int] | None = None
    for frontier in find_frontiers(seen, routes.reachable()) if explore else ():
        if any(np.linalg.norm(frontier.xy_m - old) < _SAME_M for old in exhausted):
            continue
        score, met = _score(frontier, goals, readings, world, routes, pose, weights)
        if current is not None and np.linalg.norm(frontier.xy_m - current.xy_m) < _SAME_M:
            score -= weights.keep
        if best is None or score < best[0]:
            best = score, frontier, met
    if best is not None:
        score, frontier, met = best
        said = goals[met].said if met < len(goals) else "the end"
        return Target(frontier.xy_m, False, f"frontier for {said!r}, score {score:.2f}")
    if end is not None:
        return Target(end[0], True, f"the instruction may end here, cost {end[1]:.2f}")
    deepest = max(readings, key=lambda reading: reading.met)
    cell = int(np.argmin(deepest.costs[-1]))
    why = f"{deepest.met} of {len(goals)} sub-goals lead here, and no further"
    return Target(deepest.ways.points_m[cell], True, why)


def _best_end(
    readings: Sequence[_Reading], count: int, weights: Weights
) -> tuple[Array, float] | None:
    """Return where the whole instruction fits best, and at what cost; None where it never does."""
    best: tuple[Array, float] | None = None
    for reading in readings:
        if reading.met < count:
            continue
        total = reading.costs[-1] + weights.per_metre * reading.ways.along_m + reading.extra
        cell = int(np.argmin(total))
        if best is None or total[cell] < best[1]:
            best = reading.ways.points_m[cell], float(total[cell])
    return best


def _score(
    frontier: Frontier,
    goals: Sequence[SubGoal],
    readings: Sequence[_Reading],
    world: SeenWorld,
    routes: Routes,
    pose: Array,
    weights: Weights,
) -> tuple[float, int]:
    """Return the score of a frontier, less is better, and how many sub-goals lead to it."""
    along, met = math.inf, 0
    for reading in readings:
        gaps = np.linalg.norm(reading.ways.points_m - frontier.xy_m, axis=1)
        cell = int(np.argmin(gaps))
        for k in range(reading.met, -1, -1):
            cost = float(reading.ways.onward(reading.costs[k])[cell])
            if not math.isfinite(cost):
                continue
            value = cost + reading.extra - weights.met * k
            if value < along:
                along, met = value, k
    if not math.isfinite(along):
        along = 2.0
    goal = next((g for g in goals[met:] if g.noun is not None), None)
    score = (
        along
        - weights.promise * promise(frontier, goal, world)
        + weights.distance * min(routes.cost_to(frontier.xy_m), 100.0)
        + weights.facing * abs(bearing(pose, frontier.xy_m))
        - weights.size * min(frontier.size_m, 3.0)
    )
    return score, met
