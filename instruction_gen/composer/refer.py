"""How to call a thing so that it is clear which one is meant."""

from dataclasses import dataclass

import numpy as np

from ..facts.records import LandmarkFact, PathFacts, TurnFact
from ..language.nouns import answers, spoken

PASS_M = 2.0
STOP_M = 1.9
_TURN_M = 1.7
# A thing to stop at is shown by at least so many pixels (of 128 × 96) of the last look.
_PIXELS_AT_GOAL, _LAST_LOOK_M = 150, 0.3
_ORDINALS = {2: "second", 3: "third"}
_SMALL = frozenset("dumbbell vase bin trash can pouf stool basket box towel rail".split())


@dataclass(frozen=True)
class Reference:
    """A thing with the words for it.

    Attributes:
        name: of the object in the scene.
        noun: of the lexicon.
        words: with article: `the blue sofa`, `the chairs`.
        plural: several are meant.
        along_m: where it is nearest to the path [m].
        distance_m: from the path there, or from the goal [m].
        side: `left`, `right` or "".
        bearing_deg: from the final heading [deg].
        salience: how well it steers.
    """

    name: str
    noun: str
    words: str
    plural: bool
    along_m: float
    distance_m: float
    side: str
    bearing_deg: float
    salience: float


def passing_candidates(
    facts: PathFacts, low_m: float, high_m: float, rng: np.random.Generator, colours: float
) -> list[Reference]:
    """Return the things passed between two places of the path [m], best first."""
    found = []
    for mark in facts.landmarks:
        beside = low_m <= mark.along_m <= high_m and mark.distance_m <= PASS_M and mark.side
        # What one sees through a door is not passed.
        room = next((v.room for v in facts.visits if mark.along_m <= v.to_m), "")
        here = not mark.room or mark.room == room
        if not (mark.nameable and beside and here and came_by(mark)):
            continue
        reference = _refer(mark, facts, rng, colours, mark.distance_m, mark.side)
        if reference is not None:
            found.append(reference)
    return _best(found, rng)


def stop_candidates(facts: PathFacts, rng: np.random.Generator, colours: float) -> list[Reference]:
    """Return the things at the goal that the camera shows there, best first.

    Without a camera they are those not behind the walker.
    """
    found = []
    for mark in facts.landmarks:
        at_hand = mark.goal_distance_m <= STOP_M and (mark.goal_open or mark.goal_distance_m < 0.6)
        if not (mark.nameable and at_hand and abs(mark.goal_bearing_deg) <= 125.0):
            continue
        if facts.camera is not None and not _in_view_at_goal(mark, facts.length_m):
            continue
        reference = _refer(mark, facts, rng, colours, mark.goal_distance_m, "", at_goal=True)
        if reference is not None:
            found.append(reference)
    return _best(found, rng)


def turn_marker(
    facts: PathFacts, turn: TurnFact, named: set[str], rng: np.random.Generator, colours: float
) -> Reference | None:
    """Return a reference to a thing at a turn, to say where the turn is."""
    found = []
    for mark in facts.landmarks:
        if not mark.nameable or mark.name in named or mark.count > 1:
            continue
        near = [m for m in mark.moments if abs(m.along_m - turn.along_m) <= 0.3 and m.open]
        if not near or min(m.distance_m for m in near) > _TURN_M:
            continue
        # It must have been ahead before the turn, or it would be no landmark for the turn.
        if not any(m.along_m < turn.along_m and abs(m.bearing_deg) < 75.0 for m in mark.moments):
            continue
        distance = min(m.distance_m for m in near)
        reference = _refer(mark, facts, rng, colours, distance, mark.side)
        if reference is not None:
            found.append(reference)
    best = _best(found, rng)
    return best[0] if best else None


def _refer(
    mark: LandmarkFact,
    facts: PathFacts,
    rng: np.random.Generator,
    colours: float,
    distance_m: float,
    side: str,
    at_goal: bool = False,
) -> Reference | None:
    alike = [
        m for m in facts.landmarks
        if m.name != mark.name and mark.noun in answers(m.noun) and _noticed(m)
    ]  # fmt: skip
    adjective = ""
    looks = [word for word in (mark.colour, mark.material) if word]
    if looks and rng.random() < colours:
        adjective = looks[int(rng.integers(len(looks)))] + " "
    plural = False
    words = f"the {adjective}{spoken(mark.noun)}"
    if alike:
        together = [
            m for m in alike
            if m.noun == mark.noun and (_at_hand(m, mark) if at_goal else _in_row(m, mark))
        ]  # fmt: skip
        same_room = [m for m in alike if m.room == mark.room]
        # Counted within its room, not over the whole path.
        rank = 1 + sum(m.along_m < mark.along_m for m in same_room)
        if together:
            plural, adjective = True, ""
            words = f"the {spoken(mark.noun, plural=True)}"
        elif same_room and rank in _ORDINALS and not at_goal and len(same_room) <= 2:
            words = f"the {_ORDINALS[rank]} {spoken(mark.noun)}"
        elif same_room or not mark.room:
            return None
    size = mark.size_m * (0.5 if mark.noun in _SMALL else 1.0)
    salience = size / (0.6 + distance_m) / (1.0 + 0.8 * len(alike)) * (1.0 - 0.6 * mark.occluded)
    return Reference(
        mark.name, mark.noun, words, plural, mark.along_m, distance_m, side,
        mark.goal_bearing_deg, salience,
    )  # fmt: skip


def _in_row(other: LandmarkFact, mark: LandmarkFact) -> bool:
    """Return whether two things are passed as one group."""
    near = abs(other.along_m - mark.along_m) <= 1.2 and other.distance_m <= 3.0
    return near and other.side == mark.side


def _at_hand(other: LandmarkFact, mark: LandmarkFact) -> bool:
    """Return whether one stops at two things alike, not at one with another a step away."""
    near = abs(other.goal_distance_m - mark.goal_distance_m) <= 1.0
    return near and other.goal_distance_m <= 2.5 and other.goal_open


def _noticed(mark: LandmarkFact) -> bool:
    return mark.distance_m <= 3.5 and (mark.max_pixels > 60 or mark.first_seen_m < 0)


def _in_view_at_goal(mark: LandmarkFact, length_m: float) -> bool:
    return any(
        m.pixels >= _PIXELS_AT_GOAL and m.along_m >= length_m - _LAST_LOOK_M for m in mark.moments
    )


def came_by(mark: LandmarkFact) -> bool:
    """Return whether a thing is clearly beside the walker somewhere close by.

    What only lies behind at the start is not.
    """
    return any(
        m.open and m.distance_m <= PASS_M + 0.5 and 40.0 <= abs(m.bearing_deg) <= 140.0
        for m in mark.moments
    )


def _best(found: list[Reference], rng: np.random.Generator) -> list[Reference]:
    noise = {r.name: float(rng.uniform(0.7, 1.3)) for r in found}
    return sorted(found, key=lambda r: -r.salience * noise[r.name])
