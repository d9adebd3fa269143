"""Find the way on the map that a text describes.

The follower looks at the shortest ways from where it stands to every place of the level, and
carries a text's sub-goals out along each: it must come by the things, pass the doors, make the
turns and stop, in the order told. Turns that it would make without having been told cost a
little, a sub-goal that cannot be met ends a way. The cheapest way that is left is walked; when
none is left, the follower is lost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..language.parse import parse
from .goals import SubGoal, UnfollowableError, sub_goals
from .places import place_cost, stop_cost
from .ways import Ways
from .world import Array, World

_PER_METRE = 0.03
_STRANGE = 0.25  # share of words outside of the grammar from which a text means nothing
_LOST = 4.0  # a way that costs more is none that the text means
_LAG = 8  # cells: a place may be told this late, as turns are noticed after the corner
_TIGHT = 10  # cells: a turn is this near to the end of a distance told before it
_HINT_RAD = np.deg2rad(20.0)
_AROUND_RAD = np.deg2rad(115.0)


@dataclass(frozen=True)
class Followed:
    """How following ended.

    Attributes:
        position_m: (2,) where [m].
        lost: why it gave up, "" when it did not.
        legs: how many sub-goals it reached.
    """

    position_m: Array
    lost: str
    legs: int


def follow(text: str, world: World, start_m: Array, start_yaw_rad: float) -> Followed:
    """Follow a text from a pose: `start_m` (2,) [m] and heading [rad]."""
    ways = world.ways(start_m, start_yaw_rad)
    read = parse(text)
    if len(read.strange) > _STRANGE * max(1, read.words):
        return Followed(ways.points_m[0], "words that make no sentence", 0)
    try:
        goals = sub_goals(read)
    except UnfollowableError as error:
        return Followed(ways.points_m[0], str(error), 0)
    here = np.full(len(ways.points_m), np.inf)
    here[0] = 0.0  # cost of having just met the last sub-goal at a cell
    walked = False
    for number, goal in enumerate(goals):
        stopping = goal.kind == "stop"
        if stopping and number and goals[number - 1].kind == "stop":
            after = here + stop_cost(goal, ways, world)  # a second thing at the same place
        else:
            after = _met(goal, here, ways, world, walked)
        if not np.isfinite(after).any():
            best = int(np.argmin(here))
            return Followed(ways.points_m[best], f"lost at {goal.said!r}", number)
        if goal.kind != "see":
            here, walked = after, goal.kind == "walk"
    best = int(np.argmin(here + _PER_METRE * ways.along_m))
    lost = "" if here[best] <= _LOST else "no way fits well enough"
    return Followed(ways.points_m[best], lost, len(goals))


def _met(goal: SubGoal, here: Array, ways: Ways, world: World, walked: bool) -> Array:
    """Cost (N,) of meeting a sub-goal at each cell, after the last was met somewhere before."""
    if goal.kind == "walk":
        return _walk(goal, here, ways)
    reached = ways.lately(here, _TIGHT) if walked else ways.onward(here)
    if goal.kind == "turn":
        return _turn(goal, reached, ways)
    if goal.kind == "stop" and goal.noun is None:
        return ways.lately(here, _LAG)
    if goal.kind == "stop":
        return reached + stop_cost(goal, ways, world)
    return reached + ways.lately(place_cost(goal, ways, world), _LAG)


def _turn(goal: SubGoal, reached: Array, ways: Ways) -> Array:
    if goal.side == "around":
        return np.where(np.abs(ways.long_turn_rad) >= _AROUND_RAD, reached, np.inf)
    sign = 1.0 if goal.side == "left" else -1.0
    angle = sign * ways.turn_rad
    before = reached[ways.before[1]]
    made = np.where(ways.event & (angle > 0), before, np.inf)
    hint = np.where((angle >= _HINT_RAD) & ~ways.event, reached, np.inf)
    hint += 0.1 if goal.degree in ("slight", "some") else 0.5
    # Two turns close together are one bend for whoever looks two metres back.
    double = np.where(sign * ways.long_turn_rad >= np.deg2rad(110.0), reached, np.inf) + 0.4
    return np.minimum(np.minimum(made, hint), double)


def _walk(goal: SubGoal, here: Array, ways: Ways) -> Array:
    d = goal.distance_m
    low, high = (0.3, max(5.0, 2.0 * d)) if goal.vague else (0.6 * d - 0.4, 1.4 * d + 0.6)
    result = np.full_like(here, np.inf)
    steps = ways.cells_before((max(low, 0.0), high))
    chain = ways.ancestors(steps.stop)
    for k in steps:
        from_ = chain[k]
        length = ways.along_m - ways.along_m[from_]
        off = 0.05 if goal.vague else np.abs(length - d) / max(d, 1.5)
        cost = here[from_] + ways.untold - ways.untold[from_] + off
        result = np.minimum(result, np.where((length >= low) & (length <= high), cost, np.inf))
    return result
