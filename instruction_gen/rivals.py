"""Where else a text leads a stranger who starts where its path does."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from ..formats.core.episode import Episode
from ..formats.core.frames import wrap_angle
from ..formats.core.geometry import arc_length, path_length, point_along, resample
from ..wayfinding.crossings import crossings_to_the_ends
from .checker import Ground
from .checker.order import Alignment
from .checker.said import goal_last
from .checker.things import room_names
from .facts import LevelFacts, path_facts
from .facts.doors import DOOR, OPENING
from .facts.elsewhere import Elsewhere
from .facts.geometry import Array
from .facts.records import PathFacts
from .language.claims import Claim, Step
from .language.nouns import called

ELSEWHERE_M, _OTHER_ROOM_M = 3.0, 1.5  # who stops so far from the goal, or in another room, is lost
_LIKELY = 0.35  # the cost up to which a stranger takes a text to describe a way
_BY_M = 1.2  # who comes so near to the goal stops there
_LONGER, _LONGER_M = 1.5, 3.0  # nobody goes so many times the way, and so much
_AT_M = 3.5  # a thing that one stops at is this near
_AT_DOOR_M = 1.3  # who goes by a door comes this near to it
_EARLY_M = 1.5  # between the places on the path where one might stop early
_SPACING_M = 0.1  # of the path, of which a part is taken
_SET_OUT_M = 0.3  # who has only a text that names something looks around before he sets out
_SETS_OUT_M, _ASIDE_DEG = 1.5, 15.0  # who is told to walk on walks straight on
# Rooms that only their names tell apart.
_ALIKE = tuple(map(frozenset, (
    ("bedroom", "children's room", "nursery"),
    ("hallway", "entrance hall", "lobby"),
    ("storeroom", "closet room"),
)))  # fmt: skip


class Rivals:
    """Ways to other places from where a path starts, or from the end of its last stairs."""

    def __init__(self, episode: Episode, levels: Sequence[LevelFacts], facts: PathFacts):
        """Remember the path; no way is planned before a text is asked about.

        Args:
            levels: that the path takes, in order.
            facts: of the path.
        """
        self._episode, self._levels, self._facts = episode, tuple(levels), facts
        self._last = self._levels[-1]
        self._path = resample(episode.reference_path_world_m, _SPACING_M)
        self._along_m = arc_length(self._path[:, :2])
        sure_m = max((climb.to_m + 0.1 for climb in facts.climbs), default=0.0)
        self._sure = self._path[: max(1, int(np.searchsorted(self._along_m, sure_m)))]
        self._ways: dict[int, Array | None] = {}
        self._grounds: dict[tuple[int, frozenset[str], bool], Ground] = {}
        self._led: list[int] = []  # where earlier texts led, the last first

    def led_to(self, steps: Sequence[Step]) -> str:
        """Return where else a text leads, "" where it leads to the goal alone."""
        steps = goal_last(steps)
        owners = [k for k, step in enumerate(steps) for _ in step.claims]
        claims = [claim for step in steps for claim in step.claims]
        names = frozenset(c.name for c in claims if c.what == "thing")
        cued, faced = _after_a_thing(claims), _is_told_from_the_start(claims)
        straight = faced and claims[0].kind != "turn" and len(self._sure) < 2
        for number in dict.fromkeys((*self._led, *range(len(self._ends)))):
            if not (self._ends_as(number, claims) and self._comes_by(number, claims)):
                continue
            if cued and self._goes_by_the_door(number):
                continue
            if straight and self._starts_aside(number):
                continue
            ground = self._ground(number, names, faced)
            if Alignment(ground, claims, owners, _LIKELY).cost <= _LIKELY:
                self._led = [number, *(k for k in self._led if k != number)]
                x, y = self._ends[number][0]
                room = ground.facts.goal_room or "room without a name"
                return f"it also leads to another place in the {room}, at ({x:.1f}, {y:.1f}) m"
        return ""

    @cached_property
    def _elsewhere(self) -> Elsewhere:
        return Elsewhere(self._last, self._sure[-1, :2])

    @cached_property
    def _ends(self) -> list[tuple[Array, int, int]]:
        """Where the ways end (2,) [m] and in which region, and which of `_elsewhere` they are.

        Those that stop early on the path are −1. The nearest to the goal come first.
        """
        goal_m, length_m = self._path[-1, :2], float(self._along_m[-1])
        own = int(self._last.regions.at(goal_m))
        ways = self._elsewhere
        sure_m = float(self._along_m[len(self._sure) - 1])
        ends = [
            (xy_m, int(region), k)
            for k, (xy_m, region, cost_m) in enumerate(
                zip(ways.places_m, ways.regions, ways.costs_m, strict=True)
            )
            if cost_m <= 2.0 * (_LONGER * length_m + _LONGER_M)
        ]
        early = np.arange(length_m - ELSEWHERE_M, sure_m + _EARLY_M, -_EARLY_M)
        for xy_m in point_along(self._path[:, :2], early):
            ends.append((xy_m, int(self._last.regions.at(xy_m)), -1))
        gaps = [float(np.linalg.norm(xy_m - goal_m)) for xy_m, *_ in ends]
        # Who stops in the opening between two rooms is in both.
        here = {self._facts.goal_room, *self._facts.goal_rooms} - {""}
        far = [
            (gap, k) for k, gap in enumerate(gaps)
            if gap > (ELSEWHERE_M if ends[k][1] == own or self._room(ends[k][1]) in here
                      else _OTHER_ROOM_M)
        ]  # fmt: skip
        return [ends[k] for _, k in sorted(far)]

    def _room(self, region: int) -> str:
        return self._last.names[region] if region >= 0 else ""

    def _way(self, number: int) -> Array | None:
        """Return a way (P, 3) [m], None where nobody takes it: by the goal, or far around."""
        if number not in self._ways:
            end_m, _, k = self._ends[number]
            if k < 0:
                gap_m = np.linalg.norm(self._path[:, :2] - end_m, axis=1)
                way = self._path[: int(gap_m.argmin()) + 1]
            else:
                line = self._elsewhere.way(k)
                z_m = np.full((len(line), 1), self._sure[-1, 2])
                way = np.vstack([self._sure[:-1], np.hstack([line, z_m])])
            off_m = np.linalg.norm(way[:, :2] - self._path[-1, :2], axis=1)
            far = path_length(way[:, :2]) > _LONGER * self._along_m[-1] + _LONGER_M
            self._ways[number] = None if far or off_m.min() <= _BY_M or len(way) < 3 else way
        return self._ways[number]

    def _ends_as(self, number: int, claims: Sequence[Claim]) -> bool:
        """Return whether a way ends in the room, and at the thing, of a text."""
        (x, y), region, _ = self._ends[number]
        level, rooms = self._last, list(_entered(claims))
        last = _taken_for(rooms[-1].name, level.names) if rooms else frozenset()
        if self._facts.goal_room in last and self._room(region) not in last:
            return False
        edge = np.clip((x, y), level.low_m, level.high_m) - (x, y)
        near = np.flatnonzero(np.linalg.norm(edge, axis=1) <= _AT_M)
        return all(
            any(_may_be(level.nouns[n], claim.name) for n in near)
            for claim in claims
            if (claim.kind, claim.what) == ("stop", "thing")
        )

    def _comes_by(self, number: int, claims: Sequence[Claim]) -> bool:
        """Return whether a way is taken at all, and comes through the rooms of a text."""
        way = self._way(number)
        if way is None or len(self._levels) > 1:
            return way is not None
        crossed = crossings_to_the_ends(self._last.regions, way)
        if len(crossed) != len(self._facts.doors):
            return False  # no door is passed in silence
        regions = np.unique(self._last.regions.at(way[:, :2]))
        rooms = {self._last.names[k] for k in regions if k >= 0}
        return all(_taken_for(c.name, self._last.names) & rooms for c in _entered(claims))

    def _goes_by_the_door(self, number: int) -> bool:
        """Return whether a way goes on by the last doorway of the path."""
        way, doors = self._way(number), self._facts.doors
        if way is None or not doors:
            return False
        door_m = point_along(self._path[:, :2], doors[-1].along_m)
        gap_m = np.linalg.norm(way[:, :2] - door_m, axis=1)
        other = self._ends[number][1] != int(self._last.regions.at(self._path[-1, :2]))
        return other and bool(gap_m.min() <= _AT_DOOR_M)

    def _starts_aside(self, number: int) -> bool:
        """Return whether a way begins farther aside of who sets out than the path does."""
        way = self._way(number)
        assert way is not None
        return self._aside_deg(way) > self._aside_deg(self._path) + _ASIDE_DEG

    def _aside_deg(self, way: Array) -> float:
        x, y = point_along(way[:, :2], np.array([_SETS_OUT_M]))[0] - way[0, :2]
        return abs(float(np.rad2deg(wrap_angle(np.arctan2(y, x) - self._episode.start_yaw_rad))))

    def _ground(self, number: int, names: frozenset[str], faced: bool) -> Ground:
        """Return the facts of a way, of its things only those that may have some names."""
        key = number, names, faced
        if key not in self._grounds:
            way = self._way(number)
            assert way is not None
            changed = {"reference_path_world_m": way, "goal_position_world_m": way[-1]}
            first, *beyond = (_only(level, names) for level in self._levels)
            facts = path_facts(replace(self._episode, **changed), first, None, beyond)
            turns = tuple(t for t in facts.turns if faced or t.along_m > _SET_OUT_M)
            self._grounds[key] = _Unnamed(replace(facts, turns=turns))
        return self._grounds[key]


class _Unnamed(Ground):
    """The facts of a way to one who cannot read on a door what the room behind it is called."""

    few_m = 3.0

    def rooms(self, name: str) -> frozenset[str]:
        """Return the rooms that a name may be thought to mean."""
        return _taken_for(name, self.facts.level_rooms) | super().rooms(name)


def _entered(claims: Sequence[Claim]) -> Iterator[Claim]:
    """Yield the claims of rooms that the walker comes into."""
    for claim in claims:
        inside = claim.kind in ("enter", "in") or (
            claim.kind == "stop" and claim.place in ("", "at", "inside")
        )
        if inside and claim.what == "room" and claim.name and claim.name != "landing":
            yield claim


def _after_a_thing(claims: Sequence[Claim]) -> bool:
    """Return whether the last door of a text is the next one behind a thing that is passed."""
    doors = [k for k, c in enumerate(claims) if c.kind in ("enter", "door")]
    before = claims[: doors[-1]] if doors else ()
    cue = next((c for c in reversed(before) if c.kind not in ("turn", "see", "door")), None)
    return cue is not None and (cue.kind, cue.what) == ("pass", "thing")


def _is_told_from_the_start(claims: Sequence[Claim]) -> bool:
    """Return whether a text begins with a way that only the heading at the start explains."""
    first = next((c for c in claims if c.kind != "in"), None)
    if first is None:
        return False
    bare = first.kind in ("walk", "turn") or (first.kind, first.what) == ("stop", "")
    return bare or (first.kind in ("enter", "door", "leave") and bool(first.side))


def _taken_for(name: str, level_rooms: Sequence[str]) -> frozenset[str]:
    """Return the rooms that may be meant by a name, or look as if they were."""
    own = frozenset((name,)) & {*level_rooms} or room_names(name)
    return own.union(*(alike for alike in _ALIKE if alike & own))


def _may_be(noun: str, name: str) -> bool:
    return called(noun, name) or called(noun, name.split()[-1])


def _only(level: LevelFacts, names: frozenset[str]) -> LevelFacts:
    """Return a level with its doorways, and of its things those that may have some names."""
    kept = [
        k for k, noun in enumerate(level.nouns)
        if noun in (DOOR, OPENING) or any(_may_be(noun, name) for name in names)
    ]  # fmt: skip

    def some(row: Sequence[Any]) -> tuple[Any, ...]:
        return tuple(row[k] for k in kept)

    return replace(
        level, things=some(level.things), nouns=some(level.nouns), rooms=some(level.rooms),
        leads=some(level.leads), low_m=level.low_m[kept], high_m=level.high_m[kept],
    )  # fmt: skip
