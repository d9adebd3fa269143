"""Tell a step into a room: by its side, its doorway, or what is seen there."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..facts.doors import DOOR
from ..facts.records import LandmarkFact, PassageFact, PathFacts, TurnFact, VisitFact, manoeuvre_deg
from ..language.nouns import answers
from .grammar import pick
from .moves import SLIGHT_DEG, Move
from .names import Names
from .records import Event, Taste
from .refer import (
    HUNG,
    PASS_DOOR_M,
    Reference,
    at_turn,
    in_sight,
    in_view,
    moment_at,
    passed,
    walked_to,
)

_MANY_EXITS, _COUNTED = 3, 0.6
_BY_THING = 0.25  # how often a room is told by a thing in it alone
_AHEAD = 0.7  # how often a room without a name is told as the one straight ahead
_AHEAD_M = (-2.0, 1.0)  # where a bend would lead through an opening at a side
_FACED_DEG = 40.0
_JUST_M = 1.5
_AT_EXIT_M = 0.3  # a turn farther before an exit is made inside
_SIDED_DEG = 40.0  # a thing so far aside of who enters is on his side
_SWING_M = 0.4  # a doorway so far to the other side is not on its side


def passage_event(move: Move, gap_m: float, facts: PathFacts, names: Names, taste: Taste) -> Event:
    """Return a step into another room, with its turn if it has one."""
    turn, passage, along, rng = move.turn, move.passage, move.along_m, names.rng
    assert passage is not None
    side = turn.side if turn else ""
    first = passage is facts.passages[0] and along < 4.0
    room = names.entered(passage)
    brief = taste.voice == "terse" or (first and names.homed)
    left = "" if brief else names.name(passage.from_room)
    done = max(along, passage.along_m, turn.along_m if turn else 0.0)
    event = Event("enter", along, A=left, B=room, s=side, to_m=done)
    # Where a hallway goes on as another there is no door.
    doorway = passage.doorway and passage.from_room != passage.to_room
    many = doorway and one_of_many(passage, facts)
    slight = turn is not None and is_slight(turn, facts)
    if not room:
        kind = "leave_turn" if side and not move.turn_first else "leave_only"
        kind = "turn" if side and move.turn_first else kind
        if not side and passage_ahead(passage, facts) and rng.random() < _AHEAD:
            return replace(event, kind="leave_ahead" if event.A else "enter_ahead")
        return replace(event, kind=kind if event.A or kind == "turn" else "enter")
    marked = rng.random() < max(taste.marks, taste.rooms)
    within = [m for m in (0.3, 0.8) if passage.along_m + m < facts.length_m]

    def inside(mark: LandmarkFact) -> float | None:
        if mark.room != passage.to_room:
            return None
        seen = (in_view(mark, facts, passage.along_m + m, 75.0, 5.0) for m in within)
        return next((far for far in seen if far is not None), None)

    def also() -> Reference | None:
        if rng.random() < 0.5 and (thing := names.best(inside)):
            return thing
        sight = names.some(lambda m: in_sight(m, facts, passage.along_m + within[-1]))
        return sight or names.best(inside)

    if turn is not None and move.turn_first:
        if (passage.alike and _is_aside(passage, facts) and _is_faced(passage, facts)) or (
            many and _counts(passage, facts) and rng.random() < _COUNTED
        ):  # of several doorways
            # A door without its room is one of the room that the text names next.
            bare = taste.voice == "terse" and passage is facts.passages[-1] and rng.random() < 0.5
            kind = "turn_nth" if bare else "turn_enter_nth"
            return replace(event, kind=kind, s=passage.side, ordinal=passage.ordinal)
        if slight:
            return replace(event, kind="slight_enter")
        if marked and rng.random() < 0.5:
            near = names.best(lambda m: at_turn(m, turn.along_m) if along > 0.8 else None)
            if near:
                return replace(event, kind="turn_enter_at", X=near)
        after = names.best(just_passed(facts, along, gap_m)) if marked else None
        if after:
            return replace(event, kind="turn_enter_after", X=after, t=after.mark.side)
        if marked and (mark := names.best(inside)):
            other = also() if rng.random() < taste.rooms else None
            kind = "turn_enter_list" if other else "turn_enter_see"
            return replace(event, kind=kind, X=mark, Y=other)
        kinds = ["turn_enter"] * 3 + ["turn_enter_door"] * doorway * 2
        kinds = ["turn_enter"] if passage.side and not _is_aside(passage, facts) else kinds
        outside = passage.along_m - turn.along_m <= _AT_EXIT_M
        kinds += ["leave_turn_enter"] * 3 if first and event.A and outside else []
        return replace(event, kind=pick(kinds, rng))
    if turn is not None:
        if rng.random() < 0.8 and passage.to_room == "hallway" != passage.from_room:
            return replace(event, kind="leave_turn" if event.A else "out_turn")
        behind_m = turn.along_m + 0.75
        ahead = names.best(lambda m: walked_to(m, facts, behind_m)) if marked else None
        return replace(event, kind="enter_turn_to" if ahead else "enter_turn", X=ahead)
    door = next((m for m in facts.landmarks if m.noun == passage.beside and m.nameable), None)
    marked = marked or many
    if marked and door and doorway and door.noun not in names.nouns:
        mark = names.refer(door, door.distance_m)
        if mark is not None and not mark.plural:
            return replace(event, kind="enter_beside", X=names.mention(mark))
    if (
        many
        and doorway
        and ((passage.alike and _is_faced(passage, facts)) or _counts(passage, facts))
    ):
        return replace(event, kind="enter_nth", s=passage.side, ordinal=passage.ordinal)
    if marked and (mark := names.best(inside)):
        if doorway and _tells_room(mark, passage, facts) and rng.random() < _BY_THING:
            return replace(event, kind="enter_by", X=mark)
        other = also() if rng.random() < taste.rooms else None
        if other is not None:
            return replace(event, kind="enter_list", X=mark, Y=other)
        here = moment_at(mark.mark, passage.along_m + within[-1])
        aside = here is not None and abs(here.bearing_deg) > _SIDED_DEG
        here_side = "left" if here and here.bearing_deg > 0 else "right"
        kind = "enter_with" if aside and not mark.plural else "enter_see"
        return replace(event, kind=kind, X=mark, s=here_side if aside else side)
    if passage.alike:
        told = passage.side and doorway and _is_faced(passage, facts)
        kind = "enter_nth" if told else "enter" if passage.side else "enter_ahead"
        return replace(event, kind=kind, s=passage.side, ordinal=passage.ordinal)
    kinds = ["leave"] * 3 if first and event.A else ["enter"]
    if passage_ahead(passage, facts) and gap_m >= 1.0 and not (first and event.A):
        kinds += ["enter_ahead"]
    if doorway:
        kinds += ["leave_door"] if first and event.A else ["enter_door"]
    return replace(event, kind=pick(kinds, rng))


def passage_ahead(passage: PassageFact, facts: PathFacts) -> bool:
    """Return whether a passage is straight ahead, not at a side of who walks on."""
    low, high = (passage.along_m + gap for gap in _AHEAD_M)
    return not passage.side and not any(low <= turn.along_m <= high for turn in facts.turns)


def is_unique(passage: PassageFact, facts: PathFacts) -> bool:
    """Return whether the name of the room entered says where to go."""
    into = next(v for v in facts.visits if v.from_m >= passage.along_m - 0.1)
    return bool(passage.to_room) and passage.to_room != "hallway" and not into.twins


def _tells_room(thing: Reference, passage: PassageFact, facts: PathFacts) -> bool:
    """Return whether a room is the only one near the path with such a thing."""
    rooms = {m.room for m in facts.landmarks if thing.mark.noun in answers(m.noun)}
    return not thing.plural and rooms == {passage.to_room} and is_unique(passage, facts)


def is_slight(turn: TurnFact, facts: PathFacts) -> bool:
    """Return whether a turn is slight, with the bends around it."""
    return max(abs(turn.angle_deg), manoeuvre_deg(facts.turns, turn.along_m)) < SLIGHT_DEG


def one_of_many(passage: PassageFact | None, facts: PathFacts) -> bool:
    """Return whether a doorway is at a side of a room that has several."""
    if passage is None or not (passage.side and _is_aside(passage, facts)):
        return False
    return passage.alike > 0 or (passage.doorway and _left(passage, facts).exits >= _MANY_EXITS)


def just_passed(
    facts: PathFacts, along_m: float, gap_m: float
) -> Callable[[LandmarkFact], float | None]:
    """Return how far a thing is that is passed right before a place of the path [m]."""
    from_m = along_m - min(_JUST_M, gap_m - 0.3)
    room = facts.room_at(along_m - 0.3)

    def far(mark: LandmarkFact) -> float | None:
        just = mark.room == room and mark.noun not in HUNG
        return mark.distance_m if just and passed(mark, facts, from_m, along_m - 0.3) else None

    return far


def _is_aside(passage: PassageFact, facts: PathFacts) -> bool:
    """Return whether a doorway is on its side from where it comes into view, too."""
    sign = 1.0 if passage.side == "left" else -1.0
    from_m, to_m = _left(passage, facts).from_m, passage.along_m - 1.0
    return all(
        sign * m.distance_m * np.sin(np.deg2rad(m.facing_deg)) > -_SWING_M
        for mark in facts.landmarks
        if mark.noun == DOOR and abs(mark.along_m - passage.along_m) < 0.6
        for m in mark.moments
        if m.open and from_m <= m.along_m <= to_m
    )


def _counts(passage: PassageFact, facts: PathFacts) -> bool:
    """Return whether the place of a doorway in the row counts doorways of the room left alone."""
    from_m = _left(passage, facts).from_m + 0.5
    row = [
        mark.leads
        for mark in facts.landmarks
        if mark.noun == DOOR
        and mark.side == passage.side
        and mark.distance_m <= PASS_DOOR_M
        and from_m < mark.along_m < passage.along_m - 0.5
    ]
    own = [leads for leads in row if passage.from_room in leads]
    return passage.ordinal == 1 + len(own) and _is_faced(passage, facts)


def _is_faced(passage: PassageFact, facts: PathFacts) -> bool:
    """Return whether it is clear which way one faces in a room: by its doorway, or by a turn."""
    visit = _left(passage, facts)
    entry = [p for p in facts.passages if abs(p.along_m - visit.from_m) < 0.1]
    turned = (
        abs(turn.angle_deg) >= _FACED_DEG
        for turn in facts.turns
        if visit.from_m - 0.5 <= turn.along_m <= passage.along_m - 0.8
    )
    return not entry or entry[0].doorway or any(turned)


def _left(passage: PassageFact, facts: PathFacts) -> VisitFact:
    before = (v for v in reversed(facts.visits) if v.from_m <= passage.along_m - 0.1)
    return next(before, facts.visits[0])
