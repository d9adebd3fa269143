"""Choose what to mention of a path, before it is put into words."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..facts.doors import DOOR
from ..facts.records import LandmarkFact, PassageFact, PathFacts, TurnFact
from .grammar import name_of
from .records import Event, Taste
from .refer import (
    Reference,
    at_start,
    at_turn,
    in_view,
    landmark,
    passed,
    refer,
)

TELL_DEG = 40.0  # smaller turns are mentioned only where nothing else shows the way
CLEAR_DEG = 50.0  # these are mentioned even where the next turn undoes part of them
HINT_DEG = 30.0
_SLIGHT_DEG, _SHARP_DEG, _ROUND_DEG = 52.0, 122.0, 155.0
_WEAVING_M = 2.0
_DOOR_AFTER_TURN_M = (-0.3, 1.5)  # a doorway this far behind a turn is one step with it
_TURN_AFTER_DOOR_M = 1.7
_FAR_AHEAD_M = 2.5
_AT_END_M = 0.3  # a turn so close to the end of a way is not on it
_LONG_M = 4.0  # the longest way that a text leaves undescribed
_ONE_MOVE_M = 1.6  # two turns this near to each other are one manoeuvre


@dataclass(frozen=True)
class Move:
    """A turn, a step into another room, or both in one.

    Attributes:
        along_m: where it begins [m].
        turn, passage: of the facts.
        turn_first: the turn leads into the room.
    """

    along_m: float
    turn: TurnFact | None = None
    passage: PassageFact | None = None
    turn_first: bool = False


class Names:
    """What things and rooms are called in one text, and which were mentioned already."""

    def __init__(
        self, facts: PathFacts, rng: np.random.Generator, looks: float, without: Collection[str]
    ):
        """Start without a name; things in `without` are never mentioned."""
        self.facts, self.rng, self.looks, self.without = facts, rng, looks, without
        self.rooms: dict[str, str] = {}
        self.names: set[str] = set()
        self.homed = False  # whether the text says in which room it starts
        self.nouns: set[str] = set()

    def room(self, name: str) -> str:
        """Return what a room is called throughout the text."""
        if name not in self.rooms:
            self.rooms[name] = name_of(name, self.rng) if name else ""
        return self.rooms[name]

    def entered(self, passage: PassageFact) -> str:
        """Return the room entered, told from one of the same kind that is left."""
        room = self.room(passage.to_room)
        before = [v for v in self.facts.visits if v.from_m < passage.along_m - 0.1]
        if not room or passage.to_room not in [v.room for v in before]:
            return room
        twins = max(v.twins for v in before if v.room == passage.to_room)
        if passage.to_room == "hallway":
            return f"next {room}"
        return f"other {room}" if twins == 1 else f"another {room}"

    def best(
        self, near: Callable[[LandmarkFact], float | None], *, at_goal: bool = False
    ) -> Reference | None:
        """Return a reference to one of the best things that were not mentioned yet.

        Args:
            near: how far a thing is [m], None if it will not do.
        """
        options = []
        for mark in self.facts.landmarks:
            if mark.noun in self.nouns or mark.name in self.without or mark.noun == DOOR:
                continue
            if (distance_m := near(mark)) is not None:
                reference = self.refer(mark, distance_m, at_goal=at_goal)
                if reference is not None:
                    options.append((-reference.salience * self.rng.uniform(0.5, 1.5), reference))
        return self.mention(min(options, key=lambda o: o[0])[1]) if options else None

    def refer(
        self, mark: LandmarkFact, distance_m: float, *, at_goal: bool = False
    ) -> Reference | None:
        """Return a reference with a name and perhaps a colour or material."""
        looks = [word for word in (mark.colour, mark.material, _size(mark)) if word]
        look = ""
        if looks and self.rng.random() < self.looks:
            look = looks[int(self.rng.integers(len(looks)))]
        phrase = name_of(mark.noun, self.rng)
        return refer(mark, self.facts, distance_m, phrase, look, at_goal=at_goal)

    def mention(self, reference: Reference) -> Reference:
        """Remember a thing."""
        self.names.add(reference.name)
        self.nouns.add(reference.noun)
        return reference

    def beside(self, reference: Reference) -> Reference | None:
        """Return the thing that stands right beside another, if it can be named."""
        mark = next((m for m in self.facts.landmarks if m.name == reference.name), None)
        other = landmark(self.facts, mark.beside, self.without) if mark else None
        if reference.plural or other is None or other.noun in self.nouns:
            return None
        result = self.refer(other, other.distance_m)
        return None if result is None or result.plural else self.mention(result)


_BIG = frozenset(("sofa", "bed", "table", "desk", "cabinet"))
_TALL = frozenset(("wardrobe", "bookshelf"))
_LARGE_M = 1.7


def _size(mark: LandmarkFact) -> str:
    """Return an adjective for a thing of clearly more than the usual size."""
    head = mark.noun.split()[-1]
    if head in _TALL and mark.size_m >= _LARGE_M:
        return "tall"
    return "large" if head in _BIG and mark.size_m >= _LARGE_M else ""


# moves ------------------------------------------------------------------------------------------


def mentioned_turns(facts: PathFacts) -> list[TurnFact]:
    """Return the turns worth mentioning; small ones that undo each other are weaving."""
    result = []
    for turn in facts.turns:
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
        clear = (size >= CLEAR_DEG and not balanced) or (size >= TELL_DEG and not undoing)
        if clear or (small and lonely and turn.along_m > 1.0):
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


def moves(facts: PathFacts) -> list[Move]:
    """Return turns and steps into other rooms, in order; a turn at a door is one move with it."""
    result: list[Move] = []
    # One hallway that widens is one room to who walks through it.
    passages = [p for p in facts.passages if p.doorway or p.from_room != p.to_room]
    turns = mentioned_turns(facts)
    for n, turn in enumerate(turns):
        low, high = (turn.along_m + gap for gap in _DOOR_AFTER_TURN_M)
        if n + 1 < len(turns):  # the doorway belongs to the turn that is nearer to it
            high = min(high, turns[n + 1].along_m)
        after = next((p for p in passages if low <= p.along_m <= high), None)
        before = next(
            (p for p in passages if 0 < turn.along_m - p.along_m <= _TURN_AFTER_DOOR_M), None
        )
        if after is not None and turn.along_m > 0.4 and abs(turn.angle_deg) < _SHARP_DEG:
            passages.remove(after)
            result.append(Move(min(turn.along_m, after.along_m), turn, after, turn_first=True))
        elif before is not None and abs(turn.angle_deg) < _SHARP_DEG:
            passages.remove(before)
            result.append(Move(before.along_m, turn, before))
        else:
            result.append(Move(turn.along_m, turn))
    result += [Move(p.along_m, passage=p) for p in passages]
    return sorted(result, key=lambda m: m.along_m)


def move_events(facts: PathFacts, names: Names, taste: Taste) -> list[Event]:
    """Return the moves as events, most with a thing where one is visible."""
    result: list[Event] = []
    todo = moves(facts)
    if taste.voice == "terse":
        todo = [_brief(m, after, facts, names.rng) for m, after in pairwise([*todo, None]) if m]
    while todo:
        move, todo = todo[0], todo[1:]
        after = todo[0] if todo else None
        pair = _joined(move, after, result)
        if pair is None and taste.voice == "terse":
            pair = _through(move, after, names)
        if pair is not None:
            result.append(pair)
            todo = todo[1:]
        elif move.passage is None:
            result.append(_turn(move, facts, names, taste))
        else:
            result.append(_passage(move, move.passage, facts, names, taste))
    return result


def _unique(passage: PassageFact, facts: PathFacts) -> bool:
    """Return whether the name of the room entered says where to go."""
    into = next(v for v in facts.visits if v.from_m >= passage.along_m - 0.1)
    return bool(passage.to_room) and passage.to_room != "hallway" and not into.twins


def _brief(move: Move, after: Move | None, facts: PathFacts, rng: np.random.Generator) -> Move:
    """Return a move without the turn, where the name of the next room is enough."""
    target = move if move.turn_first or move.turn is None else after
    known = target is not None and target.passage and _unique(target.passage, facts)
    near = target is not None and target.along_m - move.along_m < 4.0
    if move.passage and move.turn and known and near and rng.random() < 0.7:
        return Move(move.along_m, passage=move.passage)
    return move


def _through(move: Move, after: Move | None, names: Names) -> Event | None:
    """Return two steps into rooms, without a turn, as one."""
    if after is None or move.turn or after.turn or not (move.passage and after.passage):
        return None
    rooms = names.entered(move.passage), names.entered(after.passage)
    if not all(rooms) or names.rng.random() < 0.3:
        return None
    return Event("onward", move.along_m, B=rooms[0], C=rooms[1])


def _joined(move: Move, after: Move | None, before: Sequence[Event]) -> Event | None:
    """Return two turns as one manoeuvre."""
    if after is None or move.passage or after.passage or not (move.turn and after.turn):
        return None
    near = after.along_m - move.along_m <= _ONE_MOVE_M
    sizes = (abs(move.turn.angle_deg), abs(after.turn.angle_deg))
    if not near or min(sizes) < CLEAR_DEG or max(sizes) > _SHARP_DEG:
        return None
    kind = "twice" if move.turn.side == after.turn.side else "jog"
    return Event(kind, move.along_m, s=move.turn.side, t=after.turn.side)


def _turn(move: Move, facts: PathFacts, names: Names, taste: Taste) -> Event:
    turn = move.turn
    assert turn is not None
    size, along = abs(turn.angle_deg), turn.along_m
    if size >= _ROUND_DEG:
        return Event("around", along)
    if size < _SLIGHT_DEG or size > _SHARP_DEG:
        return Event("slight" if size < _SLIGHT_DEG else "sharp", along, s=turn.side)
    if names.rng.random() < taste.marks:
        options: list[tuple[str, Callable[[LandmarkFact], float | None]]] = [
            ("turn_at", lambda m: at_turn(m, along) if along > 0.8 else None),
            ("turn_to", lambda m: in_view(m, along + 0.75, 35.0, 5.0)),
            ("cue", lambda m: in_view(m, along - 1.0, 30.0, 3.2) if along > 1.2 else None),
        ]
        names.rng.shuffle(options)
        for kind, near in options:
            if mark := names.best(near):
                return Event(kind, along, X=mark, s=turn.side)
    return Event("turn", along, s=turn.side)


def _passage(
    move: Move, passage: PassageFact, facts: PathFacts, names: Names, taste: Taste
) -> Event:
    turn, along, rng = move.turn, move.along_m, names.rng
    side = turn.side if turn else ""
    first = passage is facts.passages[0] and along < 4.0
    room = names.entered(passage)
    left = "" if first and names.homed else names.room(passage.from_room)
    event = Event("enter", along, A=left, B=room, s=side)
    slight = turn is not None and abs(turn.angle_deg) < _SLIGHT_DEG
    if not room:
        kind = "leave_turn" if side and not move.turn_first else "leave_only"
        kind = "turn" if side and move.turn_first else kind
        return replace(event, kind=kind if event.A or kind == "turn" else "enter")
    marked = rng.random() < taste.marks
    within = [m for m in (0.3, 0.8) if passage.along_m + m < facts.length_m]

    def inside(mark: LandmarkFact) -> float | None:
        if mark.room != passage.to_room:
            return None
        seen = (in_view(mark, passage.along_m + m, 75.0, 5.0) for m in within)
        return next((far for far in seen if far is not None), None)

    if turn is not None and move.turn_first:
        if passage.alike:  # another doorway leads to such a room, too
            return replace(event, kind="turn_enter_nth", s=passage.side, ordinal=passage.ordinal)
        if slight:
            return replace(event, kind="slight_enter")
        if marked and rng.random() < 0.5:
            near = names.best(lambda m: at_turn(m, turn.along_m) if along > 0.8 else None)
            if near:
                return replace(event, kind="turn_enter_at", X=near)
        if marked and (mark := names.best(inside)):
            return replace(event, kind="turn_enter_see", X=mark)
        kinds = ["turn_enter"] * 3 + ["turn_enter_door"] * passage.doorway * 2
        kinds += ["leave_turn_enter"] * 3 if first and event.A else []
        return replace(event, kind=str(rng.choice(kinds)))
    if turn is not None:
        if slight or (first and event.A and rng.random() < 0.3):
            kind = "leave_turn" if event.A and not slight else "enter"
            return replace(event, kind=kind)
        ahead = names.best(lambda m: in_view(m, turn.along_m + 0.75, 35.0, 5.0)) if marked else None
        return replace(event, kind="enter_turn_to" if ahead else "enter_turn", X=ahead)
    door = next((m for m in facts.landmarks if m.noun == passage.beside and m.nameable), None)
    marked = marked or passage.alike > 0
    if marked and door and passage.doorway and door.noun not in names.nouns:
        mark = names.refer(door, door.distance_m)
        if mark is not None and not mark.plural:
            return replace(event, kind="enter_beside", X=names.mention(mark))
    if marked and (mark := names.best(inside)):
        return replace(event, kind="enter_see", X=mark)
    if passage.alike:
        kind = "enter_nth" if passage.side and passage.doorway else "enter_ahead"
        return replace(event, kind=kind, s=passage.side, ordinal=passage.ordinal)
    kinds = ["leave"] * 3 if first and event.A else ["enter"]
    if passage.doorway:
        kinds += ["leave_door"] if first and event.A else ["enter_door"]
    return replace(event, kind=str(rng.choice(kinds)))


def ambiguous(facts: PathFacts) -> str:
    """Return why no text can say which doorway is meant, "" where every one can be told."""
    for passage in facts.passages:
        if passage.alike and passage.side and not (passage.doorway or passage.beside):
            return (
                f"{passage.alike + 1} openings of the {passage.from_room or 'room'} lead to a "
                f"{passage.to_room}, and nothing tells them apart"
            )
    return ""


# the start and what is passed -----------------------------------------------------------------


def start_events(facts: PathFacts, names: Names, taste: Taste) -> list[Event]:
    """Return an event that says where the way starts, or none."""
    looks_away = bool(facts.turns) and facts.turns[0].along_m < 0.3
    if names.rng.random() >= taste.start:
        return []
    room = "" if facts.start_rooms else names.room(facts.visits[0].room)
    kinds: dict[str, str] = {}

    def near(mark: LandmarkFact) -> float | None:
        found = None if looks_away else at_start(mark)
        if found is not None:
            kinds[mark.name] = found[0]
        return found[1] if found else None

    mark = names.best(near)
    if mark is None:
        names.homed = bool(room)
        return [Event("home", 0.0, A=room)] if room else []
    kind = kinds[mark.name]
    side = mark.side if kind == "beside_start" else ""
    if kind == "beside_start" and not side:
        return []
    if room and kind != "beside_start" and names.rng.random() < 0.5:
        kind, names.homed = f"home_{kind}", True
    return [Event(kind, 0.0, A=room, X=mark, s=side)]


def passed_events(
    events: Sequence[Event], facts: PathFacts, names: Names, taste: Taste
) -> list[Event]:
    """Return events of things passed on the longest stretches between others."""
    edges = [0.0, *(_end(e) for e in events)]
    starts = [*(e.along_m for e in events), facts.length_m]
    result: list[Event] = []
    for low, high in sorted(zip(edges, starts, strict=True), key=lambda pair: pair[0] - pair[1]):
        if high - low < taste.gap_m or len(result) >= taste.passed:
            continue
        mark = names.best(
            lambda m, low=low, high=high: (
                m.distance_m if passed(m, facts, low + 0.5, high - 0.6) else None
            )
        )
        if mark is None:
            result += _passed_door(facts, names, low + 0.7, high - 0.7)
            continue
        event = Event("pass", mark.along_m, X=mark, s=mark.side)
        across = (
            names.best(
                lambda m, mark=mark: (
                    m.distance_m
                    if {m.side, mark.side} == {"left", "right"}
                    and abs(m.along_m - mark.along_m) <= 0.8
                    and passed(m, facts, mark.along_m - 0.9, mark.along_m + 0.9)
                    else None
                )
            )
            if names.rng.random() < 0.5
            else None
        )
        beside = names.beside(mark) if across is None and names.rng.random() < 0.35 else None
        if across is not None:
            event = replace(event, kind="between", Y=across)
        elif beside is not None:
            event = replace(event, kind="pass_near", Y=beside)
        elif names.rng.random() < 0.7:
            event = replace(event, kind="pass_side")
        result.append(event)
    return result


def _passed_door(facts: PathFacts, names: Names, low_m: float, high_m: float) -> list[Event]:
    """Return a doorway that is passed, if only one of the room leads where it leads."""
    entered = {v.room for v in facts.visits}
    for mark in facts.landmarks:
        visit = next((v for v in facts.visits if mark.along_m <= v.to_m), facts.visits[-1])
        others = [room for room in mark.leads if room not in entered]
        here = low_m <= mark.along_m <= high_m and mark.distance_m <= PASS_DOOR_M and mark.side
        clear = len(others) == 1 and visit.room in mark.leads and mark.name not in names.names
        if mark.noun == DOOR and here and clear and visit.beyond.count(others[0]) == 1:
            names.names.add(mark.name)
            return [Event("pass_door", mark.along_m, C=names.room(others[0]), s=mark.side)]
    return []


PASS_DOOR_M = 1.8


def _end(event: Event) -> float:
    two = event.kind.startswith(("enter_turn", "turn_enter", "jog", "twice", "leave_turn"))
    return event.along_m + (1.2 if two else 0.2)


# distances ---------------------------------------------------------------------------------------

_PLAIN_TURNS = frozenset(("turn", "slight", "sharp", "jog", "twice"))


def with_distances(
    events: Sequence[Event], stop: Event, facts: PathFacts, names: Names, taste: Taste
) -> list[Event]:
    """Say how far to walk before a turn that nothing announces, or which room to follow."""
    result: list[Event] = []
    before = 0.0
    for event in events:
        gap = event.along_m - before
        bare = event.kind in _PLAIN_TURNS or event.kind in ("leave_only", "leave_turn")
        room = _room_at(facts, before + 0.5 * gap)
        beside = event.kind in ("pass", "pass_side", "between", "pass_near", "pass_door")
        gap = gap if taste.voice != "terse" else gap - _LONG_M
        if (
            taste.voice != "terse"
            and room == "hallway"
            and gap > (2.0 if bare else _LONG_M)
            and not beside
        ):
            result.append(Event("follow", before + 0.2, B=names.room(room)))
        if bare and gap > 1.8:
            result.append(Event("walk", before, far_m=gap))
        result.append(event)
        before = max(before, _end(event) - 0.2)
    hall = facts.visits[-1]
    if (
        taste.voice != "terse"
        and hall.room == "hallway"
        and stop.along_m - max(before, hall.from_m) > _LONG_M
    ):
        result.append(Event("follow", before + 0.2, B=names.room(hall.room)))
    return result


def bent(events: Sequence[Event], facts: PathFacts) -> list[Event]:
    """Mark the events that tell a way with a bend, which nobody would call straight."""
    result = []
    for event in events:
        low, high = event.along_m, event.along_m + event.far_m
        if event.kind.startswith("stop"):
            low, high = facts.length_m - event.far_m, facts.length_m
        within = (low + _AT_END_M < turn.along_m < high - _AT_END_M for turn in facts.turns)
        result.append(replace(event, bent=any(within)))
    return result


def _room_at(facts: PathFacts, along_m: float) -> str:
    return next((v.room for v in facts.visits if along_m <= v.to_m), "")
