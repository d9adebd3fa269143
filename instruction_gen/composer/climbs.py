"""Choose how to say that a path takes stairs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..facts.records import PathFacts
from .grammar import pick
from .moves import CLEAR_DEG, Move
from .names import Names
from .records import Event, Taste

_ASIDE_DEG = 20.0  # stairs that one comes to by a turn are on its side from so far aside on
_ONE_BREATH = 0.8
_WITH_END = {"climb": "climb_top", "climb_turn": "climb_turn_top", "climb_side": "climb_side_top"}
_OFF_M = 1.2  # a turn so shortly behind stairs is made at their end


def climb_event(move: Move, gap_m: float, facts: PathFacts, names: Names, taste: Taste) -> Event:
    """Return the event of a move over stairs, `gap_m` behind the last."""
    climb, turn, rng = move.climb, move.turn, names.rng
    assert climb is not None
    event = Event("climb", move.along_m, w=climb.way, to_m=climb.to_m)
    side = turn.side if turn and abs(turn.angle_deg) >= CLEAR_DEG else ""
    bends = {t.side for t in facts.turns if climb.holds(t.along_m)}
    kinds = ["climb", "climb_storey"] if not side else ["climb_turn"] * 2
    aside = "left" if climb.bearing_deg > _ASIDE_DEG else "right"
    if side == aside and abs(climb.bearing_deg) > _ASIDE_DEG:
        kinds += ["climb_side"] * 2
    if climb.landings_m and len(bends) == 1 and taste.voice != "terse":
        kinds += ["climb_landing"] * len(kinds)
    kind = pick(kinds, rng)
    if kind == "climb_landing":
        kind = "climb_turn_landing" if side else kind
    return replace(event, kind=kind, s=side, t=next(iter(bends), ""))


def with_end(events: Sequence[Event], rng: np.random.Generator) -> list[Event]:
    """Tell most climbs in one breath with the turn at their end."""
    result: list[Event] = []
    for event in events:
        before = result[-1] if result else event
        if event.kind == "stairs_turn" and before.kind in _WITH_END and rng.random() < _ONE_BREATH:
            result[-1] = replace(before, kind=_WITH_END[before.kind], t=event.s, to_m=event.done_m)
        else:
            result.append(event)
    return result


def off_stairs(event: Event, facts: PathFacts) -> Event:
    """Return a turn right behind stairs as one at their end."""
    for climb in facts.climbs:
        near = 0.0 <= event.along_m - climb.to_m <= _OFF_M
        if near and event.kind in ("turn", "again", "slight", "sharp", "turn_at", "turn_by"):
            return Event("stairs_turn", event.along_m, s=event.s, w=climb.way)
    return event
