"""Which turns and steps into rooms of a path a text tells."""

from collections.abc import Sequence
from dataclasses import dataclass

from ..facts.records import ClimbFact, PassageFact, PathFacts, TurnFact, manoeuvre_deg

TELL_DEG = 35.0  # smaller turns are mentioned only where nothing else shows the way
CLEAR_DEG = 50.0  # these are mentioned even where the next turn undoes part of them
_PLAIN_DEG = 44.0
HINT_DEG = 30.0
SLIGHT_DEG, SHARP_DEG = 50.0, 122.0
_MIDDLING_DEG = 65.0
_ONE_BEND_M = 1.6
_WEAVING_M = 2.0
_DOOR_AFTER_TURN_M = (-0.3, 1.5)  # a doorway this far behind a turn is one step with it
_TURN_AFTER_DOOR_M = 1.7
_TO_STAIRS_M = 1.2  # a turn so shortly before stairs leads to them


@dataclass(frozen=True)
class Move:
    """A turn, a step into another room or a way over stairs, or a turn and one of these.

    Attributes:
        along_m: where it begins [m].
        turn, passage, climb: of the facts.
        turn_first: the turn leads into the room.
    """

    along_m: float
    turn: TurnFact | None = None
    passage: PassageFact | None = None
    turn_first: bool = False
    climb: ClimbFact | None = None


def mentioned_turns(facts: PathFacts, *, every: bool = False) -> list[TurnFact]:
    """Return the turns worth mentioning; small ones that undo each other are weaving.

    Args:
        every: those are told, too.
    """
    result = []
    for turn in _one_bend([t for t in facts.turns if not facts.on_stairs(t.along_m)]):
        size = abs(turn.angle_deg)
        if facts.length_m - turn.along_m < 0.7:
            continue
        small = HINT_DEG <= size < TELL_DEG
        lonely = all(
            abs(other.along_m - turn.along_m) > 3.0 for other in facts.turns if other is not turn
        )
        undoing = _opposed(facts, turn)
        # The other one is not clear and stays untold: this side alone would mislead.
        balanced = any(
            TELL_DEG <= abs(other.angle_deg) < CLEAR_DEG
            and abs(turn.angle_deg + other.angle_deg) < HINT_DEG
            and _opposed(facts, other) == [turn]
            for other in undoing
        )
        clear = (size >= _PLAIN_DEG and not balanced) or (size >= TELL_DEG and not undoing)
        if clear or (every and size >= HINT_DEG) or (small and lonely and turn.along_m > 1.0):
            result.append(turn)
    return result


def _one_bend(turns: Sequence[TurnFact]) -> list[TurnFact]:
    """Return the turns, those to one side that follow each other closely as one wide bend."""
    result: list[TurnFact] = []
    for turn in turns:
        before = result[-1] if result else None
        if (
            before
            and before.side == turn.side
            and turn.along_m - before.along_m <= _ONE_BEND_M
            and min(abs(before.angle_deg), abs(turn.angle_deg)) < CLEAR_DEG
            and abs(before.angle_deg + turn.angle_deg) <= SHARP_DEG
        ):
            middle = 0.5 * (before.along_m + turn.along_m)
            result[-1] = TurnFact(round(middle, 2), before.angle_deg + turn.angle_deg)
        else:
            result.append(turn)
    return result


def _opposed(facts: PathFacts, turn: TurnFact) -> list[TurnFact]:
    """Return the turns to the other side that are near enough to undo one."""
    return [
        other
        for other in facts.turns
        if other.side != turn.side
        and abs(other.along_m - turn.along_m) <= _WEAVING_M
        and abs(other.angle_deg) >= HINT_DEG
    ]


def undone(facts: PathFacts, turn: TurnFact) -> bool:
    """Return whether smaller bends right after a turn of middling size leave a slight one of it."""
    back_deg = (
        abs(other.angle_deg)
        for other in facts.turns
        if other.side != turn.side
        and 0.0 < other.along_m - turn.along_m <= _WEAVING_M
        and abs(other.angle_deg) < TELL_DEG
    )
    middling = manoeuvre_deg(facts.turns, turn.along_m) <= _MIDDLING_DEG
    return middling and abs(turn.angle_deg) - sum(back_deg) < SLIGHT_DEG


def moves(facts: PathFacts, *, every: bool = False) -> list[Move]:
    """Return turns and steps into other rooms, in order; a turn at a door is one move with it."""
    result: list[Move] = []
    # One hallway that widens is one room to who walks through it.
    passages = [p for p in facts.doors if p.doorway or p.from_room != p.to_room]
    turns = mentioned_turns(facts, every=every)
    for climb in facts.climbs:
        near = (t for t in turns if 0.0 <= climb.along_m - t.along_m <= _TO_STAIRS_M)
        turn = next(near, None)
        if turn is not None:
            turns.remove(turn)
        result.append(Move(turn.along_m if turn else climb.along_m, turn, climb=climb))
    for n, turn in enumerate(turns):
        low, high = (turn.along_m + gap for gap in _DOOR_AFTER_TURN_M)
        if n + 1 < len(turns):  # the doorway belongs to the turn that is nearer to it
            high = min(high, turns[n + 1].along_m)
        aside = (p for p in passages if p.side == turn.side)  # not a door straight ahead
        after = next((p for p in aside if low <= p.along_m <= high), None)
        before = next(
            (p for p in passages if 0 < turn.along_m - p.along_m <= _TURN_AFTER_DOOR_M), None
        )
        if after is not None and turn.along_m > 0.4 and abs(turn.angle_deg) < SHARP_DEG:
            passages.remove(after)
            result.append(Move(min(turn.along_m, after.along_m), turn, after, turn_first=True))
        elif (
            before is not None
            and not before.alike
            and not undone(facts, turn)
            and SLIGHT_DEG <= abs(turn.angle_deg) < SHARP_DEG
        ):
            passages.remove(before)
            result.append(Move(before.along_m, turn, before))
        else:
            result.append(Move(turn.along_m, turn))
    result += [Move(p.along_m, passage=p) for p in passages]
    return sorted(result, key=lambda m: m.along_m)
