"""What it costs to say that rooms and doors are entered, left, passed, seen, or stopped at."""

from dataclasses import replace

import numpy as np

from ..facts.doors import DOOR, OPENING
from ..facts.records import ClimbFact, PassageFact
from ..language.claims import Claim
from .fit import NEVER, WRONG, Costs, Fit, Part, best, never, ramp
from .things import BESIDE_M, Things, spoken_side

_AT_DOOR_M = 0.4, 1.2  # from the middle of a passage
_AT_ONCE_M = 1.5  # a turn so far behind a door is made before doorways are counted
_UNSURE = 0.5
_DOOR_NEAR_M, _SEEN_IN_M = 3.0, 5.0  # a door, and a thing in a room, that show where the room is


class Ground(Things):
    """The facts of one path over S places, a quarter of a metre apart.

    Attributes:
        few_m: as far as "a few steps" may lead [m].
    """

    few_m = 4.5

    def crossed(self, claim: Claim, within: str = "", turned: bool = False) -> Fit:
        """Return what it costs to say that a room is entered or left, or a door gone through.

        Args:
            within: the room that the text is in.
            turned: its side is that of a turn that the text says.
        """
        facts = self.facts
        door = claim.kind == "door" or claim.what == "door"
        name = claim.room if door else claim.name
        names = self.rooms(name)
        found: list[PassageFact] = []
        for p in [*facts.passages, *self._thresholds()]:
            rooms = {"leave": {p.from_room}, "enter": {p.to_room}}.get(
                claim.kind, {p.from_room, p.to_room}
            )
            if door:
                rooms = {p.from_room, p.to_room}
            if (not name or names & rooms) and (not door or p.doorway or claim.name):
                found.append(p)
        what = (
            f"the {'door of the ' * (door and bool(name))}{name or ('doorway' if door else 'room')}"
        )
        inside = self.meant(Claim("door", "door")) if door and not (name or claim.side) else []
        if not found and not inside:
            return never(
                self.places, f"{what} is not {'left' if claim.kind == 'leave' else 'entered'}"
            )
        far = [ramp(np.abs(self.along_m - p.along_m), 0.4, 0.9) for p in found]
        # A doorway inside of what the map calls one room.
        far += [ramp(self.distance[inside].min(axis=0), 0.5, 1.0)] if inside else []
        none = [0.0] * (len(far) - len(found))
        told: list[Part] = [(np.array(far), f"{what} comes elsewhere on the path")]
        if within:
            own = self.rooms(within)
            other = [WRONG * (not {p.from_room, p.to_room} & {*own, ""}) for p in found]
            told.append((_column(other + none), f"one does not come to {what} from the {within}"))
        if claim.ordinal:
            other = [
                WRONG * (claim.ordinal not in self._door_numbers(p, claim.side)) for p in found
            ]
            told.append(
                (
                    _column(other + [WRONG] * len(none)),
                    f"that is not doorway number {claim.ordinal}",
                )
            )
        sides: list[Part] = []
        if claim.side == "ahead" or (claim.side in ("left", "right", "behind") and not turned):
            cost = [self.door_side(p, claim.side, turned) for p in found]
            sides.append((_column(cost + none), f"{what} is not {spoken_side(claim.side)}"))
        return best((len(far), self.places), told, sides)

    def _thresholds(self) -> list[PassageFact]:
        """Return the steps between rooms that the path may be said to make at its ends."""
        facts, last, first = self.facts, self.facts.visits[-1].room, self.facts.visits[0].room
        came = {p.from_room for p in facts.passages[-1:]}
        ends = [(self.length_m - 0.4, last, room) for room in facts.goal_rooms if room not in came]
        for low, high, name in self._on_stairs():
            ends += [(low, facts.room_at(low), name), (high, name, facts.room_at(high + 0.1))]
        for room in facts.start_rooms:  # who starts there leaves one and comes into the other
            ends += [(0.5, room, first), (0.5, first, room)]
        return [PassageFact(at, a, b, True, 0.0) for at, a, b in ends]

    def _on_stairs(self) -> list[tuple[float, float, str]]:
        """Return from where to where the stairs of the path and their landings go [m], as rooms."""
        climbs = self.facts.climbs
        landings = [(low, high, "landing") for c in climbs for low, high in c.landings_m]
        return landings + [(c.along_m, c.to_m, "stairwell") for c in climbs]

    def door_side(self, passage: PassageFact | ClimbFact, side: str, told: bool = False) -> float:
        """Return what it costs to say that a doorway or stairs that one walks to are on a side.

        Args:
            told: a turn before it is said.
        """
        turns = self.facts.turns
        if side == "behind":  # where the walk begins
            turned = any(abs(t.angle_deg) >= 90.0 for t in turns if t.along_m < 1.0)
            return 0.0 if turned and passage is self.facts.passages[0] else NEVER
        if passage not in (*self.facts.passages, *self.facts.climbs):
            return _UNSURE

        def turned_deg(low_m: float, high_m: float) -> float:
            return sum(t.angle_deg for t in turns if low_m <= t.along_m - passage.along_m <= high_m)

        if side == "ahead":
            bent_deg = abs(turned_deg(-0.8 if told else -1.5, 0.1))
            return float(ramp(min(bent_deg, abs(passage.bearing_deg) + 20.0), 40.0, 56.0))
        sign = 1 if side == "left" else -1
        shown = [
            sign * passage.bearing_deg,
            sign * turned_deg(-1.0, 0.25),
            sign * turned_deg(-2.2, 0.6),
        ]
        return float(ramp(-max(shown), -20.0, -10.0))

    def _door_numbers(self, passage: PassageFact, side: str) -> set[int]:
        """Return the numbers of a doorway among those of the room that is left, −1 for the last.

        They are counted from where the room is entered, with that doorway or without it.
        """
        own = passage in self.facts.passages
        visit = self.facts.visits[self.facts.passages.index(passage) if own else -1]
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

    def doors_passed(self, claim: Claim) -> Costs:
        """Return (S,) what it costs to pass the doorways of a claim in the room of a place."""
        marks = self.facts.landmarks
        beside = [marks[n].along_m for n in self.meant(claim)
                  if not self.through()[n] and self.near_m[n].min() <= BESIDE_M
                  and claim.side in ("", marks[n].side)]  # fmt: skip
        passages = np.array([-0.5, *(p.along_m for p in self.facts.passages), self.length_m + 1.0])
        result = []
        for at_m in self.along_m:
            k = int(np.searchsorted(passages, at_m + 0.5))
            number = sum(passages[k - 1] - 0.5 <= a < passages[k] for a in beside)
            result.append(WRONG * (number < claim.count))
        return np.array(result)

    def inside(self, claim: Claim) -> Fit:
        """Return what it costs to say that the walker is in a room."""
        names, facts = self.rooms(claim.name), self.facts
        spans = [(v.from_m, v.to_m) for v in facts.visits if v.room in names or not claim.name]
        spans += [(low, high) for low, high, name in self._on_stairs() if name in names]
        spans += [(0.0, 0.3)] if names & {*facts.start_rooms} else []
        spans += [(self.length_m - 0.5, self.length_m)] if names & {*facts.goal_rooms} else []
        if not spans:
            return never(self.places, f"the path does not visit the {claim.name}")
        off = [np.maximum(a - self.along_m, self.along_m - b) for a, b in spans]
        far = ramp(np.min(off, axis=0), 0.4, 1.2)
        return best((1, self.places), [(far, f"the {claim.name} comes elsewhere on the path")])

    def room_in_view(self, claim: Claim) -> Fit:
        """Return what it costs to say that a room may be seen, on the side said."""
        names, facts = self.rooms(claim.name), self.facts
        stairs = (name for _, _, name in self._on_stairs())
        if not names & {*facts.level_rooms, *(v.room for v in facts.visits), *stairs}:
            return never(self.places, f"there is no {claim.name}")
        if claim.side in ("left", "right"):
            return self._room_side(claim, names)
        rows = [n for n, m in enumerate(facts.landmarks) if names & {m.room, *m.leads}]
        far = ramp(np.abs(self.bearing[rows]), 110.0, 130.0) + NEVER * ~self.seen[rows]
        far = np.minimum(far.min(axis=0, initial=NEVER), self.inside(claim).cost)
        return best((1, self.places), [(far, f"the {claim.name} is not in view")])

    def _room_side(self, claim: Claim, names: frozenset[str]) -> Fit:
        """Return on which side a room is, as its doors say, or what is seen in it."""
        fault = f"the {claim.name} is not {spoken_side(claim.side)}"
        entries = [p for p in self.facts.passages if p.to_room in names]
        if entries:
            off = [self.along_m - p.along_m for p in entries]
            far = np.array([np.maximum(ramp(-m, 3.5, 5.0), ramp(m, 0.5, 1.2)) for m in off])
            cost = _column([self.door_side(p, claim.side) for p in entries])
            return best(
                (len(far), self.places), [(far, f"the {claim.name} is elsewhere")], [(cost, fault)]
            )
        doors = [n for n in self._openings(names) if not self.through()[n]]
        within = [n for n, m in enumerate(self.facts.landmarks) if not m.leads and m.room in names]
        for rows, reach_m in ((doors, _DOOR_NEAR_M), (within, _SEEN_IN_M)):
            off = np.abs(self.bearing[rows])
            far_m = np.where((off >= 25.0) & (off <= 125.0), self.near_m[rows], np.inf)
            # Of several doors the nearest shows where the room is.
            far = ramp(far_m, reach_m, reach_m + 1.0)
            far = np.maximum(far, ramp(far_m - min(far_m.min(initial=np.inf), 99.0), 0.6, 1.2))
            if (far < 1.0).any():
                return best(
                    far.shape,
                    [(far, f"the {claim.name} is not near")],
                    [(self.sided(rows, claim.side), fault)],
                )
        return never(self.places, fault)

    def room_passed(self, claim: Claim) -> Fit:
        """Return what it costs to say that a room lies beside the path, entered or not."""
        names = self.rooms(claim.name)
        rows = self._openings(names)
        off = np.abs(np.abs(self.bearing[rows]) - 90.0)
        near = np.maximum(self._beyond_nearest()[rows], ramp(self.near_m[rows], 2.6, 3.3))
        beside = np.maximum(near, ramp(off, 55.0, 75.0))
        inside = self.inside(claim).cost
        if claim.side in ("left", "right"):
            beside = np.maximum(beside, self.sided(rows, claim.side))
            beside = beside + NEVER * self.through()[rows]
            inside = np.maximum(inside, self._room_side(claim, names).cost)
        far = np.minimum(beside.min(axis=0, initial=NEVER), inside)
        fault = f"the path does not come by the {claim.name}"
        return best(
            (1, self.places), [(far, fault + f" {spoken_side(claim.side)}" * bool(claim.side))]
        )

    def doors_m(self, claim: Claim) -> Costs:
        """Return (D, S) where doors of a room, on the side said, are passed, nan if far [m]."""
        marks = (self.facts.landmarks[n] for n in self._openings(self.rooms(claim.name)))
        at = np.array([m.along_m for m in marks if claim.side in ("", m.side)])[:, None]
        return np.where(np.abs(at - self.along_m) <= _DOOR_NEAR_M, at, np.nan)

    def _openings(self, names: frozenset[str]) -> list[int]:
        """Return the doorways and openings that lead to a room."""
        marks = enumerate(self.facts.landmarks)
        return [n for n, m in marks if m.noun in (DOOR, OPENING) and names & set(m.leads)]

    def stopped_in(self, claim: Claim) -> Fit:
        """Return what it costs to stop in, outside or in the doorway of a room."""
        facts, names = self.facts, self.rooms(claim.name)
        near = {*facts.goal_rooms, *facts.goal_near_rooms}
        entered_m = self.length_m - facts.visits[-1].from_m
        cost, outside = NEVER, claim.place in ("outside", "before")
        if (outside or claim.place in ("at", "past")) and names & near:
            cost = 0.0
        elif outside and facts.goal_room in names and len(facts.visits) > 1:
            cost = float(ramp(entered_m, 0.5, 1.0))
        elif not outside and names & {facts.goal_room, *facts.goal_rooms}:
            cost = 0.0
        fault = f"the path does not end {claim.place or 'in'} the {claim.name}"
        return best((1, self.places), [(cost, fault)])

    def stopped_at_door(self, claim: Claim) -> Fit:
        """Return what it costs to stop at or in a doorway."""
        facts, names = self.facts, self.rooms(claim.room)
        reach = 1.1 if claim.place == "doorway" else 2.0
        meant = [facts.landmarks[n] for n in self.meant(claim)]
        last = facts.passages[-1] if facts.passages else None
        since = self.length_m - last.along_m if last else np.inf
        far_m = min([m.goal_distance_m for m in meant], default=np.inf)
        cost = float(ramp(min(far_m, since), reach, reach + 0.4))
        rooms = {*facts.goal_rooms, *facts.goal_near_rooms}
        if last and since <= reach:
            rooms |= {last.from_room, last.to_room}
        own = facts.goal_room in names and facts.visits[-1].exits <= 1
        other = WRONG * bool(claim.room and not names & rooms and not (own and far_m <= reach))
        fault = f"the doorway at the end of the path is not that of the {claim.room}"
        parts: list[Part] = [(cost, "no doorway is at the end of the path"), (other, fault)]
        if (claim.side or claim.ordinal) and far_m <= reach:
            own_fit = self.stopped_at(replace(claim, place=""))
            parts.append((own_fit.cost, own_fit.reason(self.places - 1)))
        return best((1, self.places), parts)


def _column(costs: list[float]) -> Costs:
    return np.array(costs, dtype=np.float64)[:, None]
