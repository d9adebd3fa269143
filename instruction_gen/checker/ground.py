"""Where along a path something is true: things, rooms and doors as masks over places."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..facts.doors import DOOR
from ..facts.geometry import MOMENT_M
from ..facts.records import LandmarkFact, PassageFact, PathFacts
from ..language.claims import Claim
from ..language.lexicon import COLOUR_NEIGHBOURS, INNATE_COLOURS, OBJECT_PHRASES, ROOM_PHRASES
from ..language.nouns import called, room_answers

Mask = NDArray[np.bool_]
Place = tuple[Mask, str]  # where it holds, and why it holds nowhere

PASS_M, REACH_M, BESIDE_M, SEE_M = 3.0, 2.4, 3.6, 8.0
_TOUCH_M = 0.8  # a thing this near is at hand whatever stands between
_DOOR_M = 0.9  # around the middle of a passage
_VISIBLE_PIXELS = 12
_SIDE_DEG = (8.0, 172.0)
_CLEAR_SIDE_DEG = 25.0
_DOOR_SIDE_DEG = 10.0
_THROUGH_M = 0.4


class Ground:
    """The facts of one path over S places, a quarter of a metre apart."""

    def __init__(self, facts: PathFacts):
        """Spread the landmarks' moments over the path."""
        self.facts = facts
        self.length_m = facts.length_m
        samples = max(2, round(facts.length_m / MOMENT_M) + 1)
        self.along_m: NDArray[np.float64] = np.linspace(0.0, facts.length_m, samples).astype(float)
        shape = (len(facts.landmarks), samples)
        self.distance, self.bearing = np.full(shape, np.inf), np.zeros(shape)
        self.facing = np.full(shape, 180.0)
        self.open, self.seen = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
        for n, mark in enumerate(facts.landmarks):
            for m in mark.moments:
                k = min(max(round(m.along_m / self.along_m[1]), 0), samples - 1)
                self.distance[n, k], self.bearing[n, k] = m.distance_m, m.bearing_deg
                self.facing[n, k], self.open[n, k] = m.facing_deg, m.open
                self.seen[n, k] = m.open or m.pixels >= _VISIBLE_PIXELS
        self._near_m = np.where(self.open | (self.distance <= _TOUCH_M), self.distance, np.inf)

    def between(self, low_m: float, high_m: float) -> Mask:
        """Return the places between two distances along the path."""
        return (self.along_m >= low_m - 0.13) & (self.along_m <= high_m + 0.13)

    # things -----------------------------------------------------------------------------------

    def passed(self, claim: Claim) -> Place:
        """Return where a thing is beside the walker."""
        abeam = (np.abs(self.bearing) >= 35.0) & (np.abs(self.bearing) <= 145.0)
        abeam |= self.distance <= 0.3  # a rug that is walked over
        ahead = (self._near_m <= BESIDE_M) & (np.abs(self.bearing) < 60.0)
        near = (self._near_m <= PASS_M) & abeam
        if claim.side:  # on that side where it is nearest, or ahead where it is never abeam
            near &= self._nearest()
            never = ~near.any(axis=1, keepdims=True)
            near |= ahead & never
        return self._where(claim, near, "is not beside the path")

    def _nearest(self) -> Mask:
        """Return (N, S) where things are about as near as they get within 2 m of walking."""
        window = max(1, round(2.0 / self.along_m[1]))
        padded = np.pad(self._near_m, ((0, 0), (window, window)), constant_values=np.inf)
        views = np.lib.stride_tricks.sliding_window_view(padded, 2 * window + 1, axis=1)
        return self._near_m <= views.min(axis=2) + 0.5

    def seen_at(self, claim: Claim) -> Place:
        """Return where a thing is in view; one on a side is nearby."""
        reach = BESIDE_M if claim.side else SEE_M
        mask = self.seen & (self.distance <= reach) & (np.abs(self.bearing) <= 125.0)
        return self._where(claim, mask | (self._near_m <= PASS_M), "is never in view")

    def reached(self, claim: Claim) -> Place:
        """Return where a thing is at hand, or close ahead."""
        ahead = (self._near_m <= BESIDE_M) & (np.abs(self.bearing) <= 60.0)
        return self._where(claim, (self._near_m <= REACH_M) | ahead, "is not reached")

    def stopped_at(self, claim: Claim) -> str:
        """Return why the path does not stop at a thing, "" where it does."""
        last = np.zeros_like(self.open)
        reach = {"before": 3.2, "past": 3.2, "between": 2.8}.get(claim.place, REACH_M)
        reach = max(reach, 3.2) if claim.side else reach
        last[:, -2:] = self._near_m[:, -2:] <= reach
        if claim.place == "past":
            last[:, -1] &= np.abs(self.bearing[:, -1]) >= 40.0
            last[:, -2] = False
        return self._where(claim, last, "is not at the end of the path")[1]

    def abeam_m(self, claim: Claim) -> float | None:
        """Return where a thing is passed [m]; None if several may be meant."""
        near = [n for n in self._meant(claim) if (self._near_m[n] <= PASS_M).any()]
        if len(near) != 1:
            return None
        across = np.abs(np.abs(self.facing[near[0]]) - 90.0) / 15.0 + self._near_m[near[0]]
        return float(self.along_m[np.argmin(across)])

    def _where(self, claim: Claim, mask: Mask, fault: str) -> Place:
        """Restrict a mask (N, S) to the things that a claim may mean."""
        nothing = np.zeros(len(self.along_m), dtype=bool)
        name = claim.name or "doorway"
        chosen = self._meant(claim)
        if not chosen:
            known = any(called(n, name) for n in self.facts.level_nouns)
            return nothing, f"there is no {name} {'on the route' if known else 'in this scene'}"
        for kind, value in (("material", claim.material), ("colour", claim.colour)):
            # What neither label nor picture says of any of them cannot be checked.
            looks = [self._looks(n, kind) for n in chosen]
            if value and any(looks):
                chosen = [n for n, own in zip(chosen, looks, strict=True) if value in own]
            if not chosen:
                return nothing, f"nothing says that the {name} is {value}"
        here = mask[chosen]
        if not here.any():
            return nothing, f"the {name} {fault}"
        if claim.side in ("left", "right", "ahead", "behind"):
            here = here & self._sided(chosen, claim.side, here)
            if not here.any():
                return nothing, f"the {name} is not {_spoken(claim.side)}"
        if claim.ordinal:
            here = here & self._ordinal(chosen, claim)[:, None]
            if not here.any():
                return nothing, f"that is not {name} number {claim.ordinal}"
        result = np.asarray(here.any(axis=0))
        if claim.count > 1:
            result = result & self._counted(chosen, claim.count)
            if not result.any():
                return nothing, f"there are not {claim.count} of them ({name})"
        return result, ""

    def _meant(self, claim: Claim) -> list[int]:
        """Return the things that a claim may mean, by name and room."""
        marks = list(enumerate(self.facts.landmarks))
        if claim.what == "door":
            doors = [n for n, m in marks if m.noun == DOOR]
            names = room_names(claim.room)
            return [n for n in doors if not names or self._leads_to(n, names)]
        found = [n for n, m in marks if called(m.noun, claim.name)]
        head, _, kind = claim.name.rpartition(" ")
        if not found and head and room_names(head):
            found = [n for n, m in marks if called(m.noun, kind) and m.room in room_names(head)]
        if not found and head and head in OBJECT_PHRASES:
            present = any(called(m.noun, head) for _, m in marks)
            found = [n for n, m in marks if called(m.noun, kind)] if present else []
        if claim.room:
            return [n for n in found if self.facts.landmarks[n].room in room_names(claim.room)]
        return found

    def _leads_to(self, n: int, names: frozenset[str]) -> bool:
        """Return whether a doorway leads to or from a room."""
        door = self.facts.landmarks[n]
        if door.room in names:
            return True
        for p in self.facts.passages:
            k = int(np.argmin(np.abs(self.along_m - p.along_m)))
            if self.distance[n, max(k - 1, 0) : k + 2].min() <= _THROUGH_M:
                return bool({p.from_room, p.to_room} & names)
        near_goal = door.goal_distance_m <= 2.6
        if near_goal and names & {*self.facts.goal_rooms, *self.facts.goal_near_rooms}:
            return True
        if door.distance_m <= 1.2 and door.along_m <= 1.0 and names & set(self.facts.start_rooms):
            return True
        # A door that is only passed: to which of the rooms behind it leads is not in the facts.
        visit = next((v for v in self.facts.visits if v.to_m >= door.along_m - 0.3), None)
        return not near_goal and visit is not None and bool(names & set(visit.beyond))

    def _looks(self, n: int, kind: str) -> set[str]:
        mark = self.facts.landmarks[n]
        if kind == "material":
            return {mark.material} - {""}
        own = {mark.colour, INNATE_COLOURS.get(mark.noun, "")} - {""}
        return own | {near for colour in own for near in COLOUR_NEIGHBOURS.get(colour, ())}

    def _sided(self, chosen: list[int], side: str, where: Mask | None = None) -> Mask:
        """Return (N, S) where things are on a side; ahead of the walker is on neither.

        Unless they are never clearly on one at the places `where` (N, S).
        """
        bearing, facing = self.bearing[chosen], self.facing[chosen]
        if side == "ahead":
            return np.minimum(np.abs(facing), np.abs(bearing)) <= 50.0
        if side == "behind":
            return np.maximum(np.abs(facing), np.abs(bearing)) >= 75.0
        sign = 1 if side == "left" else -1
        low, high = _SIDE_DEG
        beside = (sign * bearing > low) & (sign * bearing < high)
        loose = beside | ((sign * facing > low) & (sign * facing < high) & (np.abs(bearing) <= low))
        if where is None:
            return loose
        clear = where & (np.abs(bearing) >= _CLEAR_SIDE_DEG) & (np.abs(bearing) <= 155.0)
        some = np.asarray(clear.any(axis=1, keepdims=True))
        return np.where(some, loose & clear, loose)

    def _ordinal(self, chosen: list[int], claim: Claim) -> Mask:
        """Return which things have an ordinal, counted from the start, in a room, or on a side."""
        near = [n for n in chosen if (self._near_m[n] <= BESIDE_M).any()]
        near.sort(key=lambda n: self.facts.landmarks[n].along_m)
        rows = [near]
        if claim.side in ("left", "right"):
            on_side = self._sided(near, claim.side) & (self._near_m[near] <= BESIDE_M)
            rows.append([n for n, row in zip(near, on_side, strict=True) if row.any()])
        for visit in self.facts.visits:
            for first_m in (visit.from_m - 0.3, visit.from_m + 0.5):
                rows += [
                    [
                        n
                        for n in row
                        if first_m <= self.facts.landmarks[n].along_m <= visit.to_m + 0.5
                    ]
                    for row in rows[:2]
                ]
        k = claim.ordinal - 1 if claim.ordinal > 0 else -1
        right = {row[k] for row in rows if (k == -1 and row) or 0 <= k < len(row)}
        return np.array([n in right for n in chosen], dtype=bool)

    def _counted(self, chosen: list[int], number: int) -> Mask:
        def around(reach_m: float) -> NDArray[np.int64]:
            rows = self._near_m[chosen] <= reach_m
            return np.sum([spread(row, self.along_m, 1.5) for row in rows], axis=0)

        return (around(1.2) <= number) & (number <= around(4.5))

    # rooms ------------------------------------------------------------------------------------

    def entered(self, claim: Claim) -> Place:
        """Return where a room is entered, on the side said; any room without a name."""
        return self._crossed(claim, lambda p: p.to_room, self.facts.goal_rooms, "is not entered")

    def left(self, claim: Claim) -> Place:
        """Return where a room is left."""
        return self._crossed(claim, lambda p: p.from_room, (), "is not left")

    def through_door(self, claim: Claim) -> Place:
        """Return where the path goes through a doorway with the side, room and number said."""
        names = room_names(claim.room)
        mask = np.zeros(len(self.along_m), dtype=bool)
        rooms = [p for p in self.facts.passages if not names or names & {p.from_room, p.to_room}]
        if claim.room and not rooms and not names & set(self.facts.goal_rooms):
            return mask, f"the path does not go through the door of the {claim.room}"
        sided = [p for p in rooms if claim.side not in ("left", "right")
                 or self.door_side(p, claim.side)]  # fmt: skip
        ends = self.facts.goal_rooms and (not names or names & set(self.facts.goal_rooms))
        if not sided and not ends and (rooms or claim.side):
            return mask, f"no doorway on the path is {_spoken(claim.side)}"
        for p in sided:
            mask |= self.between(p.along_m - _DOOR_M, p.along_m + _DOOR_M)
        doors = self._meant(Claim("door", "door"))
        if not claim.side and not names:  # inside of what the map calls one room
            mask |= (self.distance[doors] <= 0.5).any(axis=0) if doors else False
        if ends:
            mask |= self.between(self.length_m - 1.0, self.length_m)
        if claim.ordinal and mask.any():
            keep = self._ordinal(doors, claim) if doors else np.zeros(0, dtype=bool)
            near = [self.distance[n] <= _DOOR_M for n, k in zip(doors, keep, strict=True) if k]
            mask &= np.any(near, axis=0) if near else False
            if not mask.any():
                return mask, f"that is not doorway number {claim.ordinal}"
        return mask, "" if mask.any() else "the path goes through no doorway"

    def _crossed(self, claim: Claim, room, ends: Sequence[str], fault: str) -> Place:
        names = room_names(claim.name)
        mask = np.zeros(len(self.along_m), dtype=bool)
        found = [p for p in self.facts.passages if not claim.name or room(p) in names]
        if claim.side in ("left", "right"):
            sided = [p for p in found if self.door_side(p, claim.side)]
            if found and not sided:
                return mask, f"the {claim.name or 'doorway'} is not {_spoken(claim.side)}"
            found = sided
        for p in found:
            mask |= self.between(p.along_m - _DOOR_M, p.along_m + _DOOR_M)
        if names & set(ends) or (ends and not claim.name):
            mask |= self.between(self.length_m - 1.2, self.length_m)
        if self.facts.start_rooms and claim.name:
            # Who starts on a threshold leaves one room and comes into the other.
            here = {*self.facts.start_rooms, self.facts.visits[0].room}
            if names & here:
                mask |= self.between(0.0, 1.5)
        return mask, "" if mask.any() else f"the {claim.name or 'room'} {fault}"

    def inside(self, claim: Claim) -> Place:
        """Return where the walker is in a room."""
        names = room_names(claim.name)
        mask = np.zeros(len(self.along_m), dtype=bool)
        for v in self.facts.visits:
            if v.room in names or not claim.name:
                mask |= self.between(v.from_m - 0.5, v.to_m + 0.5)
        if names & set(self.facts.start_rooms):
            mask |= self.between(0.0, 0.8)
        if names & set(self.facts.goal_rooms):
            mask |= self.between(self.length_m - 1.0, self.length_m)
        return mask, "" if mask.any() else f"the path does not visit the {claim.name}"

    def room_in_view(self, claim: Claim) -> Place:
        """Return where a room may be seen, on the side said."""
        names = room_names(claim.name)
        everywhere = np.ones(len(self.along_m), dtype=bool)
        if not names & {*self.facts.level_rooms, *(v.room for v in self.facts.visits)}:
            return ~everywhere, f"there is no {claim.name}"
        if claim.side not in ("left", "right"):
            return everywhere, ""
        inside = [n for n, m in enumerate(self.facts.landmarks) if m.room in names]
        near = self._sided(inside, claim.side) & (self.distance[inside] <= 8.0)
        mask: Mask = np.asarray(near.any(axis=0))
        for p in self.facts.passages:
            if p.to_room in names and self.door_side(p, claim.side):
                mask = mask | self.between(p.along_m - 4.0, p.along_m + 0.5)
            elif p.to_room in names:
                mask = mask & ~self.between(p.along_m - 4.0, p.along_m + 0.5)
        beyond = any(names & set(v.beyond) for v in self.facts.visits)
        if not mask.any() and beyond and not inside:
            return everywhere, ""  # nothing says where its door is
        return mask, "" if mask.any() else f"the {claim.name} is not {_spoken(claim.side)}"

    def room_passed(self, claim: Claim) -> Place:
        """Return where a room lies beside the path, entered or not."""
        names = room_names(claim.name)
        mask, _ = self.inside(claim)
        for v in self.facts.visits:
            if names & set(v.beyond):
                mask = mask | self.between(v.from_m, v.to_m)
        if not mask.any():
            return mask, f"the path does not come by the {claim.name}"
        if claim.side not in ("left", "right"):
            return mask, ""
        seen, fault = self.room_in_view(claim)
        return mask & seen, fault

    def stopped_in(self, claim: Claim) -> str:
        """Return why the path does not stop in, outside or in the doorway of a room."""
        facts, names = self.facts, room_names(claim.name)
        near = {*facts.goal_rooms, *facts.goal_near_rooms}
        entered_m = self.length_m - facts.visits[-1].from_m
        if claim.place in ("outside", "before", "at", "past") and names & near:
            return ""
        if claim.place in ("outside", "before") and facts.goal_room in names:
            return "" if 0 < entered_m <= 0.6 else f"the path ends inside the {claim.name}"
        if claim.place not in ("outside", "before") and names & {
            facts.goal_room,
            *facts.goal_rooms,
        }:
            return ""
        return f"the path does not end {claim.place or 'in'} the {claim.name}"

    def stopped_at_door(self, claim: Claim) -> str:
        """Return why the path does not stop at or in a doorway."""
        facts, names = self.facts, room_names(claim.room)
        reach = 1.3 if claim.place == "doorway" else 2.2
        doors = [m for m in facts.landmarks if m.noun == DOOR and m.goal_distance_m <= reach]
        last = facts.passages[-1] if facts.passages else None
        since = self.length_m - last.along_m if last else np.inf
        if not doors and since > reach:
            return "no doorway is at the end of the path"
        rooms = {*facts.goal_rooms, *facts.goal_near_rooms}
        if last and since <= reach:
            rooms |= {last.from_room, last.to_room}
        if claim.room and not names & rooms:
            inside = facts.goal_room in names and facts.visits[-1].exits <= 1
            if not (inside and doors):
                return f"the doorway at the end of the path is not that of the {claim.room}"
        if claim.side in ("left", "right", "ahead", "behind") and doors:
            return self.stopped_at(Claim("stop", "door", side=claim.side))
        return ""

    def door_side(self, passage: PassageFact, side: str) -> bool:
        """Return whether a doorway that is walked through may be said to be on a side."""
        sign = 1 if side == "left" else -1
        near = [t for t in self.facts.turns if -2.2 <= t.along_m - passage.along_m <= 2.0]
        if any(sign * t.angle_deg >= 20.0 for t in near) or sign * passage.bearing_deg > 12.0:
            return True
        if any(sign * t.angle_deg <= -28.0 for t in near) or sign * passage.bearing_deg < -18.0:
            return False
        k = int(np.argmin(np.abs(self.along_m - passage.along_m)))
        before = slice(max(0, k - 18), max(1, k - 1))
        for n in self._meant(Claim("door", "door")):
            if self.distance[n, max(k - 1, 0) : k + 2].min() <= _THROUGH_M:
                seen = self.open[n, before] & (self.distance[n, before] > 0.5)
                return bool((seen & (sign * self.facing[n, before] > _DOOR_SIDE_DEG)).any())
        return False


def spread(mask: Mask, along_m: NDArray[np.float64], by_m: float) -> Mask:
    """Return the places within `by_m` of those in `mask`."""
    k = max(1, round(by_m / along_m[1]))
    return np.convolve(mask, np.ones(2 * k + 1), mode="same")[: len(mask)] > 0.5


def room_names(name: str) -> frozenset[str]:
    """Return the canonical rooms that a phrase may mean."""
    return frozenset(r for r in ROOM_PHRASES.get(name, ()) if name in room_answers(r))


def answers_to(mark: LandmarkFact, name: str) -> bool:
    """Return whether a landmark may be called by a phrase."""
    return called(mark.noun, name)


def _spoken(side: str) -> str:
    return {"ahead": "ahead", "behind": "behind the walker"}.get(side, f"on the {side}")
