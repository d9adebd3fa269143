"""Choose what to mention of a path, before it is put into words."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..facts.doors import DOOR
from ..facts.records import LandmarkFact, PassageFact, PathFacts, TurnFact, VisitFact, manoeuvre_deg
from .climbs import climb_event, off_stairs, with_end
from .grammar import is_hall, pick
from .moves import CLEAR_DEG, SHARP_DEG, SLIGHT_DEG, Move, moves
from .names import Names
from .records import Event, Taste
from .refer import (
    HUNG,
    PASS_DOOR_M,
    Reference,
    around,
    at_turn,
    before_reached,
    comes_to,
    in_sight,
    in_view,
    moment_at,
    new_in_view,
    passed,
    walked_to,
)

_ROUND_DEG = 155.0
_MANY_EXITS, _COUNTED = 3, 0.6
_BY_THING = 0.25  # how often a room is told by a thing in it alone
_BEFORE_STAIRS = 2  # through so many rooms the way to the stairs may be left unsaid
_AT_ONCE_M = 1.3
_BESIDE_M = 1.0  # one turns beside a thing that is so near
_LEADS_M, _LEADS_DEG = 3.5, 110.0  # how far and how sharply a turn may lead to a thing
_JUST_M = 1.5
_SIDED_DEG = 40.0  # a thing so far aside of who enters is on his side
_SWING_M = 0.4  # a doorway so far to the other side is not on its side
_AGAIN = {"turn": "again", "turn_enter": "again_enter"}
_TURNED = ("turn", "leave_turn", "out_turn", "enter_turn", "leave_turn_enter", "turn_enter")
_ONE_MOVE_M = 1.6  # two turns this near to each other are one manoeuvre


def move_events(facts: PathFacts, names: Names, taste: Taste) -> list[Event]:
    """Return the moves as events, most with a thing where one is visible."""
    result: list[Event] = []
    todo = moves(facts)
    todo = [_brief(m, after, facts, taste, names.rng) for m, after in pairwise([*todo, None]) if m]
    if taste.voice == "terse":
        todo = [m for m in todo if m.passage or m.climb or not m.turn or _tells(m.turn)]
        todo = _from_stairs(todo, facts) if names.rng.random() < taste.brief else todo
    while todo:
        move, todo = todo[0], todo[1:]
        after = todo[0] if todo else None
        pair = _joined(move, after)
        if pair is None and (
            taste.voice == "terse" or (after and after.along_m - move.along_m < 3)
        ):
            pair = _through(move, after, names)
        if pair is not None:
            result.append(pair)
            todo = todo[1:]
        else:
            gap = move.along_m - (result[-1].done_m if result else 0.0)
            tell = climb_event if move.climb else _turn if move.passage is None else _passage
            upto_m = after.along_m if after else facts.length_m - 0.5
            led = None if move.climb or move.passage else _led(move, upto_m, facts, names, taste)
            result.append(led or tell(move, gap, facts, names, taste))
    result = with_end([off_stairs(event, facts) for event in result], names.rng)
    return [_again(event, before) for before, event in pairwise([None, *result]) if event]


def _from_stairs(todo: list[Move], facts: PathFacts) -> list[Move]:
    """Return the moves from the first stairs on, where the way to them needs no words."""
    first = next((k for k, move in enumerate(todo) if move.climb), 0)
    if not first or sum(v.from_m < todo[first].along_m for v in facts.visits) > _BEFORE_STAIRS:
        return todo
    return [replace(todo[first], turn=None), *todo[first + 1 :]]


def _again(event: Event, before: Event | None) -> Event:
    """Return a turn as one to the same side again, where the last event turned there, too."""
    kind = _AGAIN.get(event.kind)
    same = before is not None and before.s == event.s and before.kind in _TURNED
    return replace(event, kind=kind) if kind and same else event


def _unique(passage: PassageFact, facts: PathFacts) -> bool:
    """Return whether the name of the room entered says where to go."""
    into = next(v for v in facts.visits if v.from_m >= passage.along_m - 0.1)
    return bool(passage.to_room) and passage.to_room != "hallway" and not into.twins


def _tells(turn: TurnFact) -> bool:
    return abs(turn.angle_deg) >= SLIGHT_DEG


def _is_slight(turn: TurnFact, facts: PathFacts) -> bool:
    return max(abs(turn.angle_deg), manoeuvre_deg(facts.turns, turn.along_m)) < SLIGHT_DEG


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


def _one_of_many(passage: PassageFact | None, facts: PathFacts) -> bool:
    """Return whether a doorway is at a side of a room that has several."""
    if passage is None or not (passage.side and _is_aside(passage, facts)):
        return False
    return passage.alike > 0 or (passage.doorway and _left(passage, facts).exits >= _MANY_EXITS)


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
    return passage.ordinal == 1 + len(own)


def _left(passage: PassageFact, facts: PathFacts) -> VisitFact:
    before = (v for v in reversed(facts.visits) if v.from_m <= passage.along_m - 0.1)
    return next(before, facts.visits[0])


def _brief(
    move: Move, after: Move | None, facts: PathFacts, taste: Taste, rng: np.random.Generator
) -> Move:
    """Return a move without the turn, where the name of the next room is enough."""
    target = move if move.turn_first or move.turn is None else after
    known = target is not None and target.passage and _unique(target.passage, facts)
    near = target is not None and target.along_m - move.along_m < 4.0
    near = near and target is move and not _one_of_many(move.passage, facts)
    if move.passage and move.turn and known and near and rng.random() < taste.brief:
        return Move(move.along_m, passage=move.passage)
    return move


def _through(move: Move, after: Move | None, names: Names) -> Event | None:
    """Return two steps into rooms, without a turn, as one."""
    if after is None or move.turn or after.turn or not (move.passage and after.passage):
        return None
    rooms = names.entered(move.passage), names.entered(after.passage)
    if not all(rooms) or names.rng.random() < 0.3:
        return None
    return Event("onward", move.along_m, B=rooms[0], C=rooms[1], to_m=after.along_m)


def _joined(move: Move, after: Move | None) -> Event | None:
    """Return two turns as one manoeuvre."""
    if after is None or move.passage or after.passage or not (move.turn and after.turn):
        return None
    if move.climb or after.climb:
        return None
    near = after.along_m - move.along_m <= _ONE_MOVE_M
    sizes = (abs(move.turn.angle_deg), abs(after.turn.angle_deg))
    if not near or min(sizes) < CLEAR_DEG or max(sizes) > SHARP_DEG:
        return None
    kind = "twice" if move.turn.side == after.turn.side else "jog"
    sides = move.turn.side, after.turn.side
    return Event(kind, move.along_m, s=sides[0], t=sides[1], to_m=after.along_m)


def _led(move: Move, upto_m: float, facts: PathFacts, names: Names, taste: Taste) -> Event | None:
    """Return a turn as the way to a thing that it leads to."""
    turn = move.turn
    assert turn is not None
    if abs(turn.angle_deg) > _LEADS_DEG or names.rng.random() >= taste.toward:
        return None
    to_m = min(turn.along_m + _LEADS_M, upto_m)
    thing = names.best(lambda m: comes_to(m, facts, turn.along_m, to_m))
    if thing is None or thing.plural:
        return None
    return Event("to_thing", turn.along_m, X=thing, to_m=min(thing.mark.along_m, to_m))


def _turn(move: Move, gap_m: float, facts: PathFacts, names: Names, taste: Taste) -> Event:
    turn = move.turn
    assert turn is not None
    size, along = abs(turn.angle_deg), turn.along_m
    if size >= _ROUND_DEG:
        return Event("around", along)
    slight = _is_slight(turn, facts)
    if slight or size > SHARP_DEG:
        return Event("slight" if slight else "sharp", along, s=turn.side)
    # Within a room, a turn that does not come at once needs a cue.
    at_once_m = _AT_ONCE_M * (2.0 if taste.voice == "terse" else 1.0)
    if gap_m > at_once_m or names.rng.random() < taste.marks:
        options: list[tuple[str, Callable[[LandmarkFact], float | None]]] = [
            ("turn_at", lambda m: at_turn(m, along) if along > 0.8 else None),
            ("turn_beside", lambda m: _within(at_turn(m, along), _BESIDE_M)),
            ("turn_by", lambda m: around(m, turn)),
            ("turn_after", _just_passed(facts, along, gap_m)),
            ("turn_before", lambda m: before_reached(m, facts, along)),
            ("turn_to", lambda m: walked_to(m, facts, along + 0.75)),
            ("cue", lambda m: new_in_view(m, facts, along - 1.0) if along > 1.2 else None),
        ]
        for number in names.rng.permutation(len(options)):
            kind, near = options[number]
            if mark := names.best(near):
                return Event(kind, along, X=mark, s=turn.side)
    return Event("turn", along, s=turn.side)


def _within(far_m: float | None, reach_m: float) -> float | None:
    return far_m if far_m is not None and far_m <= reach_m else None


def _just_passed(
    facts: PathFacts, along_m: float, gap_m: float
) -> Callable[[LandmarkFact], float | None]:
    """Return how far a thing is that is passed right before a place of the path [m]."""
    from_m = along_m - min(_JUST_M, gap_m - 0.3)
    room = facts.room_at(along_m - 0.3)

    def far(mark: LandmarkFact) -> float | None:
        just = mark.room == room and mark.noun not in HUNG
        return mark.distance_m if just and passed(mark, facts, from_m, along_m - 0.3) else None

    return far


def _passage(move: Move, gap_m: float, facts: PathFacts, names: Names, taste: Taste) -> Event:
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
    many = doorway and _one_of_many(passage, facts)
    slight = turn is not None and _is_slight(turn, facts)
    if not room:
        kind = "leave_turn" if side and not move.turn_first else "leave_only"
        kind = "turn" if side and move.turn_first else kind
        return replace(event, kind=kind if event.A or kind == "turn" else "enter")
    marked = rng.random() < max(taste.marks, taste.rooms)
    within = [m for m in (0.3, 0.8) if passage.along_m + m < facts.length_m]

    def inside(mark: LandmarkFact) -> float | None:
        if mark.room != passage.to_room:
            return None
        seen = (in_view(mark, facts, passage.along_m + m, 75.0, 5.0) for m in within)
        return next((far for far in seen if far is not None), None)

    def also() -> Reference | None:
        sight = names.some(lambda m: in_sight(m, facts, passage.along_m + within[-1]))
        return names.best(inside) if sight is None or rng.random() < 0.5 else sight

    if turn is not None and move.turn_first:
        if (passage.alike and _is_aside(passage, facts)) or (
            many and _counts(passage, facts) and rng.random() < _COUNTED
        ):  # of several doorways
            return replace(event, kind="turn_enter_nth", s=passage.side, ordinal=passage.ordinal)
        if slight:
            return replace(event, kind="slight_enter")
        if marked and rng.random() < 0.5:
            near = names.best(lambda m: at_turn(m, turn.along_m) if along > 0.8 else None)
            if near:
                return replace(event, kind="turn_enter_at", X=near)
        after = names.best(_just_passed(facts, along, gap_m)) if marked else None
        if after:
            return replace(event, kind="turn_enter_after", X=after, t=after.mark.side)
        if marked and (mark := names.best(inside)):
            other = also() if rng.random() < taste.rooms else None
            kind = "turn_enter_list" if other else "turn_enter_see"
            return replace(event, kind=kind, X=mark, Y=other)
        kinds = ["turn_enter"] * 3 + ["turn_enter_door"] * doorway * 2
        kinds = ["turn_enter"] if passage.side and not _is_aside(passage, facts) else kinds
        kinds += ["leave_turn_enter"] * 3 if first and event.A else []
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
    if many and doorway and (passage.alike or _counts(passage, facts)):
        return replace(event, kind="enter_nth", s=passage.side, ordinal=passage.ordinal)
    if marked and (mark := names.best(inside)):
        told = mark.plural or passage.alike or is_hall(room)
        if not told and rng.random() < _BY_THING:
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
        kind = "enter_nth" if passage.side and doorway else "enter_ahead"
        return replace(event, kind=kind, s=passage.side, ordinal=passage.ordinal)
    kinds = ["leave"] * 3 if first and event.A else ["enter"]
    if not (passage.side or gap_m < 1.0 or (first and event.A)):
        kinds += ["enter_ahead"]
    if doorway:
        kinds += ["leave_door"] if first and event.A else ["enter_door"]
    return replace(event, kind=pick(kinds, rng))
