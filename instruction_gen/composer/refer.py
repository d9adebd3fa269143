"""How to call a thing so that it is clear which one is meant."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

from ..facts.landmarks import PLAIN
from ..facts.records import LandmarkFact, Moment, PathFacts, TurnFact

PASS_M, PASS_DOOR_M = 2.0, 1.8
STOP_M, STOP_AT_M = 1.9, 1.2  # of the nearest thing, of any other
_TURN_M = 1.7
_AROUND_M = 1.2
_AT_HAND_M = 1.1
_NEW_M = 1.5  # who walks farther toward a thing in view takes it for no cue
# A thing to stop at is shown by at least so many pixels (of 128 × 96) of the last look.
_PIXELS_AT_GOAL, _LAST_LOOK_M = 150, 0.3
_SEEN_PIXELS = 40
HUNG = ("picture", "window")  # on walls, passed like things
# What one may see in a room beside the things that stand there.
_SIGHTS = frozenset((
    "window", "picture", "rug", "clock", "curtain", "chair", "plant", "mirror", "towel rail",
    "wall cupboard", "bin", "shelf", "toilet", "range hood", "pouf", "basket",
    "nightstand",
))  # fmt: skip
_OVER_MOMENTS, _ON_M = 4, 0.1  # a quarter of a metre apart, on a rug
_BY_M, _AWAY_DEG = 1.0, 40.0  # what is nearer is passed before a turn away from it
_AHEAD_DEG = 80.0  # what is passed was ahead before
_STARTS_AT_M = 0.7  # a thing that tells how one starts is this large


@dataclass(frozen=True)
class Reference:
    """A thing with the words for it.

    Attributes:
        mark: the thing.
        phrase: what it is called, in the singular.
        words: with article: `the blue sofa`, `the chairs`.
        plural: several are meant.
        salience: how well it steers.
        colour, material: that are mentioned, "" = none.
        beside: what is said to stand right beside it, if anything.
    """

    mark: LandmarkFact
    phrase: str
    words: str
    plural: bool
    salience: float
    colour: str = ""
    material: str = ""
    beside: Reference | None = None


# which things ---------------------------------------------------------------------------------


def at_turn(mark: LandmarkFact, along_m: float) -> float | None:
    """Return how far a thing stands from a turn that it may announce [m], else None."""
    near = [m.distance_m for m in mark.moments if abs(m.along_m - along_m) <= 0.3 and m.open]
    if not (mark.nameable and near and min(near) <= _TURN_M) or mark.count > 1:
        return None
    # It must be ahead before the turn, or it would be no landmark for the turn.
    before = moment_at(mark, along_m - 1.0)
    return min(near) if before is not None and abs(before.facing_deg) < 50.0 else None


def around(mark: LandmarkFact, turn: TurnFact) -> float | None:
    """Return how far a large thing is that a turn leads around [m], else None."""
    here, before = moment_at(mark, turn.along_m), moment_at(mark, turn.along_m - 1.0)
    if here is None or before is None or not mark.nameable or mark.side != turn.side:
        return None
    inner = all(m.open and (m.bearing_deg > 0) == (turn.angle_deg > 0) for m in (here, before))
    at_hand = here.distance_m <= _AROUND_M and 40.0 <= abs(here.bearing_deg) <= 120.0
    return here.distance_m if inner and at_hand and mark.size_m >= _STARTS_AT_M else None


def before_reached(mark: LandmarkFact, facts: PathFacts, along_m: float) -> float | None:
    """Return how far a thing straight ahead is that a turn does not quite reach [m], else None."""
    if (far_m := in_view(mark, facts, along_m - 0.5, 20.0, 3.0)) is None:
        return None
    return far_m if far_m >= 1.0 and mark.size_m >= _STARTS_AT_M else None


def new_in_view(mark: LandmarkFact, facts: PathFacts, along_m: float) -> float | None:
    """Return how far a thing ahead is that comes into view right before a place [m], else None."""
    seen = (m.along_m for m in mark.moments if m.open or m.pixels >= _SEEN_PIXELS)
    late = next(seen, 0.0) >= max(0.5, along_m - _NEW_M)
    return in_view(mark, facts, along_m, 30.0, 4.0) if late else None


def walked_to(mark: LandmarkFact, facts: PathFacts, along_m: float) -> float | None:
    """Return how far a thing is that the way leads toward from a place [m], else None."""
    far_m, later = in_view(mark, facts, along_m, 20.0, 5.0), moment_at(mark, along_m + 1.0)
    nearer = later is not None and far_m is not None and later.distance_m < far_m - 0.6
    return far_m if nearer else None


def comes_to(mark: LandmarkFact, facts: PathFacts, from_m: float, to_m: float) -> float | None:
    """Return how far a thing in view is that the way comes to between two places [m], else None."""
    far_m = in_view(mark, facts, from_m - 0.3, 75.0, 5.0)
    reached = any(m.distance_m <= _AT_HAND_M for m in mark.moments if from_m < m.along_m <= to_m)
    return far_m if reached and far_m is not None and far_m > _AT_HAND_M else None


def in_sight(mark: LandmarkFact, facts: PathFacts, along_m: float) -> float | None:
    """Return how far anything of the room is that one sees from a place [m], else None."""
    m = moment_at(mark, along_m)
    here = mark.room == facts.room_at(along_m) and mark.noun in _SIGHTS
    clear = m is not None and here and m.open and abs(m.facing_deg) <= 60.0
    return m.distance_m if m and clear and 0.6 <= m.distance_m <= 4.5 else None


def in_view(
    mark: LandmarkFact, facts: PathFacts, along_m: float, within_deg: float, reach_m: float
) -> float | None:
    """Return how far a thing in the same room is that is in view ahead [m], else None."""
    m = moment_at(mark, along_m)
    if mark.room not in ("", facts.room_at(along_m)):
        return None
    seen = m is not None and mark.nameable and (m.open or m.pixels >= _SEEN_PIXELS)
    if (
        m is None
        or not seen
        or abs(m.facing_deg) > within_deg
        or not 0.6 <= m.distance_m <= reach_m
    ):
        return None
    return m.distance_m


def moment_at(mark: LandmarkFact, along_m: float) -> Moment | None:
    """Return where a thing is at a place of the path, None where it is out of reach."""
    k = bisect_left(mark.moments, along_m, key=lambda m: m.along_m)
    near = (m for m in mark.moments[max(0, k - 1) : k + 1] if abs(m.along_m - along_m) <= 0.2)
    return min(near, key=lambda m: abs(m.along_m - along_m), default=None)


def at_start(mark: LandmarkFact, facts: PathFacts) -> tuple[str, float] | None:
    """Return `facing`, `behind` or `beside_start` and how far a thing is at the start [m]."""
    m = moment_at(mark, 0.0)
    steers = mark.nameable or mark.noun == "window" or mark.noun not in PLAIN
    steers = steers and mark.room in ("", facts.visits[0].room)
    if m is None or not (m.open and steers and mark.size_m >= _STARTS_AT_M):
        return None
    off = abs(m.facing_deg)
    for kind, low, high, reach_m in (
        ("facing", 0.0, 25.0, 5.0),
        ("beside_start", 50.0, 115.0, 2.0),
        ("behind", 148.0, 181.0, 3.0),
    ):  # fmt: skip
        named = mark.nameable or kind == "behind" or mark.noun == "window"
        if low <= off <= high and m.distance_m <= reach_m and named:
            return kind, m.distance_m
    return None


def passed(mark: LandmarkFact, facts: PathFacts, low_m: float, high_m: float) -> bool:
    """Return whether a thing is passed between two places of the path [m]."""
    beside = low_m <= mark.along_m <= high_m and mark.distance_m <= PASS_M and mark.side
    # What one sees through a door is not passed.
    here = mark.room in ("", facts.room_at(mark.along_m))
    named = mark.nameable or mark.noun in HUNG
    return bool(named and beside and here and came_by(mark) and not _turned_from(mark, facts))


def _turned_from(mark: LandmarkFact, facts: PathFacts) -> bool:
    """Return whether a turn away from a thing at some distance brings it behind, not the walk."""
    away_deg = sum(
        abs(turn.angle_deg)
        for turn in facts.turns
        if turn.side != mark.side and -1.0 <= turn.along_m - mark.along_m <= 0.5
    )
    return mark.distance_m > _BY_M and away_deg >= _AWAY_DEG


def walked_over(mark: LandmarkFact, facts: PathFacts, low_m: float, high_m: float) -> bool:
    """Return whether the path leads over a rug between two places [m], the only one of its room.

    Who starts or stops on it does not cross it.
    """
    here = low_m <= mark.along_m <= high_m and mark.room == facts.room_at(mark.along_m)
    if mark.noun not in ("rug", "carpet") or not here:
        return False
    on = [m.along_m for m in mark.moments if m.distance_m <= _ON_M]
    across = len(on) >= _OVER_MOMENTS and on[0] > 0.0 and on[-1] < facts.length_m - _ON_M
    alone = sum((m.noun, m.room) == (mark.noun, mark.room) for m in facts.landmarks) == 1
    return across and alone


def at_goal(mark: LandmarkFact, facts: PathFacts) -> bool:
    """Return whether a thing is at the goal and not behind; the camera, if any, shows it there."""
    own = mark.room in ("", facts.goal_room, *facts.goal_rooms)
    if not (mark.nameable and own and stands_at_goal(mark) and abs(mark.goal_bearing_deg) <= 125.0):
        return False
    others = (m.goal_distance_m for m in facts.landmarks if m.nameable and m.goal_open)
    return mark.goal_distance_m <= max(STOP_AT_M, min(others, default=0.0)) and _shown(mark, facts)


def stands_at_goal(mark: LandmarkFact) -> bool:
    """Return whether a thing is close to the goal, no wall between."""
    return mark.goal_distance_m <= STOP_M and (mark.goal_open or mark.goal_distance_m < 0.6)


def hung_at_goal(mark: LandmarkFact, facts: PathFacts) -> bool:
    """Return whether a window or picture is at the goal and not behind."""
    here = mark.goal_open and mark.goal_distance_m <= STOP_M and abs(mark.goal_bearing_deg) <= 105.0
    own = mark.room in ("", facts.goal_room)
    return mark.noun in HUNG and here and own and _shown(mark, facts)


def _shown(mark: LandmarkFact, facts: PathFacts) -> bool:
    """Return whether the camera, if any, shows a thing at the goal."""
    return facts.camera is None or any(
        m.pixels >= _PIXELS_AT_GOAL and m.along_m >= facts.length_m - _LAST_LOOK_M
        for m in mark.moments
    )


def came_by(mark: LandmarkFact) -> bool:
    """Return whether a thing is clearly beside the walker somewhere close by, ahead before that."""
    beside = [
        m.along_m for m in mark.moments
        if m.open and m.distance_m <= PASS_M + 0.5 and 40.0 <= abs(m.bearing_deg) <= 140.0
    ]  # fmt: skip
    ahead = (m.along_m for m in mark.moments if abs(m.facing_deg) <= _AHEAD_DEG)
    return bool(beside) and next(ahead, np.inf) <= mark.along_m


def abeam_m(mark: LandmarkFact) -> float:
    """Return where a walker has the middle of a thing beside him [m]."""
    return next((m.along_m for m in mark.moments if abs(m.facing_deg) >= 90.0), mark.along_m)


def in_row(other: LandmarkFact, mark: LandmarkFact) -> bool:
    """Return whether two things of a room are passed as one group."""
    near = abs(other.along_m - mark.along_m) <= 1.2 and other.distance_m <= 3.0
    return near and other.side == mark.side


def at_hand(other: LandmarkFact, mark: LandmarkFact) -> bool:
    """Return whether one stops at two things of a room, not at one with another a step away."""
    near = abs(other.goal_distance_m - mark.goal_distance_m) <= 1.0
    return near and other.goal_distance_m <= 2.5 and other.goal_open
