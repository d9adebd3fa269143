"""Build the facts of a path from its geometry, the scene's labels and what the camera saw."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...formats.core.episode import Episode
from ...formats.core.geometry import path_length, point_along
from ...formats.scene.visibility import Visibility
from ...wayfinding.crossings import DOORWAY_M, crossings
from .actions import find_turns
from .doors import DOOR
from .geometry import Track, track_of
from .landmarks import landmarks_of
from .level import LevelFacts
from .records import (
    PassageFact,
    PathFacts,
    SegmentFact,
    TurnFact,
    VisitFact,
)
from .rooms import rooms_near

SMALL_TURN_RAD = np.deg2rad(20.0)
_BEFORE_DOOR_M = 1.5
_THRESHOLD_M, _NEAR_M = 0.7, 2.5


def path_facts(
    episode: Episode, shared: LevelFacts, visibility: Visibility | None = None
) -> PathFacts:
    """Return the facts of an episode's reference path.

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
    visits = _visits(shared, path, passages, length)
    sight = visibility.paths.get(episode.trajectory_id) if visibility else None
    landmarks = landmarks_of(shared, track, sight)
    return PathFacts(
        trajectory_id=episode.trajectory_id,
        scene_id=episode.scene_id,
        level=episode.level,
        length_m=round(length, 2),
        turns=turns,
        segments=_segments(path, turns, length),
        passages=passages,
        visits=visits,
        landmarks=landmarks,
        level_nouns=tuple(sorted({n for n in shared.nouns if n != DOOR})),
        level_rooms=tuple(sorted({n for n in shared.names if n})),
        start_rooms=_others(shared, path[0], _THRESHOLD_M, visits[0].room),
        goal_rooms=_others(shared, path[-1], _THRESHOLD_M, visits[-1].room),
        goal_near_rooms=_others(shared, path[-1], _NEAR_M, visits[-1].room),
        camera=visibility.camera if visibility and sight else None,
    )


def _others(
    shared: LevelFacts, xy_m: NDArray[np.float64], reach_m: float, room: str
) -> tuple[str, ...]:
    """Return the names of rooms near a point other than the one said, in order."""
    return tuple(sorted(rooms_near(shared.regions, shared.names, xy_m, reach_m) - {room}))


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
    knots = [0.0, *(p.along_m for p in passages), round(length, 2)]
    crossed = crossings(shared.regions, path)
    # A step over the threshold of the next room is no visit: the last room is the one before it.
    last = crossed[-1].to_region if crossed else int(shared.regions.at(path[len(path) // 2]))
    rooms = _rooms(shared, [*(c.from_region for c in crossed), last], passages)
    return tuple(
        _visit(shared, name, region, a, b)
        for (name, region), (a, b) in zip(rooms, pairwise(knots), strict=True)
    )


def _visit(shared: LevelFacts, name: str, region: int, from_m: float, to_m: float) -> VisitFact:
    openings = shared.openings[region] if region >= 0 else ()
    beyond = tuple(sorted(room for rooms in openings for room in rooms))
    return VisitFact(name, from_m, to_m, len(openings), beyond)


def _rooms(
    shared: LevelFacts, regions: Sequence[int], passages: Sequence[PassageFact]
) -> list[tuple[str, int]]:
    """Return name and region of each room visited."""
    if not passages:
        return [(shared.names[regions[0]] if regions[0] >= 0 else "", regions[0])]
    names = [passages[0].from_room, *(p.to_room for p in passages)]
    return list(zip(names, regions, strict=True))
