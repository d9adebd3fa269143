"""Find the way on the map that a text describes.

The follower looks at the shortest ways from where it stands to every place of the level, and
carries a text's sub-goals out along each: it must come by the things, pass the doors, make the
turns and stop, in the order of the text. Turns that the text does not mention cost a
little, a sub-goal that cannot be met ends a way. The cheapest way that is left is walked; when
none is left, the follower is lost.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..language.reader import read_text
from .goals import SubGoal, UnfollowableError, sub_goals
from .places import on_side, place_cost, sided_door, stop_cost
from .ways import Ways, wrap
from .world import Array, World

_PER_METRE = 0.03
_LOST = 4.0  # a way that costs more is none that the text means
_DETOUR = 0.6  # cost of a way that is not the shortest
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
    start = np.asarray(start_m, dtype=np.float64)[:2]
    try:
        goals = sub_goals(read_text(text))
    except UnfollowableError as error:
        return Followed(start, str(error), 0)
    tried = [_along(goals, ways, world) for ways in world.ways(start, start_yaw_rad)]
    # The shortest ways, unless what the text mentions lies on others.
    costs = [cost + _DETOUR * (number > 0) for number, (_, cost) in enumerate(tried)]
    best = tried[int(np.argmin(costs))][0] if np.isfinite(costs).any() else tried[0][0]
    return best


def _along(goals: list[SubGoal], ways: Ways, world: World) -> tuple[Followed, float]:
    """Return how following ends on one tree of ways, and what it costs; inf when lost."""
    costs = prefix_costs(goals, ways, world)
    number, here = len(costs) - 1, costs[-1]
    if number < len(goals):
        best = int(np.argmin(here))
        return Followed(ways.points_m[best], f"lost at {goals[number].said!r}", number), np.inf
    total = here + _PER_METRE * ways.along_m
    best = int(np.argmin(total))
    if here[best] > _LOST:
        return Followed(ways.points_m[best], "no way fits well enough", len(goals)), np.inf
    return Followed(ways.points_m[best], "", len(goals)), float(total[best])


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
    made = np.where(ways.event & (angle > 0), before, np.inf)
    slight = goal.degree in ("slight", "some")
    least = _HINT_RAD if slight else _PLAIN_RAD
    hint = np.where((angle >= least) & ~ways.event, reached, np.inf) + (0.1 if slight else 0.5)
    # Two turns close together are one bend when seen two metres back.
    double = np.where(sign * ways.long_turn_rad >= np.deg2rad(110.0), reached, np.inf) + 0.4
    turned = np.minimum(np.minimum(made, hint), double)
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
