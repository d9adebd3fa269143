"""Costs of taking each cell of a tree of ways for the place that a noun phrase names."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ....formats.core.frames import Array
from .goals import Place, SubGoal
from .ways import Ways
from .world import World

_PASS_M, _REACH_M, _BESIDE_M, _SEE_M = 2.8, 2.2, 3.5, 7.0
_STOP_M = 2.2
_DOOR_M = 0.6
_SIDE_RAD = np.deg2rad(8.0)
_DOOR_SIDE_RAD = np.deg2rad(10.0)
_ENTERED = 6  # cells back where one was not yet in the room entered
_NEVER = np.inf


def place_cost(goal: SubGoal, ways: Ways, world: World) -> Array:
    """Return the cost (N,) of a place that is come by or seen; inf where it is not."""
    noun = goal.noun
    if noun is None:
        return np.zeros(len(ways.points_m))
    if noun.kind == "object":
        return _thing(goal, noun, ways, world)
    if noun.kind == "room":
        return _room(goal, noun, ways, world)
    if noun.kind == "door":
        return _door(goal, noun, ways, world)
    return _crossed(ways, None)


def stop_cost(goal: SubGoal, ways: Ways, world: World) -> Array:
    """Return the cost (N,) of stopping at a cell; inf where it is not the place."""
    noun = goal.noun
    free = np.zeros(len(ways.points_m))
    if noun is None:
        return free
    if noun.kind == "object":
        cost = free + _NEVER
        for k in _candidates(noun, ways, world):
            gap, bearing = _gap_and_bearing(k, ways, world)
            off = np.linalg.norm(ways.points_m - world.things[k].middle_m, axis=1)
            own = 0.3 * gap + 0.2 * off + np.where(np.abs(bearing) > np.deg2rad(140), 0.3, 0.0)
            near = gap <= (_BESIDE_M if noun.prep == "past" else _STOP_M)
            cost = np.minimum(cost, np.where(near & _sided(bearing, noun.side), own, _NEVER))
        return cost
    if noun.kind == "room":
        inside = np.isin(ways.region, world.regions_called(noun.head))
        return np.where(inside, 0.1 * _since_entry_m(ways), _NEVER)
    if noun.kind == "door":
        near = [_flat(world.gap_m(k), ways) for k in world.called("door")]
        gap = np.min(near, axis=0) if near else free + _NEVER
        return np.where(gap <= 2.0, 0.3 * gap, _NEVER)
    return free


def _flat(grid: Array, ways: Ways) -> Array:
    return grid[tuple(ways.cells.T)]


def _gap_and_bearing(k: int, ways: Ways, world: World) -> tuple[Array, Array]:
    """Return the distance (N,) [m] and bearing (N,) [rad] of a thing."""
    thing = world.things[k]
    return _flat(world.gap_m(k), ways), ways.bearing_rad(thing.low_m, thing.high_m)


def _sided(bearing: Array, side: str) -> NDArray[np.bool_]:
    if not side:
        return np.ones(len(bearing), dtype=bool)
    angle = bearing if side == "left" else -bearing
    return (angle > _SIDE_RAD) & (angle < np.pi - _SIDE_RAD)


def _candidates(noun: Place, ways: Ways, world: World) -> list[int]:
    """Return the things a phrase may mean.

    An ordinal counts along the way, in all or in one room.
    """
    things = world.called(noun.head)
    if not noun.ordinal:
        return things
    first = {k: _first_m(k, ways, world) for k in things}
    ranked = [sorted(things, key=lambda k: first[k])]
    regions = {world.things[k].region for k in things}
    ranked += [[k for k in ranked[0] if world.things[k].region == r] for r in regions]
    return [k for order in ranked for k in order[noun.ordinal - 1 : noun.ordinal]]


def _first_m(k: int, ways: Ways, world: World) -> float:
    near = _flat(world.gap_m(k), ways) <= _PASS_M
    return float(ways.along_m[near].min()) if near.any() else _NEVER


def _thing(goal: SubGoal, noun: Place, ways: Ways, world: World) -> Array:
    cost = np.full(len(ways.points_m), _NEVER)
    for k in _candidates(noun, ways, world):
        gap, bearing = _gap_and_bearing(k, ways, world)
        if goal.kind == "see":
            reach = _BESIDE_M if noun.side else _SEE_M
            good = (gap <= reach) & (np.abs(bearing) <= np.deg2rad(130.0))
            own = 0.02 * gap
        elif noun.prep == "past":
            abeam = (np.abs(bearing) >= np.deg2rad(35.0)) & (np.abs(bearing) <= np.deg2rad(150.0))
            good, own = (gap <= _PASS_M) & abeam, 0.15 * np.maximum(gap - 0.8, 0.0)
        else:
            good, own = gap <= _REACH_M, 0.15 * np.maximum(gap - 0.8, 0.0)
        cost = np.minimum(cost, np.where(good & _sided(bearing, noun.side), own, _NEVER))
    return cost


def _room(goal: SubGoal, noun: Place, ways: Ways, world: World) -> Array:
    regions = world.regions_called(noun.head)
    inside = np.isin(ways.region, regions)
    if goal.kind == "see":
        return np.zeros(len(inside)) if regions else np.full(len(inside), _NEVER)
    if noun.prep == "from":
        was = inside[ways.before[_ENTERED]]
        return np.where(~inside & was, 0.0, _NEVER)
    if noun.prep == "into":
        return _crossed(ways, regions)
    return np.where(inside, 0.0, _NEVER)


def _door(goal: SubGoal, noun: Place, ways: Ways, world: World) -> Array:
    doors = _candidates(noun, ways, world)
    if not doors:
        return np.full(len(ways.points_m), _NEVER)
    gap = np.min([_flat(world.gap_m(k), ways) for k in doors], axis=0)
    through = noun.prep == "through"
    if goal.kind == "see" or not through:
        return np.where(gap <= _SEE_M if goal.kind == "see" else gap <= _REACH_M, 0.0, _NEVER)
    at = np.where(gap <= _DOOR_M, 0.0, _NEVER)
    crossed = _crossed(ways, None)
    return np.minimum(at + 0.3, np.minimum(crossed, at + crossed))


def _crossed(ways: Ways, regions: Sequence[int] | None) -> Array:
    """Return where one has just come into a region, or into any other."""
    was = ways.region[ways.before[_ENTERED]]
    changed = (ways.region != was) & (ways.region >= 0)
    if regions is not None:
        changed = np.isin(ways.region, regions) & ~np.isin(was, regions)
    return np.where(changed, 0.0, _NEVER)


def sided_door(goal: SubGoal) -> bool:
    """Return whether a sub-goal is a door or a room that is passed or entered on a stated side."""
    noun = goal.noun
    return noun is not None and bool(noun.side) and noun.kind != "object" and goal.kind == "place"


def on_side(goal: SubGoal, ways: Ways, lag: int) -> NDArray[np.bool_]:
    """Return where (N,) a door was on its stated side `lag` cells or less before."""
    sign = 1.0 if goal.noun is not None and goal.noun.side == "left" else -1.0
    angle = np.maximum(sign * ways.aside_rad, sign * ways.turn_rad)
    return angle[ways.before[: lag + 1]].max(axis=0) >= _DOOR_SIDE_RAD


def _since_entry_m(ways: Ways) -> Array:
    """Return how far one has walked in the current room [m], as far as the tree looks back."""
    same = ways.region[ways.before] == ways.region
    back = np.where(same.all(axis=0), len(ways.before) - 1, np.argmin(same, axis=0))
    cells = np.arange(len(ways.region))
    return ways.along_m - ways.along_m[ways.before[back, cells]]
