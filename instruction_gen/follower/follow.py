"""Execute a text as sub-goals.

Each clause with a place becomes a leg: go to the door, room or thing it names. Turns told before
a leg must be turns of the way walked on it. Several readings are kept at a time (a beam), because
there may be several chairs; a reading that contradicts the map is given up, and when none is
left, the follower is lost.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..facts.actions import find_turns
from ..language.clauses import Clause, Noun
from ..language.parse import parse
from .world import Array, Field, Thing, World

BEAM = 10
_PER_METRE = 0.12
_UNTOLD = 1.0  # cost of a right angle that is walked but not told
_UNTOLD_RAD = np.deg2rad(50.0)
_TURN_RAD = np.deg2rad(15.0)
_ELSEWHERE = 0.9  # cost of a thing in another room than the walker is in
_NEAR_M = 1.3
_WRONG_SIDE_RAD = np.deg2rad(8.0)
_CANDIDATES = 4
_STRANGE = 0.25  # share of words outside of the grammar from which a text means nothing


@dataclass(frozen=True)
class Followed:
    """How following ended.

    Attributes:
        position_m: (2,) where [m].
        lost: why it gave up, "" when it did not.
        legs: how many sub-goals it reached.
    """

    position_m: Array
    lost: str
    legs: int


@dataclass(frozen=True)
class _Reading:
    cell: tuple[int, int]
    heading: float
    cost: float = 0.0
    turns: tuple[tuple[str, str], ...] = ()
    walk_m: float = 0.0
    legs: int = 0


@dataclass(frozen=True)
class _Target:
    cell: tuple[int, int]
    thing: Thing | None = None
    side: str = ""
    cost: float = 0.0


def follow(text: str, world: World, start_m: Array, start_yaw_rad: float) -> Followed:
    """Follow a text from a pose: `start_m` (2,) [m] and heading [rad]."""
    read = parse(text)
    beam = [_Reading(world.cell(np.asarray(start_m, dtype=np.float64)[:2]), start_yaw_rad)]
    stopped = False
    if len(read.strange) > _STRANGE * max(1, read.words):
        return _end(beam, world, "words that make no sentence")
    for clause in read.clauses:
        if clause.negated:
            continue
        if (
            stopped
            and not clause.until
            and clause.verb in ("turn", "move", "enter", "leave", "pass")
        ):
            return _end(beam, world, "told to go on after the stop")
        after = _execute(clause, beam, world)
        if not after:
            return _end(beam, world, f"lost at {text[clause.start : clause.stop].strip()!r}")
        beam = sorted(after, key=lambda r: r.cost)[:BEAM]
        stopped = stopped or clause.verb == "stop"
    if not stopped:
        return _end(beam, world, "never told to stop")
    done = [r for r in (_settle(one, world) for one in beam) if r is not None]
    if not done:
        return _end(beam, world, "a turn that leads nowhere")
    return _end(sorted(done, key=lambda r: r.cost), world, "")


def _end(beam: Sequence[_Reading], world: World, lost: str) -> Followed:
    best = beam[0]
    return Followed(world.centers_m[best.cell], lost, best.legs)


def _execute(clause: Clause, beam: list[_Reading], world: World) -> list[_Reading]:
    if clause.verb == "turn" or clause.side:
        places = ("at", "near", "before", "past", "after", "in", "")
        at = [n for n in clause.nouns if n.prep in places]
        rest = [n for n in clause.nouns if n not in at and n.prep != "from"]
        for noun in at:
            beam = _go(noun, clause, beam, world)
        beam = [replace(r, turns=(*r.turns, (clause.side, clause.degree))) for r in beam]
        for noun in rest:
            beam = _go(noun, clause, beam, world)
        return beam
    if clause.distance_m and not clause.vague:
        beam = [replace(r, walk_m=clause.distance_m) for r in beam]
    for noun in clause.nouns:
        beam = _go(noun, clause, beam, world)
        if not beam:
            return []
    if clause.verb == "stop" and not clause.nouns and clause.distance_m:
        beam = [one for r in beam for one in _march(r, world)]
    return beam


def _go(noun: Noun, clause: Clause, beam: list[_Reading], world: World) -> list[_Reading]:
    """Walk to what a noun phrase names; the same readings when it names no place."""
    result: list[_Reading] = []
    named = False
    for reading in beam:
        targets = _targets(noun, clause, reading, world)
        if targets is None:
            result.append(reading)
            continue
        named = True
        for target in targets:
            walked = _walk(reading, target, world)
            if walked is not None:
                result.append(walked)
    return sorted(result, key=lambda r: r.cost)[: 2 * BEAM] if named else beam


def _targets(noun: Noun, clause: Clause, reading: _Reading, world: World) -> list[_Target] | None:
    if noun.kind == "unknown":
        return []
    field = world.field(reading.cell)
    here = int(world.region[reading.cell])
    looking = clause.verb == "see" or (noun.prep == "with" and clause.verb != "stop")
    stopping = clause.verb == "stop"
    if noun.kind == "object":
        things = world.called(noun.head)
        targets = [t for thing in things for t in _beside(thing, noun.side, field, world, stopping)]
        targets = [
            t if world.region[t.cell] == here else replace(t, cost=t.cost + _ELSEWHERE)
            for t in targets
        ]
        targets.sort(key=lambda t: field.distance_m[t.cell])
        if noun.ordinal:
            inside = [t for t in targets if t.cost < _ELSEWHERE]
            seen = list({id(t.thing): t for t in inside or targets}.values())
            targets = seen[noun.ordinal - 1 : noun.ordinal]
        # What is only in view need not be walked to, but it must exist.
        return None if looking and targets and not noun.side else targets[: 3 * _CANDIDATES]
    entering = noun.prep in ("into", "through", "to") or clause.verb in ("enter", "reach", "stop")
    if noun.kind == "room":
        regions = world.regions_called(noun.head)
        if not regions:
            return []
        if here in regions and noun.prep != "into":
            return None
        if noun.prep == "from" or (clause.verb == "leave" and not noun.prep):
            return [] if here not in regions else None
        return _inside([k for k in regions if k != here], field, world)
    if noun.kind == "door":
        if noun.prep in ("through", "from") or clause.verb in ("move", "turn", "enter", "leave"):
            doors = [t for d in world.called("door") for t in _beyond(d, noun.side, field, world)]
            return sorted(doors, key=lambda t: field.distance_m[t.cell])[:_CANDIDATES]
        return None
    if noun.head in ("room", "rooms") and entering:
        others = [k for k in range(len(world.rooms)) if k != here]
        return _inside(others, field, world)
    return None


def _beside(thing: Thing, side: str, field: Field, world: World, stopping: bool) -> list[_Target]:
    gap = world.gap_m(thing)
    near = (gap <= max(_NEAR_M, float(gap[world.free].min()) + 0.25)) & world.free
    near &= np.isfinite(field.distance_m)
    cells = np.argwhere(near)
    if not len(cells):
        return []
    if stopping:
        # The middle of a long thing is nowhere far from where its teller stopped.
        middle = 0.5 * (thing.low_m + thing.high_m)
        off = np.linalg.norm(world.centers_m[near] - middle, axis=1)
        score = off + 0.3 * field.distance_m[near]
        result = [(float(score.min()), cells[int(np.argmin(score))])]
        if side:
            # It may have to be approached from another direction for it to lie on that side.
            to = world.centers_m[near] - middle
            sector = np.floor((np.arctan2(to[:, 1], to[:, 0]) + np.pi) / (np.pi / 4)).astype(int)
            for k in np.unique(sector):
                inside = np.flatnonzero(sector == k)
                best = inside[int(np.argmin(score[inside]))]
                result.append((float(score[best]), cells[best]))
        least = min(cost for cost, _ in result)
        unique = {(int(c[0]), int(c[1])): 0.3 * (cost - least) for cost, c in result}
        return [_Target(cell, thing, side, cost) for cell, cost in unique.items()]
    score = field.distance_m[near] + 0.5 * gap[near]
    first = cells[int(np.argmin(score))]
    # Its middle and its far end, too: a long thing may be met or passed along its whole side.
    far = cells[int(np.argmax(field.distance_m[near] - 2.0 * gap[near]))]
    middle = cells[int(np.argmin(gap[near] + 0.05 * field.distance_m[near]))]
    unique = {(int(c[0]), int(c[1])) for c in (first, middle, far)}
    return [_Target(cell, thing, side) for cell in sorted(unique)]


def _inside(regions: Sequence[int], field: Field, world: World) -> list[_Target]:
    result = []
    for k in regions:
        mask = (world.region == k) & world.free & np.isfinite(field.distance_m)
        if not mask.any():
            continue
        entrance = float(field.distance_m[mask].min())
        # Most of a metre inside.
        cells = np.argwhere(mask & (field.distance_m >= entrance + 0.6))
        cells = cells if len(cells) else np.argwhere(mask)
        nearest = cells[int(np.argmin(field.distance_m[tuple(cells.T)]))]
        result.append(_Target((int(nearest[0]), int(nearest[1]))))
    return sorted(result, key=lambda t: field.distance_m[t.cell])[:_CANDIDATES]


def _beyond(door: Thing, side: str, field: Field, world: World) -> list[_Target]:
    """The place just behind a doorway."""
    gap = world.gap_m(door)
    mask = (gap >= 0.4) & (gap <= 1.0) & world.free & np.isfinite(field.distance_m)
    at_door = (gap <= 0.3) & world.free & np.isfinite(field.distance_m)
    if not mask.any() or not at_door.any():
        return []
    behind = mask & (field.distance_m > float(field.distance_m[at_door].max()) + 0.1)
    if not behind.any():
        return []
    cells = np.argwhere(behind)
    best = cells[int(np.argmin(field.distance_m[behind]))]
    return [_Target((int(best[0]), int(best[1])), door if side else None, side)]


def _walk(reading: _Reading, target: _Target, world: World) -> _Reading | None:
    """A reading after a leg, or None when the leg contradicts what was told."""
    field = world.field(reading.cell)
    length = float(field.distance_m[target.cell])
    if not np.isfinite(length):
        return None
    cost = reading.cost + target.cost + _PER_METRE * length
    if reading.walk_m:
        off = abs(length - reading.walk_m) / max(reading.walk_m, 1.5)
        if off > 1.0:
            return None
        cost += off
    way = world.centers_m[tuple(field.way(target.cell).T)]
    if length < 0.4:
        left = reading.turns
        if target.thing is not None and target.side and not left:
            to = np.clip(way[-1], target.thing.low_m, target.thing.high_m) - way[-1]
            angle = _wrap(np.arctan2(to[1], to[0]) - reading.heading)
            if angle * (1 if target.side == "left" else -1) < -_WRONG_SIDE_RAD:
                return None
        return replace(reading, cell=target.cell, cost=cost, walk_m=0.0, legs=reading.legs + 1)
    turned = _matched(way, reading)
    if turned is None:
        return None
    delta = way[-1] - way[max(0, len(way) - 5)]
    heading = float(np.arctan2(delta[1], delta[0]))
    if target.thing is not None and target.side and not _on_side(way, target):
        return None
    return _Reading(target.cell, heading, cost + turned, (), 0.0, reading.legs + 1)


def _matched(way: Array, reading: _Reading) -> float | None:
    """Cost of a way's turns against those told, in order; None when one told is not there."""
    turns = find_turns(way, reading.heading, _TURN_RAD)
    first = _first_turn(way, reading.heading)
    angles = [t.angle_rad for t in turns]
    if first is not None and (not turns or turns[0].along_m > 0.2):
        angles.insert(0, first)
    best: float | None = None
    told = reading.turns
    if len(told) > len(angles):
        # Two told in a row may be one bend, or the last may come at the very end.
        return None if len(told) - len(angles) > 1 else _loose(told, angles)
    for chosen in itertools.combinations(range(len(angles)), len(told)):
        if not all(_is(told[i], angles[k]) for i, k in enumerate(chosen)):
            continue
        rest = [a for k, a in enumerate(angles) if k not in chosen]
        cost = _UNTOLD * sum(abs(a) / (np.pi / 2) for a in rest if abs(a) > _UNTOLD_RAD)
        best = cost if best is None else min(best, cost)
    return best


def _loose(told: Sequence[tuple[str, str]], angles: Sequence[float]) -> float | None:
    for skip in range(len(told)):
        kept = [t for k, t in enumerate(told) if k != skip]
        if len(kept) == len(angles) and all(map(_is, kept, angles)):
            same = all(t[0] == told[skip][0] for t in told)
            return 0.6 if same or told[skip][1] == "slight" else None
    return None


def _is(told: tuple[str, str], angle: float) -> bool:
    side, degree = told
    if side == "around":
        return abs(angle) > np.deg2rad(115.0)
    if degree == "slight":
        return (angle > 0) == (side == "left") and abs(angle) < np.deg2rad(100.0)
    return (angle > 0) == (side == "left")


def _first_turn(way: Array, heading: float) -> float | None:
    ahead = way[min(len(way) - 1, 6)] - way[0]
    angle = _wrap(np.arctan2(ahead[1], ahead[0]) - heading)
    return float(angle) if abs(angle) > np.deg2rad(40.0) else None


def _on_side(way: Array, target: _Target) -> bool:
    """Whether a thing is on the side told somewhere close to it."""
    thing = target.thing
    if thing is None:
        return True
    sign = 1 if target.side == "left" else -1
    for k in range(max(1, len(way) - 12), len(way)):
        delta = way[k] - way[max(0, k - 4)]
        to = 0.5 * (thing.low_m + thing.high_m) - way[k]
        angle = _wrap(np.arctan2(to[1], to[0]) - np.arctan2(delta[1], delta[0]))
        edge = np.clip(way[k], thing.low_m, thing.high_m) - way[k]
        if np.linalg.norm(edge) <= 2.6 and sign * angle > _WRONG_SIDE_RAD:
            return True
    return False


def _march(reading: _Reading, world: World) -> list[_Reading]:
    """Walk a distance ahead, after the turns told."""
    field = world.field(reading.cell)
    d = reading.walk_m
    heading = reading.heading
    for side, degree in reading.turns:
        angle = {"left": 1.0, "right": -1.0, "around": 2.0}[side]
        heading += angle * np.deg2rad(45.0 if degree == "slight" else 90.0)
    ring = (np.abs(field.distance_m - d) <= max(0.2, 0.12 * d)) & world.free
    cells = np.argwhere(ring)
    if not len(cells):
        return []
    to = world.centers_m[tuple(cells.T)] - world.centers_m[reading.cell]
    off = np.abs(_wrap(np.arctan2(to[:, 1], to[:, 0]) - heading))
    result = []
    for k in np.argsort(off)[:3]:
        if off[k] <= np.deg2rad(75.0 if d > 1.5 else 120.0):
            cell = (int(cells[k][0]), int(cells[k][1]))
            cost = reading.cost + float(off[k])
            result.append(_Reading(cell, heading, cost, (), 0.0, reading.legs + 1))
    return result


def _settle(reading: _Reading, world: World) -> _Reading | None:
    """Carry out what is still pending at the stop: a walk, or a turn on the spot."""
    if reading.walk_m:
        done = _march(reading, world)
        return done[0] if done else None
    return reading


def _wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi
