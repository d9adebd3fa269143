"""Costs of meeting the sub-goals of a text along the ways to each place of a level.

The walker must come by the things, pass the doors, make the turns and stop, in the order of the
text. Turns that the text does not mention cost a little; a sub-goal that cannot be met ends a way.
"""

from collections.abc import Sequence

import numpy as np

from ....formats.core.frames import Array
from .goals import SubGoal
from .places import on_side, place_cost, sided_door, stop_cost
from .ways import Ways, wrap
from .world import World

_BENT = 0.4  # per radian: one walks straight where the text gives only a distance
_LAG, _DOOR_LAG = (
    4,
    8,
)  # cells: a place may be mentioned this late: turns are noticed after the corner
_ON = 3  # cells: a turn is made once one has walked on this far
_TIGHT = 10  # cells: a turn is this near to the end of a distance given before it
_HINT_RAD = np.deg2rad(20.0)
_PLAIN_RAD = np.deg2rad(33.0)
_AROUND_RAD = np.deg2rad(115.0)


def prefix_costs(goals: Sequence[SubGoal], ways: Ways, world: World) -> list[Array]:
    """Return the costs (N,) of having just met the first 0, 1, … sub-goals at each cell.

    The list ends before the first sub-goal that is met nowhere: it has one entry more than there
    are sub-goals met.
    """
    here = np.full(len(ways.points_m), np.inf)
    here[0] = 0.0
    costs: list[Array] = [here]
    walked = False
    for number, goal in enumerate(goals):
        if goal.kind == "stop" and number and goals[number - 1].kind == "stop":
            after = here + stop_cost(goal, ways, world)  # a second thing at the same place
        else:
            after = _met(goal, here, ways, world, walked)
        if not np.isfinite(after).any():
            break
        if goal.kind != "see":
            here, walked = after, goal.kind == "walk"
        costs.append(here)
    return costs


def _met(goal: SubGoal, here: Array, ways: Ways, world: World, walked: bool) -> Array:
    """Return costs (N,) of meeting a sub-goal at each cell, the last being met somewhere before."""
    if goal.kind == "walk":
        return _walk(goal, here, ways)
    reached = ways.lately(here, _TIGHT) if walked else ways.onward(here)
    if goal.kind == "turn":
        return _turn(goal, reached, ways)
    if goal.kind == "stop" and goal.noun is None:
        return ways.lately(here, _DOOR_LAG)
    if goal.kind == "stop":
        return reached + stop_cost(goal, ways, world)
    lag = _LAG if goal.noun is not None and goal.noun.kind == "object" else _DOOR_LAG
    place = ways.lately(place_cost(goal, ways, world), lag)
    if sided_door(goal) and goal.noun is not None:
        # "The door on your left": it was on that side, or a turn was made to it.
        turned = _turn(
            SubGoal("turn", goal.said, side=goal.noun.side, degree="some"), reached, ways
        )
        beside = np.where(on_side(goal, ways, lag), reached, np.inf)
        reached = np.minimum(ways.lately(turned, lag), beside)
    return reached + place


def _turn(goal: SubGoal, reached: Array, ways: Ways) -> Array:
    if goal.side == "around":
        return np.where(np.abs(ways.long_turn_rad) >= _AROUND_RAD, reached, np.inf)
    sign = 1.0 if goal.side == "left" else -1.0
    angle = sign * ways.turn_rad
    before = reached[ways.before[1]]
    clear = np.where(ways.event & (angle > 0), before, np.inf)
    slight = goal.degree in ("slight", "some")
    least = _HINT_RAD if slight else _PLAIN_RAD
    hint = np.where((angle >= least) & ~ways.event, reached, np.inf) + (0.1 if slight else 0.5)
    # Two turns close together are one bend when seen two metres back.
    double = np.where(sign * ways.long_turn_rad >= np.deg2rad(110.0), reached, np.inf) + 0.4
    turned = np.minimum(np.minimum(clear, hint), double)
    on = ways.before[_ON]
    return turned[on] + ways.unmentioned - ways.unmentioned[on]


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
        bent = np.abs(wrap(ways.heading_rad - ways.heading_rad[from_]))
        cost = here[from_] + ways.unmentioned - ways.unmentioned[from_] + off + _BENT * bent
        result = np.minimum(result, np.where((length >= low) & (length <= high), cost, np.inf))
    return result
