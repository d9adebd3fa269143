"""Choose what to mention of a path, before it is put into words."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..facts.records import LandmarkFact, PathFacts, TurnFact
from .climbs import climb_event, off_stairs, with_end
from .moves import CLEAR_DEG, SHARP_DEG, SLIGHT_DEG, Move, moves, undone
from .names import Names
from .passages import is_slight, is_unique, just_passed, one_of_many, passage_event
from .records import Event, Taste
from .refer import (
    around,
    at_turn,
    before_reached,
    comes_to,
    new_in_view,
    walked_to,
)

_ROUND_DEG = 155.0
_BEFORE_STAIRS = 2  # through so many rooms the way to the stairs may be left unsaid
_AT_ONCE_M = 1.3
_BESIDE_M = 1.0  # one turns beside a thing that is so near
_LEADS_M, _LEADS_DEG = 3.5, 60.0  # how far and how sharply a turn may lead to a thing
_AGAIN = {"turn": "again", "turn_enter": "again_enter"}
_TURNED = ("turn", "leave_turn", "out_turn", "enter_turn", "leave_turn_enter", "turn_enter")
_SOON_M = 4.0  # a turn so soon after another to the other side
_ONE_MOVE_M = 1.6  # two turns this near to each other are one manoeuvre


def move_events(facts: PathFacts, names: Names, taste: Taste) -> list[Event]:
    """Return the moves as events, most with a thing where one is visible."""
    result: list[Event] = []
    every = names.rng.random() < taste.paced
    todo = moves(facts, every=every)
    todo = [_brief(m, after, facts, taste, names.rng) for m, after in pairwise([*todo, None]) if m]
    if taste.voice == "terse" and not every:
        todo = [m for m in todo if m.passage or m.climb or not m.turn or _tells(m.turn, facts)]
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
            tell = climb_event if move.climb else _turn if move.passage is None else passage_event
            upto_m = after.along_m if after else facts.length_m - 0.5
            led = None if move.climb or move.passage else _led(move, upto_m, facts, names, taste)
            result.append(led or tell(move, gap, facts, names, taste))
    result = with_end([off_stairs(event, facts) for event in result], names.rng)
    pairs = [(before, event) for before, event in pairwise([None, *result]) if event]
    return [_again(event, before) for before, event in pairs if not _goes_on(event, before)]


def _goes_on(event: Event, before: Event | None) -> bool:
    """Return whether a slight bend only goes on with the one before."""
    if before is None or event.kind != "slight":
        return False
    return (event.kind, event.s) == (before.kind, before.s)


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


def _tells(turn: TurnFact, facts: PathFacts) -> bool:
    """Return whether even a short text needs a turn: a clear one, or one before the other side."""
    return abs(turn.angle_deg) >= SLIGHT_DEG or any(
        other.side != turn.side and 0.0 < other.along_m - turn.along_m <= _SOON_M
        for other in facts.turns
    )


def _brief(
    move: Move, after: Move | None, facts: PathFacts, taste: Taste, rng: np.random.Generator
) -> Move:
    """Return a move without the turn, where the name of the next room is enough."""
    target = move if move.turn_first or move.turn is None else after
    known = target is not None and target.passage and is_unique(target.passage, facts)
    near = target is not None and target.along_m - move.along_m < 4.0
    near = near and target is move and not one_of_many(move.passage, facts)
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
    return Event("onward", move.along_m, B=rooms[0], C=rooms[1], to_m=after.passage.along_m)


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
    thing = names.best(lambda m: comes_to(m, facts, turn.along_m, to_m), single=True)
    if thing is None:
        return None
    return Event("to_thing", turn.along_m, X=thing, to_m=min(thing.mark.along_m, to_m))


def _turn(move: Move, gap_m: float, facts: PathFacts, names: Names, taste: Taste) -> Event:
    turn = move.turn
    assert turn is not None
    size, along = abs(turn.angle_deg), turn.along_m
    if size >= _ROUND_DEG:
        return Event("around", along)
    slight = is_slight(turn, facts) or undone(facts, turn)
    if slight or size > SHARP_DEG:
        return Event("slight" if slight else "sharp", along, s=turn.side)
    # Within a room, a turn that does not come at once needs a cue.
    at_once_m = _AT_ONCE_M * (2.0 if taste.voice == "terse" else 1.0)
    if gap_m > at_once_m or names.rng.random() < taste.marks:
        options: list[tuple[str, Callable[[LandmarkFact], float | None]]] = [
            ("turn_at", lambda m: at_turn(m, along) if along > 0.8 else None),
            ("turn_beside", lambda m: _within(at_turn(m, along), _BESIDE_M)),
            ("turn_by", lambda m: around(m, turn)),
            ("turn_after", just_passed(facts, along, gap_m)),
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
