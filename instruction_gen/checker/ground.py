"""Where along a path rooms and doors are entered, left, passed, seen, or stopped at."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from ..facts.doors import DOOR, OPENING
from ..facts.records import PassageFact
from ..language.claims import Claim
from .things import BESIDE_M, PASS_M, THROUGH_M, Mask, Place, Things, spoken_side

_DOOR_M = 0.75  # around the middle of a passage
_DOOR_SIDE_DEG, _BEND_DEG, _AHEAD_DEG = 10.0, 35.0, 48.0
_AT_ONCE_M = 1.5  # a turn so far behind a door is made before doorways are counted
_DOOR_NEAR_M, _SEEN_IN_M = 3.0, 5.0  # a door, and a thing in a room, that show where the room is


class Ground(Things):
    """The facts of one path over S places, a quarter of a metre apart."""

    def entered(self, claim: Claim) -> Place:
        """Return where a room is entered, on the side said; any room without a name."""
        return self._crossed(claim, lambda p: p.to_room, self._ends(), "is not entered")

    def left(self, claim: Claim) -> Place:
        """Return where a room is left."""
        return self._crossed(claim, lambda p: p.from_room, frozenset(), "is not left")

    def through_door(self, claim: Claim) -> Place:
        """Return where the path goes through a doorway with the side, room and number said."""
        names = self.rooms(claim.room)
        mask = np.zeros(len(self.along_m), dtype=bool)
        doors = [p for p in self.facts.passages if p.doorway or claim.name]
        rooms = [p for p in doors if not names or names & {p.from_room, p.to_room}]
        if claim.room and not rooms and not names & self._ends():
            return mask, f"the path does not go through the door of the {claim.room}"
        sided = [p for p in rooms if not claim.side or self.door_side(p, claim.side)]
        ends = self._ends() and (not names or bool(names & self._ends()))
        if not sided and not ends and (rooms or claim.side):
            return mask, f"no doorway on the path is {spoken_side(claim.side)}"
        for p in sided:
            mask |= self.between(p.along_m - _DOOR_M, p.along_m + _DOOR_M)
        doors = self.meant(Claim("door", "door"))
        if not claim.side and not names:  # inside of what the map calls one room
            mask |= (self.distance[doors] <= 0.5).any(axis=0) if doors else False
        if ends:
            mask |= self.between(self.length_m - 1.0, self.length_m)
        if claim.ordinal and mask.any():
            at_m = [p.along_m for p in sided if claim.ordinal in self._door_numbers(p, claim.side)]
            last_m = self.facts.visits[-1].from_m
            row = [m for n, m in enumerate(self.facts.landmarks) if n in doors
                   and m.along_m > last_m + 0.5 and m.side == claim.side
                   and m.goal_distance_m > 1.0 and m.distance_m <= BESIDE_M]  # fmt: skip
            if ends and claim.ordinal == 1 + len(row):
                at_m.append(self.length_m)
            if not at_m:
                return mask & False, f"that is not doorway number {claim.ordinal}"
            mask = np.any([self.between(m - _DOOR_M, m + _DOOR_M) for m in at_m], axis=0)
        return mask, "" if mask.any() else "the path goes through no doorway"

    def out_of(self, name: str) -> Mask:
        """Return the places where the path leaves a room, or may be on its border."""
        names, last = self.rooms(name), self.facts.visits[-1].room
        mask = self.between(0.0, 1.5)
        for p in self.facts.passages:
            if {p.from_room, p.to_room} & {*names, ""}:
                mask |= self.between(p.along_m - _DOOR_M, p.along_m + _DOOR_M)
        return mask | (self.between(self.length_m - 1.2, self.length_m) if last in names else False)

    def straight_on(self, made: int) -> Mask:
        """Return the places around openings that are ahead once `made` turns are made."""
        later = self.facts.turns[made:]
        bends = ((p.along_m, [t.angle_deg for t in later if -1.5 <= t.along_m - p.along_m < 0.1])
                 for p in self.facts.passages)  # fmt: skip
        ahead = [self.between(m - _DOOR_M, m + _DOOR_M) for m, near in bends
                 if abs(sum(near)) < _AHEAD_DEG]  # fmt: skip
        return np.any([self.between(-1.0, -1.0), *ahead], axis=0)

    def next_door_m(self, from_m: float) -> float:
        """Return where the path goes through the next doorway [m]."""
        doors = (p.along_m for p in self.facts.passages if p.doorway and p.along_m > from_m)
        return next(doors, np.inf)

    def next_room_m(self, from_m: float) -> float:
        """Return where the path enters the next room [m]."""
        return next((p.along_m for p in self.facts.passages if p.along_m > from_m), np.inf)

    def _door_numbers(self, passage: PassageFact, side: str) -> set[int]:
        """Return the numbers of a doorway among those of the room that is left, −1 for the last.

        They are counted from where the room is entered, with that doorway or without it.
        """
        visit = self.facts.visits[self.facts.passages.index(passage)]
        row = [n for n in self.meant(Claim("door", "door")) if self.near_m[n].min() <= BESIDE_M]
        if side in ("left", "right"):
            row = [n for n in row if self.facts.landmarks[n].side == side]
        along = [self.facts.landmarks[n].along_m for n in row]
        numbers = {passage.ordinal} - {0}
        turned_m = (t.along_m + 0.25 for t in self.facts.turns
                    if abs(t.angle_deg) >= 45.0
                    and 0.0 <= t.along_m - visit.from_m <= _AT_ONCE_M)  # fmt: skip
        from_m = (visit.from_m - 0.3, visit.from_m + 0.5, *turned_m)
        for first_m in from_m[bool(side) :]:
            numbers.add(1 + sum(first_m <= a < passage.along_m - 0.5 for a in along))
        last = not any(passage.along_m + 0.8 < a <= visit.to_m for a in along)
        return numbers | ({-1} if last else set())

    def doors_passed(self, claim: Claim, from_m: float) -> int:
        """Return how many doorways of a claim are passed before the next one is gone through."""
        ahead = (p.along_m for p in self.facts.passages if p.along_m > from_m + 0.5)
        to_m = next(ahead, self.length_m + 1.0)
        marks = [(self.facts.landmarks[n], self.near_m[n].min()) for n in self.meant(claim)]
        return sum(
            THROUGH_M < near_m <= BESIDE_M
            and from_m - 1.5 <= mark.along_m < to_m
            and claim.side in ("", mark.side)
            for mark, near_m in marks
        )

    def _ends(self) -> set[str]:
        """Return the rooms on whose threshold the path ends, without the one that it comes from."""
        last = self.facts.passages[-1:]
        return {*self.facts.goal_rooms} - {p.from_room for p in last}

    def _crossed(self, claim: Claim, room, ends: Collection[str], fault: str) -> Place:
        names = self.rooms(claim.name)
        mask = np.zeros(len(self.along_m), dtype=bool)
        found = [p for p in self.facts.passages if not claim.name or room(p) in names]
        if claim.side in ("left", "right", "ahead"):
            sided = [p for p in found if self.door_side(p, claim.side)]
            if found and not sided:
                return mask, f"the {claim.name or 'doorway'} is not {spoken_side(claim.side)}"
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
        names = self.rooms(claim.name)
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
        names = self.rooms(claim.name)
        if not names & {*self.facts.level_rooms, *(v.room for v in self.facts.visits)}:
            return np.zeros(len(self.along_m), dtype=bool), f"there is no {claim.name}"
        if claim.side in ("left", "right"):
            mask, fault = self._room_side(names, claim.side), f"is not {spoken_side(claim.side)}"
        else:
            rows = [n for n, m in enumerate(self.facts.landmarks)
                    if names & {m.room, *m.leads}]  # fmt: skip
            ahead = self.seen[rows] & (np.abs(self.bearing[rows]) <= 125.0)
            mask, fault = self.inside(claim)[0] | ahead.any(axis=0), "is not in view"
        return mask, "" if mask.any() else f"the {claim.name} {fault}"

    def _room_side(self, names: frozenset[str], side: str) -> Mask:
        """Return where a room is on a side, as its doors say, or what is seen in it."""
        mask = np.zeros(len(self.along_m), dtype=bool)
        known = False
        for p in self.facts.passages:
            if p.to_room in names:
                known = True
                if self.door_side(p, side):
                    mask |= self.between(p.along_m - 4.0, p.along_m + 0.5)
        doors = [n for n in self._openings(names) if self.near_m[n].min() > THROUGH_M]
        within = [n for n, m in enumerate(self.facts.landmarks) if not m.leads and m.room in names]
        for rows, reach_m in ((doors, _DOOR_NEAR_M), (within, _SEEN_IN_M)):
            off = np.abs(self.bearing[rows])
            far_m = np.where((off >= 25.0) & (off <= 125.0), self.near_m[rows], np.inf)
            # Of several doors the nearest shows where the room is.
            near = far_m <= min(reach_m, far_m.min(initial=np.inf) + 0.6)
            if not known and near.any():
                known = True
                mask |= (near & self.sided(rows, side)).any(axis=0)
        return mask

    def room_passed(self, claim: Claim) -> Place:
        """Return where a room lies beside the path, entered or not."""
        rows = self._openings(self.rooms(claim.name))
        off = np.abs(self.bearing[rows])
        beside = (
            self._nearest()[rows] & (self.near_m[rows] <= PASS_M) & (off >= 30.0) & (off <= 150.0)
        )
        inside, _ = self.inside(claim)
        if not (inside | beside.any(axis=0)).any():
            return inside, f"the path does not come by the {claim.name}"
        if claim.side not in ("left", "right"):
            return inside | beside.any(axis=0), ""
        beside &= self.sided(rows, claim.side)
        beside &= self.near_m[rows].min(axis=1, keepdims=True) > THROUGH_M
        mask, seen = beside.any(axis=0), self._room_side(self.rooms(claim.name), claim.side)
        mask = mask | (inside & seen)
        return mask, "" if mask.any() else f"the {claim.name} is not {spoken_side(claim.side)}"

    def _openings(self, names: frozenset[str]) -> list[int]:
        """Return the doorways and openings that lead to a room."""
        marks = enumerate(self.facts.landmarks)
        return [n for n, m in marks if m.noun in (DOOR, OPENING) and names & set(m.leads)]

    def stopped_in(self, claim: Claim) -> str:
        """Return why the path does not stop in, outside or in the doorway of a room."""
        facts, names = self.facts, self.rooms(claim.name)
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
        facts, names = self.facts, self.rooms(claim.room)
        reach = 1.3 if claim.place == "doorway" else 2.2
        meant = (facts.landmarks[n] for n in self.meant(claim))
        doors = [m for m in meant if m.goal_distance_m <= reach]
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
        if (claim.side or claim.ordinal) and doors:
            return self.stopped_at(replace(claim, place=""))
        return ""

    def door_side(self, passage: PassageFact, side: str) -> bool:
        """Return whether a doorway that is walked through may be said to be on a side."""
        if side == "behind":  # where the walk begins
            turned = any(abs(t.angle_deg) >= 90.0 for t in self.facts.turns if t.along_m < 1.0)
            return turned and passage is self.facts.passages[0]
        if side == "ahead":  # one that is straight ahead may be turned in
            to_m = -0.4 if abs(passage.bearing_deg) <= _DOOR_SIDE_DEG else 0.1
            near = (
                t.angle_deg for t in self.facts.turns if -1.5 <= t.along_m - passage.along_m < to_m
            )
            return abs(sum(near)) < _AHEAD_DEG
        sign = 1 if side == "left" else -1
        aside = abs(passage.bearing_deg) > 18.0
        into = [t for t in self.facts.turns if abs(t.angle_deg) >= 45.0
                and -1.0 <= t.along_m - passage.along_m <= 0.25]  # fmt: skip
        if into and aside and into[-1].along_m > passage.along_m:
            return side in (into[-1].side, "left" if passage.bearing_deg > 0 else "right")
        if into:
            return into[-1].side == side
        bent = any(t.side == side and abs(t.angle_deg) >= _BEND_DEG
                   and -1.0 <= t.along_m - passage.along_m <= 0.0
                   for t in self.facts.turns)  # fmt: skip
        if bent and sign * passage.bearing_deg > _DOOR_SIDE_DEG:
            return True
        after_m = 0.8 if aside else 1.3
        near = [t for t in self.facts.turns if -2.2 <= t.along_m - passage.along_m <= after_m]
        turned, bearing = sign * sum(t.angle_deg for t in near), sign * passage.bearing_deg
        if abs(turned) < 20.0 or (turned > 0) == (bearing > 0) or abs(bearing) > abs(turned):
            if bearing > 12.0 or turned >= 20.0:
                return True
            if bearing < -18.0 or turned <= -28.0:
                return False
        else:
            return turned > 0
        k = int(np.argmin(np.abs(self.along_m - passage.along_m)))
        before = slice(max(0, k - 18), max(1, k - 1))
        for n in self.meant(Claim("door", "door")):
            if self.distance[n, max(k - 1, 0) : k + 2].min() <= THROUGH_M:
                seen = self.open[n, before] & (self.distance[n, before] > 0.5)
                return bool((seen & (sign * self.facing[n, before] > _DOOR_SIDE_DEG)).any())
        return False
