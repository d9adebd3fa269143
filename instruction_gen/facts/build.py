"""Build the facts of a path from its geometry, the scene's labels and what the camera saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...formats.core.episode import Episode
from ...formats.core.geometry import path_length, point_along
from ...formats.scene.bundle import LabeledObject, SceneBundle
from ...formats.scene.visibility import Glimpse, PathSight, Visibility
from ...wayfinding.crossings import DOORWAY_M, crossings
from ...wayfinding.regions import ROOM_PREFIX, RegionMap, region_map
from ..language.nouns import noun_of, room_of
from .actions import find_turns
from .colours import colour_name
from .doors import DOOR, doorways
from .geometry import Relations, Track, relations, track_of
from .records import (
    LandmarkFact,
    LookFact,
    Moment,
    PassageFact,
    PathFacts,
    SegmentFact,
    TurnFact,
    VisitFact,
)

SMALL_TURN_RAD = np.deg2rad(20.0)
NEAR_M = 3.0  # a thing this near, with no wall between, is beside the path
_BEFORE_DOOR_M = 1.5
_MIN_SIZE_M = 0.45
_TOP_M, _BOTTOM_M = 0.25, 1.3  # a landmark rises above the first and begins below the second
_MIN_PIXELS = 40  # of 128 × 96
_MAX_OCCLUDED = 0.8
_SIDE_RAD = np.deg2rad(20.0)
# Parts of the building, and things too flat or too common to steer by.
PLAIN = frozenset(
    noun.strip()
    for noun in """door, window, curtain, curtain rod, rug, carpet, picture, lamp, ceiling lamp,
    chandelier, handle, pillar, column, tableware, clock, range hood, towel rail, wall cupboard,
    security camera, seasoning box, kitchen utensils, tablet, sign""".split(",")
)


@dataclass(frozen=True)
class LevelFacts:
    """What all paths of a level share; build it once.

    Attributes:
        things: objects with a noun, and the doorways.
        nouns: their nouns.
        low_m, high_m: (N, 2) their boxes [m].
        names: room name of each region.
        unnamed: labels that no noun is known for, with how many objects have them.
    """

    bundle: SceneBundle
    level: int
    regions: RegionMap
    things: tuple[LabeledObject, ...]
    nouns: tuple[str, ...]
    low_m: NDArray[np.float64]
    high_m: NDArray[np.float64]
    names: tuple[str, ...]
    unnamed: dict[str, int]

    @staticmethod
    def of(bundle: SceneBundle, level: int, regions: RegionMap | None = None) -> LevelFacts:
        """Read a level."""
        regions = regions or region_map(bundle, level)
        things: list[LabeledObject] = []
        unnamed: dict[str, int] = {}
        for thing in bundle.objects:
            if thing.level not in (level, -1) or thing.category.startswith(ROOM_PREFIX):
                continue
            if noun_of(thing.category):
                things.append(thing)
            elif thing.category not in _STRUCTURE:
                unnamed[thing.category[:40]] = unnamed.get(thing.category[:40], 0) + 1
        things = [t for t in things if not any(_part_of(t, other) for other in things)]
        doors = doorways(regions, level, bundle.level_floor_z_m[level])
        # A door's leaf and its frame are the doorway that they stand in.
        things = [t for t in things if noun_of(t.category) != "door"]
        nouns = [noun_of(t.category) for t in things] + [DOOR] * len(doors)
        things += doors
        low = np.array([t.lower_m[:2] for t in things], dtype=np.float64).reshape(-1, 2)
        high = np.array([t.upper_m[:2] for t in things], dtype=np.float64).reshape(-1, 2)
        names = tuple(room_of(name) for name in regions.names)
        return LevelFacts(
            bundle, level, regions, tuple(things), tuple(nouns), low, high, names, unnamed
        )


_STRUCTURE = frozenset(
    """wall floor ceiling roof beam board misc object other unknown opening doorway room window
    frame""".split()
) | {"door frame", "window frame", "wall face", "invisible wall face", "global mesh"}


def path_facts(
    episode: Episode, shared: LevelFacts, visibility: Visibility | None = None
) -> PathFacts:
    """Facts of an episode's reference path.

    Args:
        episode: only its path and start heading are looked at.
        shared: of the episode's level.
        visibility: what the robot's camera saw; without it, walls alone decide what is seen.
    """
    path = episode.reference_path_world_m[:, :2]
    track = track_of(path)
    length = path_length(path)
    found = find_turns(path, episode.start_yaw_rad, SMALL_TURN_RAD)
    turns = tuple(
        TurnFact(round(t.along_m, 2), round(float(np.rad2deg(t.angle_rad)), 1)) for t in found
    )
    passages = _passages(shared, path, track)
    sight = visibility.paths.get(episode.trajectory_id) if visibility else None
    landmarks = _landmarks(shared, track, sight)
    return PathFacts(
        trajectory_id=episode.trajectory_id,
        scene_id=episode.scene_id,
        level=episode.level,
        length_m=round(length, 2),
        turns=turns,
        segments=_segments(path, turns, length),
        passages=passages,
        visits=_visits(shared, path, passages, length),
        landmarks=landmarks,
        level_nouns=tuple(sorted({n for n in shared.nouns if n != DOOR})),
        level_rooms=tuple(sorted({n for n in shared.names if n})),
        camera=LookFact(**asdict(visibility.camera)) if visibility and sight else None,
    )


def _segments(
    path: NDArray[np.float64], turns: Sequence[TurnFact], length: float
) -> tuple[SegmentFact, ...]:
    knots = [0.0, *(t.along_m for t in turns if 0.3 < t.along_m < length - 0.1), length]
    result = []
    for a, b in pairwise(knots):
        delta = np.diff(point_along(path, np.array([a, b])), axis=0)[0]
        heading = float(np.rad2deg(np.arctan2(delta[1], delta[0])))
        result.append(SegmentFact(round(a, 2), round(b, 2), round(heading, 1)))
    return tuple(result)


def _passages(
    shared: LevelFacts, path: NDArray[np.float64], track: Track
) -> tuple[PassageFact, ...]:
    result = []
    for c in crossings(shared.regions, path):
        k = int(np.searchsorted(track.along_m, max(0.0, c.along_m - _BEFORE_DOOR_M)))
        k = min(k, len(track.along_m) - 1)
        to = c.position_xy_m - track.points_m[k]
        bearing = np.rad2deg(np.arctan2(to[1], to[0]) - track.heading_rad[k])
        result.append(
            PassageFact(
                round(c.along_m, 2),
                shared.names[c.from_region],
                shared.names[c.to_region],
                c.width_m <= DOORWAY_M,
                round(float((bearing + 180) % 360 - 180), 1),
            )
        )
    return tuple(result)


def _visits(
    shared: LevelFacts,
    path: NDArray[np.float64],
    passages: Sequence[PassageFact],
    length: float,
) -> tuple[VisitFact, ...]:
    if not passages:
        region = int(shared.regions.at(path[-1]))
        return (VisitFact(shared.names[region] if region >= 0 else "", 0.0, round(length, 2)),)
    knots = [0.0, *(p.along_m for p in passages), round(length, 2)]
    names = [passages[0].from_room, *(p.to_room for p in passages)]
    return tuple(VisitFact(name, a, b) for name, (a, b) in zip(names, pairwise(knots), strict=True))


def _landmarks(
    shared: LevelFacts, track: Track, sight: PathSight | None
) -> tuple[LandmarkFact, ...]:
    if not shared.things:
        return ()
    seen = _by_thing(sight)
    where = relations(track, shared.low_m, shared.high_m, shared.regions)
    floor_z = shared.bundle.level_floor_z_m[shared.level]
    result = []
    for n, thing in enumerate(shared.things):
        glimpses = seen.get(thing.name, ())
        near = (where.open[:, n] | _looked(track, glimpses)) & (where.distance_m[:, n] <= 8.0)
        if not near.any():
            continue
        result.append(
            _landmark(shared, track, where, n, near, glimpses, floor_z, sight is not None)
        )
    result.sort(key=lambda m: (m.along_m, m.name))
    return _counted(result)


def _landmark(
    shared: LevelFacts,
    track: Track,
    where: Relations,
    n: int,
    near: NDArray[np.bool_],
    glimpses: Sequence[Glimpse],
    floor_z: float,
    looked: bool,
) -> LandmarkFact:
    thing, noun = shared.things[n], shared.nouns[n]
    # Where it is nearest in the open; behind a wall only if it is never in the open.
    distance = np.where(where.open[:, n], where.distance_m[:, n], where.distance_m[:, n] + 100.0)
    k = int(np.argmin(distance))
    bearing = float(where.bearing_rad[k, n])
    beside = _SIDE_RAD < abs(bearing) < np.pi - _SIDE_RAD
    size = np.subtract(thing.upper_m, thing.lower_m)
    low, high = thing.lower_m[2] - floor_z, thing.upper_m[2] - floor_z
    best = max(glimpses, key=lambda g: g.pixels, default=None)
    nameable = (
        noun not in PLAIN
        and noun != DOOR
        and size.max() >= _MIN_SIZE_M
        and high >= _TOP_M
        and low <= _BOTTOM_M
    )
    if looked:
        nameable = nameable and best is not None and best.pixels >= _MIN_PIXELS
        nameable = nameable and best is not None and best.occluded <= _MAX_OCCLUDED
    pixels = dict.fromkeys(range(len(track.along_m)), 0)
    for g in glimpses:
        pixels[int(np.argmin(np.abs(track.along_m - g.along_m)))] = g.pixels
    middle = (0.5 * (shared.low_m[n] + shared.high_m[n])).tolist()
    return LandmarkFact(
        name=thing.name,
        noun=noun,
        room=_room_at(shared, middle, shared.low_m[n], shared.high_m[n]),
        colour=colour_name(best.rgb) if best is not None and best.pixels >= 120 else "",
        nameable=bool(nameable),
        count=1,
        ordinal=1,
        along_m=round(float(track.along_m[k]), 2),
        distance_m=round(float(where.distance_m[k, n]), 2),
        side=("left" if bearing > 0 else "right") if beside else "",
        goal_distance_m=round(float(where.distance_m[-1, n]), 2),
        goal_bearing_deg=_degrees(where.bearing_rad[-1, n]),
        goal_open=bool(where.open[-1, n]),
        first_seen_m=round(min((g.along_m for g in glimpses), default=-1.0), 2),
        last_seen_m=round(max((g.along_m for g in glimpses), default=-1.0), 2),
        max_pixels=best.pixels if best else 0,
        occluded=round(best.occluded, 2) if best else 0.0,
        size_m=round(float(max(size[:2].max(), size[2])), 2),
        moments=tuple(
            Moment(
                round(float(track.along_m[i]), 2),
                round(float(where.distance_m[i, n]), 2),
                _degrees(where.bearing_rad[i, n]),
                _degrees(where.facing_rad[i, n]),
                bool(where.open[i, n]),
                pixels[i],
            )
            for i in np.flatnonzero(near).tolist()
        ),
    )


def _counted(landmarks: list[LandmarkFact]) -> tuple[LandmarkFact, ...]:
    """Number the things of each noun that are beside the path."""
    beside: dict[str, list[str]] = {}
    for mark in landmarks:
        if mark.distance_m <= NEAR_M or mark.nameable:
            beside.setdefault(mark.noun, []).append(mark.name)
    return tuple(
        replace(
            mark,
            count=max(1, len(names := beside.get(mark.noun, []))),
            ordinal=names.index(mark.name) + 1 if mark.name in names else len(names) + 1,
        )
        for mark in landmarks
    )


def _by_thing(sight: PathSight | None) -> dict[str, list[Glimpse]]:
    result: dict[str, list[Glimpse]] = {}
    for glimpse in sight.glimpses if sight else ():
        if glimpse.pixels >= 8:
            result.setdefault(glimpse.thing, []).append(glimpse)
    return result


def _looked(track: Track, glimpses: Sequence[Glimpse]) -> NDArray[np.bool_]:
    mask = np.zeros(len(track.along_m), dtype=bool)
    for glimpse in glimpses:
        mask |= np.abs(track.along_m - glimpse.along_m) <= 0.26
    return mask


def _room_at(
    shared: LevelFacts, middle: list[float], low: NDArray[np.float64], high: NDArray[np.float64]
) -> str:
    """Room of a box: of most of a few places in and around it."""
    xs, ys = (np.linspace(a - 0.25, b + 0.25, 5) for a, b in zip(low, high, strict=True))
    found = shared.regions.at(np.stack(np.meshgrid(xs, ys), axis=-1)).ravel()
    found = found[found >= 0]
    return shared.names[int(np.bincount(found).argmax())] if len(found) else ""


def _degrees(angle_rad: float) -> float:
    return round(float(np.rad2deg(angle_rad)), 1)


def _part_of(small: LabeledObject, large: LabeledObject) -> bool:
    """Whether a box lies mostly over another of its kind: scans list the parts of one thing."""
    if small.category != large.category or small.name == large.name:
        return False
    size = np.prod(np.subtract(small.upper_m, small.lower_m)[:2])
    other = np.prod(np.subtract(large.upper_m, large.lower_m)[:2])
    low = np.maximum(small.lower_m, large.lower_m)[:2]
    high = np.minimum(small.upper_m, large.upper_m)[:2]
    shared = np.prod(np.maximum(high - low, 0.0))
    return bool(shared > 0.5 * size and (size, small.name) < (other, large.name))
