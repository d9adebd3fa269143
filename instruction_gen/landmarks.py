"""Which things along a path are worth naming, and where they stand relative to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..formats.scene.bundle import LabeledObject, SceneBundle
from ..formats.scene.things import nameable
from ..wayfinding.planning import resample
from ..wayfinding.regions import ROOM_PREFIX, RegionMap

# Parts of the building, things too common or too flat to steer by, and collections of parts.
# fmt: off
NO_LANDMARKS = frozenset([
    "beam", "board", "carpet", "ceiling", "chandelier", "column", "curtain", "door",
    "door frame", "doorway", "floor", "global mesh", "handle", "invisible wall face", "lamp",
    "light", "mat", "misc", "object", "opening", "other", "picture", "roof", "rug", "tableware",
    "unknown", "wall", "wall face", "window", "window frame",
])
# fmt: on

NEAR_M = 1.6  # a thing at most this far beside the path is passed by it
STOP_M = 1.8  # a thing at most this far from the goal can say where to stop
_MIN_SIZE_M = 0.45  # height or breadth below which nobody would name a thing
_TOP_M = 0.25  # a thing must rise this high above the floor …
_BOTTOM_M = 1.3  # … and begin below this height


@dataclass(frozen=True)
class Sighting:
    """A landmark seen from a path.

    Attributes:
        name: of the object in the scene.
        category: what to call it.
        plural: several of the kind stand together.
        along_m: distance along the path where it is nearest [m].
        distance_m: of its edge from the path there [m].
        bearing_rad: direction to it from the heading there, left is positive [rad].
        goal_distance_m: of its edge from the goal [m].
        goal_bearing_rad: direction to it from the final heading, left is positive [rad].
        salience: how well it steers; larger is better.
    """

    name: str
    category: str
    plural: bool
    along_m: float
    distance_m: float
    bearing_rad: float
    goal_distance_m: float
    goal_bearing_rad: float
    salience: float

    @property
    def side(self) -> str:
        """`left`, `right`, or "" when it is not clearly beside the path."""
        beside = np.deg2rad(35) < abs(self.bearing_rad) < np.deg2rad(145)
        return ("left" if self.bearing_rad > 0 else "right") if beside else ""


def candidates(bundle: SceneBundle, level: int) -> list[LabeledObject]:
    """Objects of a level that a person might name, by their kind and size."""
    floor_z = bundle.level_floor_z_m[level]
    result = []
    for thing in bundle.objects:
        if thing.level not in (level, -1) or thing.category.startswith(ROOM_PREFIX):
            continue
        if thing.category.lower() in NO_LANDMARKS or not nameable(thing.category):
            continue
        size = np.subtract(thing.upper_m, thing.lower_m)
        low, high = thing.lower_m[2] - floor_z, thing.upper_m[2] - floor_z
        if size.max() >= _MIN_SIZE_M and high >= _TOP_M and low <= _BOTTOM_M:
            result.append(thing)
    return result


def sightings(
    path_xy_m: NDArray[np.float64], bundle: SceneBundle, level: int, regions: RegionMap
) -> list[Sighting]:
    """Landmarks near a path (P, 2) [m] that no wall hides, in the order they are passed."""
    points = resample(path_xy_m, 0.1)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    ahead = np.minimum(np.searchsorted(along, along + 0.4), len(points) - 1)
    behind = np.maximum(np.searchsorted(along, along - 0.4) - 1, 0)
    heading = np.arctan2(*(points[ahead] - points[behind]).T[::-1])
    things = candidates(bundle, level)
    result = []
    for thing in things:
        low, high = np.array(thing.lower_m[:2]), np.array(thing.upper_m[:2])
        edge = np.clip(points, low, high)
        gap = np.linalg.norm(points - edge, axis=1)
        # Along a long thing the path is near it for a while: take the middle of that.
        beside = np.flatnonzero(gap <= gap.min() + 0.1)
        nearest = int(beside[len(beside) // 2])
        if gap[nearest] > NEAR_M and gap[-1] > STOP_M:
            continue
        from_point = nearest if gap[nearest] <= NEAR_M else -1
        if not _in_sight(points[from_point], edge[from_point], regions):
            continue
        # Seen through a door, a thing would send the walker into the wrong room.
        if _rooms(regions, low, high).isdisjoint(regions.at(points[[from_point]]).tolist()):
            continue
        center = (low + high) / 2
        kind = [t for t in things if t.category == thing.category and t.name != thing.name]
        if any(_part_of(thing, t) for t in kind):
            continue
        twins = [t for t in kind if not _part_of(t, thing)]
        together = [t for t in twins if _between(t, thing) < 1.5]
        size = np.subtract(thing.upper_m, thing.lower_m)
        salience = float(np.sqrt(size[:2].max() * size[2])) / (1.0 + 0.5 * len(twins))
        result.append(
            Sighting(
                name=thing.name,
                category=thing.category,
                plural=bool(together),
                along_m=float(along[nearest]),
                distance_m=float(gap[nearest]),
                bearing_rad=_bearing(points[nearest], heading[nearest], edge[nearest], center),
                goal_distance_m=float(gap[-1]),
                goal_bearing_rad=_bearing(points[-1], heading[-1], edge[-1], center),
                salience=salience,
            )
        )
    return sorted(result, key=lambda s: (s.along_m, s.name))


def _bearing(
    point: NDArray[np.float64],
    heading: float,
    edge: NDArray[np.float64],
    center: NDArray[np.float64],
) -> float:
    to = edge - point
    if np.linalg.norm(to) < 1e-6:
        to = center - point
    return float((np.arctan2(to[1], to[0]) - heading + np.pi) % (2 * np.pi) - np.pi)


def _between(a: LabeledObject, b: LabeledObject) -> float:
    """Horizontal distance of two boxes [m]."""
    gap = np.maximum(np.subtract(a.lower_m, b.upper_m), np.subtract(b.lower_m, a.upper_m))[:2]
    return float(np.linalg.norm(np.maximum(gap, 0.0)))


def _rooms(regions: RegionMap, low: NDArray[np.float64], high: NDArray[np.float64]) -> set[int]:
    """Rooms that a box `low` … `high` (2,), (2,) [m] stands in, or at whose wall it stands."""
    xs, ys = (np.linspace(a - 0.2, b + 0.2, 8) for a, b in zip(low, high, strict=True))
    found = regions.at(np.stack(np.meshgrid(xs, ys), axis=-1))
    rooms, counts = np.unique(found[found >= 0], return_counts=True)
    return {int(r) for r, n in zip(rooms, counts, strict=True) if n >= 0.3 * counts.max()}


def _part_of(small: LabeledObject, large: LabeledObject) -> bool:
    """Whether a box lies mostly over another: scenes come with the parts of one thing as many."""
    size = np.prod(np.subtract(small.upper_m, small.lower_m)[:2])
    other = np.prod(np.subtract(large.upper_m, large.lower_m)[:2])
    low = np.maximum(small.lower_m, large.lower_m)[:2]
    high = np.minimum(small.upper_m, large.upper_m)[:2]
    shared = np.prod(np.maximum(high - low, 0.0))
    return bool(shared > 0.5 * size and (size, small.name) < (other, large.name))


def _in_sight(point: NDArray[np.float64], edge: NDArray[np.float64], regions: RegionMap) -> bool:
    """Whether no wall stands between a point and a thing's edge; the thing may be at a wall."""
    distance = float(np.linalg.norm(edge - point))
    count = max(2, int(distance / 0.04))
    t = np.linspace(0.0, max(0.0, 1.0 - 0.08 / max(distance, 0.08)), count)[:, None]
    cells = regions.grid.cell_of(point + (edge - point) * t)
    cells = np.clip(cells, 0, np.array(regions.grid.shape) - 1)
    return bool(np.all(regions.width_m[cells[:, 0], cells[:, 1]] > 0))
