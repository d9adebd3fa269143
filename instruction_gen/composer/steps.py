"""Choose what to mention of a path, before it is put into words."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..facts.records import PathFacts, TurnFact
from .records import TASTES, Step, Taste
from .refer import Reference, passing_candidates, turn_marker
from .stop import entered_room, stop_step

TELL_DEG = 40.0  # smaller turns are mentioned only where nothing else shows the way
CLEAR_DEG = 50.0  # these are mentioned even where the next turn undoes part of them
HINT_DEG = 30.0
_WEAVING_M = 2.0
_LEADS = frozenset(("turn_enter", "enter_turn", "enter", "leave"))  # into another room
_DOOR_AFTER_TURN_M = (-0.3, 1.5)  # a doorway this far behind a turn is one step with it
_TURN_AFTER_DOOR_M = 1.7
_ROUND_DEG = 140.0
_FAR_AHEAD_M = 2.5
_AT_END_M = 0.3  # a turn so close to the end of a way is not on it
_LONG_M = 4.0  # the longest way that a text leaves undescribed


def plan(facts: PathFacts, style: str, rng: np.random.Generator) -> list[Step]:
    """Choose what to mention, in order, the stop last."""
    taste = TASTES[style]
    stop = stop_step(facts, rng, taste)
    named = {mark.name for mark in (stop.mark, stop.other) if mark}
    steps = _moves(facts, rng, taste, named)
    steps = _passed(steps, stop, facts, rng, taste, named)
    steps = _distances(steps, stop, facts)
    first = steps[0] if steps else None
    if style != "terse" and first is not None and first.along_m > _FAR_AHEAD_M:
        # Turning is the first thing mentioned, but not the first thing done.
        turns = first.kind in ("turn_enter", "turn") and first.mark is None and not first.from_room
        steps = [Step("ahead", 0.0), *steps] if turns else steps
    if not steps:
        steps = [Step("walk", 0.0, far_m=facts.length_m)]
    if stop.place == "after":
        rest = facts.length_m - steps[-1].along_m
        if steps[-1].kind == "walk":
            steps, rest = steps[:-1], steps[-1].far_m
            if not steps:
                rest = facts.length_m
        stop = replace(stop, far_m=rest)
    return _bent([*steps, stop], facts)


# moves ------------------------------------------------------------------------------------------


def mentioned_turns(facts: PathFacts) -> list[tuple[int, TurnFact]]:
    """Return the turns worth mentioning; small ones that undo each other are weaving."""
    result = []
    for k, turn in enumerate(facts.turns):
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
            result.append((k, turn))
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


def _moves(facts: PathFacts, rng: np.random.Generator, taste: Taste, named: set[str]) -> list[Step]:
    steps: list[Step] = []
    passages = list(facts.passages)
    turns = mentioned_turns(facts)
    for n, (k, turn) in enumerate(turns):
        low, high = (turn.along_m + gap for gap in _DOOR_AFTER_TURN_M)
        if n + 1 < len(turns):  # the doorway belongs to the turn that is nearer to it
            high = min(high, turns[n + 1][1].along_m)
        after = next((p for p in passages if low <= p.along_m <= high), None)
        size = abs(turn.angle_deg)
        if after is not None and turn.along_m > 0.4 and size < 125:
            passages.remove(after)
            first = after is facts.passages[0] and after.along_m < 4.0
            step = Step(
                "turn_enter", min(turn.along_m, after.along_m), turn.side, size,
                entered_room(after), after.from_room if first else "", after.doorway, covers=(k,),
            )  # fmt: skip
            steps.append(step)
            continue
        before = next(
            (p for p in passages if 0 < turn.along_m - p.along_m <= _TURN_AFTER_DOOR_M), None
        )
        if before is not None:
            passages.remove(before)
            first = before is facts.passages[0] and before.along_m < 4.0
            step = Step(
                "enter_turn", before.along_m, turn.side, size, entered_room(before),
                before.from_room if first else "", before.doorway, covers=(k,),
            )  # fmt: skip
            steps.append(step)
            continue
        mark = None
        if turn.along_m > 0.8 and size < _ROUND_DEG and rng.random() < taste.mark_turns:
            mark = turn_marker(facts, turn, named, rng, taste.colours)
        if mark is not None:
            named.add(mark.name)
        steps.append(Step("turn", turn.along_m, turn.side, size, mark=mark, covers=(k,)))
    for passage in passages:
        first = passage is facts.passages[0] and passage.along_m < 4.0
        kind = "leave" if first and passage.from_room else "enter"
        steps.append(
            Step(
                kind,
                passage.along_m,
                room=entered_room(passage),
                from_room=passage.from_room,
                doorway=passage.doorway,
            )
        )
    return sorted(steps, key=lambda s: s.along_m)


# things passed ----------------------------------------------------------------------------------


def _passed(
    steps: list[Step],
    stop: Step,
    facts: PathFacts,
    rng: np.random.Generator,
    taste: Taste,
    named: set[str],
) -> list[Step]:
    result = list(steps)
    kinds = {m.noun for s in (*steps, stop) for m in (s.mark, s.other) if m}
    edges = [0.0, *(_end(s) for s in steps), facts.length_m]
    starts = [*(s.along_m for s in steps), facts.length_m]
    stretches = sorted(zip(edges, starts, strict=False), key=lambda pair: pair[0] - pair[1])
    used = 0
    for low, high in stretches:
        if high - low < taste.gap_m or used >= taste.most:
            continue
        options = [
            ref
            for ref in passing_candidates(facts, low + 0.5, high - 0.6, rng, taste.colours)
            if ref.name not in named and ref.noun not in kinds
        ]
        if not options:
            continue
        mark = options[0]
        pair = _opposite(mark, options)
        named.add(mark.name)
        kinds.add(mark.noun)
        used += 1
        if pair is not None and rng.random() < 0.6:
            named.add(pair.name)
            kinds.add(pair.noun)
            result.append(Step("between", mark.along_m, mark=mark, other=pair))
            continue
        side = mark.side if rng.random() < taste.sides else ""
        result.append(Step("pass", mark.along_m, side=side, mark=mark))
    return sorted(result, key=lambda s: s.along_m)


def _end(step: Step) -> float:
    return step.along_m + (1.2 if step.kind in ("enter_turn", "turn_enter") else 0.2)


def _opposite(mark: Reference, options: Sequence[Reference]) -> Reference | None:
    for other in options[1:]:
        facing = {mark.side, other.side} == {"left", "right"}
        if facing and abs(other.along_m - mark.along_m) <= 0.8 and other.noun != mark.noun:
            return other
    return None


# distances ---------------------------------------------------------------------------------------


def _distances(steps: list[Step], stop: Step, facts: PathFacts) -> list[Step]:
    """Say how far to walk before a turn that nothing announces, or which room to follow."""
    result: list[Step] = []
    before = 0.0
    for step in steps:
        gap = step.along_m - before
        unmarked = step.mark is None and (
            step.kind == "turn" or (step.kind in _LEADS and not step.room)
        )
        room = _room_at(facts, before + 0.5 * gap)
        beside = step.kind in ("pass", "between", "follow")
        if room == "hallway" and gap > (2.0 if unmarked else _LONG_M) and not beside:
            result.append(Step("follow", before + 0.2, room=room))
        if unmarked and gap > 1.8:
            result.append(Step("walk", before, far_m=gap))
        result.append(step)
        before = max(before, _end(step) - 0.2)
    hall = facts.visits[-1]
    if hall.room == "hallway" and stop.along_m - max(before, hall.from_m) > _LONG_M:
        result.append(Step("follow", before + 0.2, room=hall.room))
    return result


def _bent(steps: Sequence[Step], facts: PathFacts) -> list[Step]:
    """Mark the steps that tell a way with a bend, which nobody would call straight."""
    result = []
    for step, following in zip(steps, [*steps[1:], None], strict=True):
        low, high = step.along_m, step.along_m + step.far_m
        if step.kind == "stop":
            low, high = facts.length_m - step.far_m, facts.length_m
        elif step.kind == "ahead" and following is not None:
            high = following.along_m
        within = (low + _AT_END_M < turn.along_m < high - _AT_END_M for turn in facts.turns)
        result.append(replace(step, bent=any(within)))
    return result


def _room_at(facts: PathFacts, along_m: float) -> str:
    return next((v.room for v in facts.visits if along_m <= v.to_m), "")
