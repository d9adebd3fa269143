"""Build the facts of a path from its geometry, the scene's labels and what the camera saw."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...formats.core.episode import Episode
from ...formats.core.geometry import path_length
from ...formats.scene.visibility import Visibility
from ...wayfinding.crossings import Crossing, crossings_to_the_ends
from .actions import find_turns
from .climbs import BEFORE_M, climbs_of, part_of
from .doors import DOOR, OPENING, Opening
from .geometry import Track, track_of
from .landmarks import PLAIN, landmarks_of
from .level import LevelFacts
from .records import LandmarkFact, PassageFact, PathFacts, TurnFact, VisitFact
from .rooms import nouns_inside, rooms_near
from .views import room_ahead, views_of

_FAR_M = 99.0  # what is on another level
_THRESHOLD_M, _NEAR_M = 0.7, 2.5
_AT_DOOR_M = 1.0
_ROW_M = 3.6  # doorways this near to the path are counted
_ASIDE_DEG = 15.0


def path_facts(
    episode: Episode,
    shared: LevelFacts,
    visibility: Visibility | None = None,
    beyond: Sequence[LevelFacts] = (),
) -> PathFacts:
    """Return the facts of an episode's reference path.

    Args:
        episode: only its path, start heading and staircases are looked at.
        shared: of the episode's level.
        visibility: what the robot's camera saw; without it, walls alone decide what is seen.
        beyond: of the levels that its staircases lead to, in order.
    """
    path = episode.reference_path_world_m[:, :2]
    track = track_of(path)
    length = path_length(path)
    turns = find_turns(path, episode.start_yaw_rad)
    sight = visibility.paths.get(episode.trajectory_id) if visibility else None
    climbs = climbs_of(episode, shared.bundle, track) if beyond else ()
    levels = (shared, *beyond)
    # What is beside the first half of a staircase is on the level before it.
    halves = [0.5 * (climb.along_m + climb.to_m) for climb in climbs]
    landmarks: list[LandmarkFact] = []
    passages: list[PassageFact] = []
    visits: list[VisitFact] = []
    for k, (level, half) in enumerate(zip(levels, pairwise([0.0, *halves, length]), strict=True)):
        low_m = climbs[k - 1].to_m if k else 0.0
        high_m = climbs[k].along_m if k < len(climbs) else length
        own = track.between(*half)
        marks = landmarks_of(level, own, sight)
        if half[1] < length:
            marks = tuple(replace(m, goal_distance_m=_FAR_M, goal_open=False) for m in marks)
        part = part_of(path, low_m, high_m) if climbs else path
        crossed = [
            replace(c, along_m=c.along_m + low_m)
            for c in crossings_to_the_ends(level.regions, part)
        ]
        stays = _visits(level, part, crossed, low_m, climbs[k].to_m if climbs[k:] else high_m)
        if visits:  # into the room at the other end of the stairs
            passages.append(PassageFact(low_m, visits[-1].room, stays[0].room, False, 0.0))
        passages += _passages(level, crossed, track, stays, marks, turns)
        visits += stays
        landmarks += marks
    last = levels[-1]
    return PathFacts(
        trajectory_id=episode.trajectory_id,
        scene_id=episode.scene_id,
        level=episode.level,
        length_m=round(length, 2),
        turns=turns,
        passages=tuple(passages),
        visits=tuple(visits),
        landmarks=tuple(landmarks),
        level_nouns=tuple(sorted({n for own in levels for n in own.nouns} - {DOOR, OPENING})),
        level_rooms=tuple(sorted({n for own in levels for n in own.names if n})),
        start_rooms=_others(shared, path[0], _THRESHOLD_M, visits[0].room),
        goal_rooms=_others(last, path[-1], _THRESHOLD_M, visits[-1].room),
        goal_near_rooms=_others(last, path[-1], _NEAR_M, visits[-1].room),
        room_ahead=room_ahead(last.regions, last.names, path),
        views=views_of(landmarks, turns, passages, round(length, 2)),
        camera=visibility.camera if visibility and sight else None,
        climbs=climbs,
        levels=len(shared.bundle.level_floor_z_m),
    )


def _others(
    shared: LevelFacts, xy_m: NDArray[np.float64], reach_m: float, room: str
) -> tuple[str, ...]:
    """Return the names of rooms near a point other than the one said, in order."""
    return tuple(sorted(rooms_near(shared.regions, shared.names, xy_m, reach_m) - {room}))


def _passages(
    shared: LevelFacts,
    crossed: Sequence[Crossing],
    track: Track,
    visits: Sequence[VisitFact],
    landmarks: Sequence[LandmarkFact],
    turns: Sequence[TurnFact],
) -> tuple[PassageFact, ...]:
    result = []
    for c, visit in zip(crossed, visits, strict=False):
        opening = _opening_at(shared, c)
        through = opening is not None and opening.noun == DOOR
        frame = opening if through else None
        here = frame and frame.is_at(c.position_xy_m, c.from_region, c.to_region)
        if frame and (not here or len(frame.rooms) > 2):  # it has no middle where three meet
            frame = None
        at = frame.middle_m if frame else c.position_xy_m
        bearing = track.bearing_deg(c.along_m - BEFORE_M, at)
        into = next((t for t in turns if -1.5 <= t.along_m - c.along_m <= 0.0), None)
        side = ("left" if bearing > 0 else "right") if abs(bearing) > _ASIDE_DEG else ""
        # A walk along the wall that a door is in has it ahead and turns into it.
        ahead = frame and frame.is_ahead(track.heading_at_rad(c.along_m - BEFORE_M))
        side = side or (into.side if into and abs(into.angle_deg) > 45.0 and not ahead else "")
        to_room = shared.names[c.to_region]
        place = _place_in_row(landmarks, side, visit.from_m, c.along_m) if side else 0
        alike = max(0, visit.beyond.count(to_room) - 1) if to_room else 0
        result.append(
            PassageFact(
                round(c.along_m, 2), shared.names[c.from_region], to_room, through, bearing, side,
                place, alike, _thing_at(shared, c),
            )
        )  # fmt: skip
    return tuple(result)


def _opening_at(shared: LevelFacts, crossing: Crossing) -> Opening | None:
    """Return the nearest opening to a step into another room, one between the two if there is."""
    rooms, at = {crossing.from_region, crossing.to_region}, crossing.position_xy_m
    return min(
        shared.openings,
        key=lambda o: (not rooms.issubset(o.rooms), o.distance_m(at), o.noun),
        default=None,
    )


def _place_in_row(
    landmarks: Sequence[LandmarkFact], side: str, from_m: float, along_m: float
) -> int:
    """Return the place of a passage at `along_m` among the doorways on its side from `from_m`."""
    return 1 + sum(
        mark.noun == DOOR
        and mark.side == side
        and mark.distance_m <= _ROW_M
        and from_m + 0.5 < mark.along_m < along_m - 0.5
        for mark in landmarks
    )


def _thing_at(shared: LevelFacts, crossing: Crossing) -> str:
    """Return the noun of a thing beside an opening that is the only one in the room left."""
    inside = shared.regions.at(0.5 * (shared.low_m + shared.high_m)) == crossing.from_region
    edge = np.clip(crossing.position_xy_m, shared.low_m, shared.high_m)
    far_m = np.linalg.norm(edge - crossing.position_xy_m, axis=1)
    nouns = [noun for noun, here in zip(shared.nouns, inside, strict=True) if here]
    for n in np.argsort(far_m):
        noun = shared.nouns[n]
        if far_m[n] > _AT_DOOR_M:
            break
        if inside[n] and noun not in PLAIN and nouns.count(noun) == 1:
            return noun
    return ""


def _visits(
    shared: LevelFacts, path: NDArray[np.float64], crossed: Sequence[Crossing],
    from_m: float, to_m: float,
) -> tuple[VisitFact, ...]:  # fmt: skip
    knots = [round(m, 2) for m in (from_m, *(c.along_m for c in crossed), to_m)]
    # A step over the threshold of the next room is no visit: the last room is the one before it.
    last = crossed[-1].to_region if crossed else int(shared.regions.at(path[len(path) // 2]))
    regions = [*(c.from_region for c in crossed), last]
    inside = nouns_inside(shared.regions, shared.nouns, shared.low_m, shared.high_m)
    return tuple(
        _visit(shared, inside, region, a, b)
        for region, (a, b) in zip(regions, pairwise(knots), strict=True)
    )


def _visit(
    shared: LevelFacts, inside: Sequence[frozenset[str]], region: int, from_m: float, to_m: float
) -> VisitFact:
    if region < 0:
        return VisitFact("", from_m, to_m)
    name, openings = shared.names[region], [o for o in shared.openings if region in o.rooms]
    beyond = tuple(sorted(shared.names[k] for o in openings for k in o.rooms if k != region))
    twins = [k for k, n in enumerate(shared.names) if n == name and k != region and n]
    own = inside[region].difference(*(inside[k] for k in twins)) - PLAIN
    thing = min(own, key=lambda noun: (shared.nouns.count(noun), noun), default="")
    return VisitFact(name, from_m, to_m, len(openings), beyond, len(twins), thing if twins else "")
