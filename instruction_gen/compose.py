"""The offline composer: instructions from the path's geometry and the scene's labels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..formats.core.episode import Episode
from ..formats.scene.bundle import SceneBundle
from ..wayfinding.regions import RegionMap, region_map
from . import phrases
from .actions import RoomChange, Route, Turn, route_of
from .landmarks import STOP_M, Sighting, sightings
from .records import Instruction, Mention

OFFLINE = "offline"
_TOGETHER_M = (-0.6, 1.6)  # a doorway this far behind a turn is one step with it
_AT_TURN_M = 1.2  # a landmark this close to a turn marks it


@dataclass(frozen=True)
class _Step:
    """A clause to be: where along the path, its words, its action, the thing it names."""

    along_m: float
    text: str
    action: str
    mention: Mention | None = None


def compose_instruction(
    episode: Episode,
    bundle: SceneBundle,
    rng: np.random.Generator,
    style: str = "detailed",
    regions: RegionMap | None = None,
) -> Instruction:
    """Tell how to follow an episode's reference path.

    Turns, room changes and the place to stop are always told; landmarks passed on the way where
    they help, and distances where there is nothing better to go by.

    Args:
        episode: its path and start are described; its own instruction is not looked at.
        bundle: the scene with its labels; a scene without any works too.
        rng: chooses among phrasings.
        style: `concise` names fewer things than `detailed`.
        regions: rooms of the episode's level, when they are at hand already.
    """
    regions = regions or region_map(bundle, episode.level)
    route = route_of(episode, regions)
    seen = sightings(route.path_xy_m, bundle, episode.level, regions)
    last = _stop_at(route, seen, rng)
    steps = _steps(route, seen, last, rng, style)
    steps.append(last or _stop_after(route, steps, rng))
    return Instruction(
        text=_sentences(steps, rng),
        landmarks=tuple(s.mention for s in steps if s.mention),
        actions=tuple(s.action for s in steps),
        composer=OFFLINE,
        style=style,
    )


def _steps(
    route: Route,
    seen: list[Sighting],
    last: _Step | None,
    rng: np.random.Generator,
    style: str,
) -> list[_Step]:
    """Everything before the stop, in order."""
    steps: list[_Step] = []
    named = {last.mention.name} if last and last.mention else set()
    changes = list(route.changes)
    for turn in route.turns:
        low, high = (turn.along_m + gap for gap in _TOGETHER_M)
        partner = next((c for c in changes if low < c.along_m < high), None)
        if partner is not None and turn.along_m > 0.5:
            changes.remove(partner)
            steps.append(_turn_and_enter(turn, partner, rng))
        else:
            steps.append(_turn(turn, seen, named, rng))
    for k, change in enumerate(changes):
        first = k == 0 and change is route.changes[0]
        steps.append(_change(change, first and bool(change.from_room), rng))
    steps.sort(key=lambda s: s.along_m)
    kinds = {s.mention.category for s in (*steps, last) if s and s.mention}
    steps = _add_passed(steps, route, seen, named, kinds, rng, style)
    steps = _add_distances(steps, rng)
    if last and not steps:
        text = phrases.straight(rng, route.length_m)
        steps.append(_Step(0.0, text, f"walk {route.length_m:.1f} m"))
    return steps


def _turn(turn: Turn, seen: list[Sighting], named: set[str], rng: np.random.Generator) -> _Step:
    words = phrases.turn(rng, turn)
    near = [
        s
        for s in seen
        if s.name not in named and np.hypot(s.along_m - turn.along_m, s.distance_m) <= _AT_TURN_M
    ]
    action = f"turn {turn.direction}"
    if not near or turn.along_m < 0.5 or abs(turn.angle_rad) > np.deg2rad(150):
        return _Step(turn.along_m, words, action)
    mark = max(near, key=lambda s: s.salience)
    named.add(mark.name)
    what = phrases.thing(mark.category, mark.plural)
    inner = mark.side == turn.direction
    text = f"{words} around {what}" if inner else f"{words} at {what}"
    return _Step(turn.along_m, text, action, _mention(mark, "turn", ""))


def _turn_and_enter(turn: Turn, change: RoomChange, rng: np.random.Generator) -> _Step:
    words = phrases.turn(rng, turn)
    through = "through the doorway " if change.doorway else ""
    into = phrases.room(change.to_room, "the next room")
    action = f"turn {turn.direction} into {change.to_room or 'next room'}"
    return _Step(min(turn.along_m, change.along_m), f"{words} {through}into {into}", action)


def _change(change: RoomChange, leaving: bool, rng: np.random.Generator) -> _Step:
    to_room = change.to_room or "next room"
    if not leaving:
        text = phrases.enter(rng, change.to_room, change.doorway)
        return _Step(change.along_m, text, f"enter {to_room}")
    text = phrases.leave(rng, change.from_room, change.to_room, change.doorway)
    return _Step(change.along_m, text, f"leave {change.from_room} into {to_room}")


def _add_passed(
    steps: list[_Step],
    route: Route,
    seen: list[Sighting],
    named: set[str],
    kinds: set[str],
    rng: np.random.Generator,
    style: str,
) -> list[_Step]:
    """Name the most salient thing passed on each stretch between the steps."""
    gap = 2.0 if style == "detailed" else 4.0
    result = list(steps)
    edges = [0.0, *(s.along_m for s in steps), route.length_m]
    for low, high in pairwise(edges):
        if high - low < gap:
            continue
        beside = [
            s
            for s in seen
            if s.name not in named
            and s.category not in kinds
            and s.side
            and low + 0.5 <= s.along_m <= high - 0.5
        ]
        if not beside:
            continue
        mark = max(beside, key=lambda s: s.salience / (0.5 + s.distance_m))
        named.add(mark.name)
        kinds.add(mark.category)
        side = mark.side if style == "detailed" or rng.random() < 0.4 else ""
        text = phrases.passing(rng, phrases.thing(mark.category, mark.plural), side)
        action = f"pass {mark.category}"
        result.append(_Step(mark.along_m, text, action, _mention(mark, "pass", side)))
    return sorted(result, key=lambda s: s.along_m)


def _add_distances(steps: list[_Step], rng: np.random.Generator) -> list[_Step]:
    """Say how far to walk before a turn or a doorway that nothing else announces."""
    result: list[_Step] = []
    before = 0.0
    for step in steps:
        far = step.along_m - before
        # Doors are seen from afar, a corner in the open is not.
        alone = 1.5 if step.action in ("turn left", "turn right") else 5.0
        if step.mention is None and far > alone:
            result.append(_Step(before, phrases.straight(rng, far), f"walk {far:.1f} m"))
        result.append(step)
        before = step.along_m
    return result


def _stop_at(route: Route, seen: list[Sighting], rng: np.random.Generator) -> _Step | None:
    """The thing to stop at, if one is near the goal."""
    near = [s for s in seen if s.goal_distance_m <= STOP_M]
    if not near:
        return None
    mark = max(near, key=lambda s: s.salience / (0.4 + s.goal_distance_m))
    what = phrases.thing(mark.category, mark.plural)
    if abs(mark.goal_bearing_rad) < np.deg2rad(35):
        where = phrases.pick(rng, [f"in front of {what}", f"just before you reach {what}"])
    elif mark.goal_distance_m <= 1.0:
        where = phrases.pick(rng, [f"next to {what}", f"beside {what}", f"by {what}"])
    else:
        where = phrases.pick(rng, [f"near {what}", f"close to {what}"])
    mention = replace(_mention(mark, "stop", ""), along_m=route.length_m)
    return _Step(route.length_m, phrases.stop(rng, where), f"stop at {mark.category}", mention)


def _stop_after(route: Route, steps: list[_Step], rng: np.random.Generator) -> _Step:
    """Where to stop when nothing stands there: just inside a room, else after a distance."""
    rest = route.length_m - (steps[-1].along_m if steps else 0.0)
    entered = bool(route.changes) and route.length_m - route.changes[-1].along_m < 1.8
    if entered:
        just_said = bool(steps) and steps[-1].action.endswith(route.goal_room or "next room")
        room = "" if just_said else " " + phrases.room(route.goal_room)
        text = phrases.stop(rng, "just inside" + room)
        return _Step(route.length_m, text, f"stop in {route.goal_room or 'room'}")
    text = phrases.stop_after(rng, rest, first=not steps)
    return _Step(route.length_m, text, f"stop after {rest:.1f} m")


def _mention(mark: Sighting, role: str, side: str) -> Mention:
    return Mention(mark.name, mark.category, role, side, mark.along_m)


def _sentences(steps: list[_Step], rng: np.random.Generator) -> str:
    """Join clauses into sentences of one to three."""
    clauses = [s.text for s in steps]
    # One cannot "continue" before having begun.
    for word, instead in (("continue", "walk"), ("keep going", "walk")):
        clauses[0] = clauses[0].replace(word, instead, 1)
    result = []
    while clauses:
        size = int(rng.integers(1, 4)) if len(clauses) > 3 else min(len(clauses), 3)
        if len(clauses) - size == 0 and len(clauses) > 2:
            size = len(clauses) - 1 if rng.random() < 0.5 else len(clauses)
        part, clauses = clauses[:size], clauses[size:]
        double = any(" and " in clause for clause in part)
        joint = ", then " if double else phrases.pick(rng, [" and ", ", then ", " and then "])
        text = ", ".join(part[:-1]) + joint + part[-1] if len(part) > 1 else part[0]
        if result and len(part) == 1 and "then" not in text and rng.random() < 0.4:
            text = "then " + text
        result.append(text[0].upper() + text[1:] + ".")
    return " ".join(result)
