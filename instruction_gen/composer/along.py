"""Choose what to mention beside the moves: the start, what is passed, and how far to walk."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ..facts.doors import DOOR
from ..facts.records import LandmarkFact, PathFacts
from .grammar import pick
from .names import Names
from .records import PASSES, Event, Taste
from .refer import (
    PASS_DOOR_M,
    abeam_m,
    at_start,
    in_sight,
    in_view,
    passed,
    stands_at_goal,
    walked_over,
)

_AT_END_M = 0.3  # a turn so close to the end of a way is not on it
FEW_STEPS_M = 1.8  # a shorter way is not told in metres
_VIEW_M = 5.0  # what is in view ahead may be told where nothing is passed
_CHAINED = 0.8  # how often a second thing is passed in one breath
_MEETS_M = 2.5  # how far before a room begins the opening may that leads to it and others
_THROUGH_M = 0.5  # what is nearer is gone through
_OVER = 0.6  # how often a rug that is walked over is mentioned
_APART_M = 0.5  # between things of which one is passed first
_NOT = 0.4  # how often a doorway that is passed is told as one not to take
_BESIDE = 0.5  # how often a thing is told by what stands beside it, where something does
_LONG_M = 4.0  # the longest way that a text leaves undescribed
_LONG_HALL_M = 6.0
_LONG_THING_M, _CLOSE_M = 1.5, 1.2  # one walks along such a thing
_LONG_THINGS = frozenset(("bed", "bench", "counter", "desk", "sideboard", "sofa", "table"))
_PLAIN_TURNS = frozenset(("turn", "again", "slight", "sharp", "jog", "twice"))
# Events that name one thing, but not its side.
_STOPS_BY_ONE = frozenset(("stop_front", "stop_beside", "stop_close", "stop_in_by"))
_BY_ONE = _STOPS_BY_ONE - {"stop_in_by"} | {
    "facing", "behind", "turn_at", "turn_beside", "to_thing", "turn_before", "turn_to",
    "turn_after", "turn_enter_at", "cue", "enter_see", "enter_turn_to", "pass", "goal_thing",
}  # fmt: skip


def start_events(facts: PathFacts, names: Names, taste: Taste) -> list[Event]:
    """Return an event that says where the way starts, or none."""
    looks_away = bool(facts.turns) and facts.turns[0].along_m < 0.3
    if names.rng.random() >= taste.start:
        return []
    plain = facts.start_rooms or facts.visits[0].room == "hallway"
    room = "" if plain else names.name(facts.visits[0].room)
    kinds: dict[str, str] = {}

    def near(mark: LandmarkFact) -> float | None:
        found = None if looks_away else at_start(mark, facts)
        if found is not None:
            kinds[mark.name] = found[0]
        return found[1] if found else None

    best = names.best(near, single=True)
    if best is None:
        names.homed = bool(room)
        return [Event("home", 0.0, A=room)] if room else []
    kind = kinds[best.mark.name]
    side = best.mark.side if kind == "beside_start" else ""
    if kind == "beside_start" and not side:
        return []
    if room and names.rng.random() < 0.5:
        kind, names.homed = f"home_{kind}", True
    return [Event(kind, 0.0, A=room, X=best, s=side)]


def goal_events(facts: PathFacts, stop: Event, names: Names, taste: Taste) -> list[Event]:
    """Return an event that says first where the way ends, or none."""
    room, started = facts.goal_room, facts.visits[0].room
    new = room not in ("", "hallway", started) and not facts.goal_rooms
    alone = new and not (facts.climbs or facts.visits[-1].twins)
    thing = stop.X is not None and stop.kind in _STOPS_BY_ONE
    alone = alone and (stop.X is None or stop.X.mark.room in ("", room))
    if not (alone or thing) or names.rng.random() >= taste.goal:
        return []
    kind = "goal_both" if alone and thing else "goal_thing" if thing else "goal_room"
    return [Event(kind, 0.0, X=stop.X, B=names.name(room) if alone else "")]


def passed_events(
    events: Sequence[Event], stop: Event, facts: PathFacts, names: Names, taste: Taste
) -> list[Event]:
    """Return events of things passed on the longest stretches between others."""
    edges = [0.0, *(_end(e) for e in events)]
    starts = [*(e.along_m for e in events), facts.length_m]
    result: list[Event] = []
    for low, high in sorted(zip(edges, starts, strict=True), key=lambda pair: pair[0] - pair[1]):
        if high - low < taste.gap_m or len(result) >= taste.passed:
            continue
        over = partial(walked_over, facts=facts, low_m=low + 0.3, high_m=high - 0.3)
        rugs = names.rng.random() < _OVER
        rug = names.best(lambda m, over=over: 0.5 if over(m) else None) if rugs else None
        if rug is not None:
            result.append(Event("over", rug.mark.along_m, X=rug))
            continue
        past = stop.X.mark if stop.kind.startswith("stop_past") and stop.X else None
        best = names.best(_passing(facts, low + 0.5, high - 0.6, before=past))
        if best is None:
            doors = _passed_door(facts, names, low + 0.7, high - 0.7)
            result += doors or _view(facts, names, low + 0.4)
            continue
        if best.plural:  # a row of chairs is passed before and after much else
            continue
        mark = best.mark
        event = Event("pass", mark.along_m, X=best, s=mark.side)
        other = {"left": "right", "right": "left"}[mark.side]
        facing = _passing(facts, mark.along_m - 0.8, mark.along_m + 0.8, other)
        across = names.best(facing) if names.rng.random() < 0.3 else None
        after = _passing(facts, mark.along_m + 0.6, high - 0.4, after=mark, before=past)
        chained = across is None and names.rng.random() < _CHAINED
        second = names.best(after) if chained else None
        if across is not None:
            event = replace(event, kind="between", Y=across)
        elif second is not None and not second.plural:
            kinds = ["pass_both" if second.mark.side == mark.side else "pass_two", "pass_row"]
            event = replace(
                event, kind=pick(kinds, names.rng), Y=second, t=second.mark.side,
                to_m=second.mark.along_m,
            )  # fmt: skip
            beyond = _passing(facts, event.to_m + 0.6, high - 0.3, after=second.mark, before=past)
            third = names.best(beyond)
            if third is not None and not third.plural:
                event = replace(event, kind="pass_three", Z=third, to_m=third.mark.along_m)
        elif names.rng.random() < 0.7:
            long = mark.noun.split()[-1] in _LONG_THINGS and mark.size_m >= _LONG_THING_M
            long = long and mark.distance_m <= _CLOSE_M
            event = replace(event, kind="pass_along" if long else "pass_side")
        result.append(event)
    return result


def _passing(
    facts: PathFacts,
    low_m: float,
    high_m: float,
    side: str = "",
    after: LandmarkFact | None = None,
    before: LandmarkFact | None = None,
) -> Callable[[LandmarkFact], float | None]:
    """Return how far a thing is that is passed on a side, after and before others [m], else None.

    Who walks by two things side by side passes the one first whose middle he leaves behind first.
    """
    from_m = abeam_m(after) + _APART_M if after else -np.inf
    to_m = abeam_m(before) - _APART_M if before else np.inf

    def far(mark: LandmarkFact) -> float | None:
        here = passed(mark, facts, low_m, high_m) and side in ("", mark.side)
        return mark.distance_m if here and from_m <= abeam_m(mark) <= to_m else None

    return far


def _view(facts: PathFacts, names: Names, along_m: float) -> list[Event]:
    """Return two things in view ahead, if there are two."""

    def ahead(mark: LandmarkFact) -> float | None:
        return in_view(mark, facts, along_m, 30.0, _VIEW_M)

    one = names.best(ahead)
    other = names.some(lambda m: in_sight(m, facts, along_m)) if one else None
    return [Event("view", along_m, X=one, Y=other)] if other else []


def _passed_door(facts: PathFacts, names: Names, low_m: float, high_m: float) -> list[Event]:
    """Return a doorway that is passed, if only one of the room leads where it leads."""
    entered = {v.room for v in facts.visits}
    for mark in facts.landmarks:
        visit = next((v for v in facts.visits if mark.along_m <= v.to_m), facts.visits[-1])
        others = [room for room in mark.leads if room not in entered]
        here = low_m <= mark.along_m <= high_m and mark.side
        here = here and _THROUGH_M < mark.distance_m <= PASS_DOOR_M
        clear = len(others) == 1 and visit.room in mark.leads and mark.name not in names.names
        if mark.noun == DOOR and here and clear and visit.beyond.count(others[0]) == 1:
            names.names.add(mark.name)
            kind = "not_door" if names.rng.random() < _NOT else "pass_door"
            return [Event(kind, mark.along_m, C=names.name(others[0]), s=mark.side)]
    return []


def not_entered(facts: PathFacts, names: Names) -> list[Event]:
    """Return the rooms not to enter where one goes through an opening into one without a name."""
    result = []
    for passage in facts.passages:
        rooms = {
            room
            for mark in facts.landmarks
            if passage.along_m - mark.along_m <= _MEETS_M
            and mark.distance_m <= _THROUGH_M and passage.from_room in mark.leads
            for room in mark.leads
            if mark.along_m <= passage.along_m + _THROUGH_M
        } - {visit.room for visit in facts.visits}  # fmt: skip
        if not passage.to_room and len(rooms) == 1:
            result.append(Event("not_room", passage.along_m + 0.01, C=names.name(rooms.pop())))
    return result


def _end(event: Event) -> float:
    return event.done_m + 0.2


# distances ---------------------------------------------------------------------------------------


def with_distances(
    events: Sequence[Event], stop: Event, facts: PathFacts, names: Names, taste: Taste
) -> list[Event]:
    """Say how far to walk before a turn that nothing announces, or which room to follow."""
    result: list[Event] = []
    before, speaks = 0.0, taste.voice != "terse"
    todo = [*events, stop]
    for k, event in enumerate(todo):
        gap = event.along_m - before
        bare = event.kind in _PLAIN_TURNS
        turn_m = next(e.along_m for e in todo[k:] if not e.kind.startswith(PASSES))
        room = facts.room_at(before + 0.3)
        stays = facts.room_at(max(before, turn_m - 0.5)) == room == "hallway"
        new = not (result and result[-1].kind.startswith((*PASSES, "follow")))
        if speaks and stays and new and turn_m - before > (3.0 if bare else _LONG_M):
            hall = f"{'long ' * (turn_m - before > _LONG_HALL_M)}{names.name(room)}"
            if event.kind in ("enter", "enter_door") and event.B:
                into = replace(event, kind="along_into", B=hall, C=event.B)
                result.append(into)
                before = into.done_m
                continue
            result.append(Event("follow", before + 0.2, B=hall))
        elif (
            bare
            and (event.kind != "slight" or names.rng.random() < taste.paced)
            and gap > (FEW_STEPS_M if speaks else _LONG_M + FEW_STEPS_M)
        ):
            result.append(Event("walk", before, far_m=gap))
        result.append(event)
        before = max(before, _end(event) - 0.2)
    return result[:-1]


def with_neighbours(events: Sequence[Event], names: Names) -> list[Event]:
    """Tell some things by what stands right beside them."""
    result = []
    for event in events:
        thing = event.X if event.kind in _BY_ONE else None
        other = names.beside(thing) if thing and names.rng.random() < _BESIDE else None
        near = other is not None and (
            event.kind not in (*_STOPS_BY_ONE, "goal_thing") or stands_at_goal(other.mark)
        )
        if thing and other and near:
            words = f"{thing.words} {pick(('next to', 'beside', 'by'), names.rng)} {other.words}"
            event = replace(event, X=replace(thing, words=words, beside=other))
        result.append(event)
    return result


def bent(events: Sequence[Event], facts: PathFacts) -> list[Event]:
    """Mark the events that tell a way with a bend, which nobody would call straight."""
    result = []
    for event in events:
        low, high = event.along_m, event.along_m + event.far_m
        if event.kind.startswith("stop"):
            low, high = facts.length_m - event.far_m, facts.length_m
        elif event.kind == "onward":  # from door to door, with the turns at both
            low, high = low - 2 * _AT_END_M, event.to_m + 2 * _AT_END_M
        within = (low + _AT_END_M < turn.along_m < high - _AT_END_M for turn in facts.turns)
        result.append(replace(event, bent=any(within)))
    return result
