"""What it costs to say that a thing is passed, seen, reached, or stopped at along a path."""

import numpy as np

from ..facts.doors import DOOR, OPENING
from ..facts.geometry import MOMENT_M
from ..facts.records import PathFacts
from ..language.claims import Claim
from ..language.lexicon import COLOUR_NEIGHBOURS, INNATE_COLOURS, OBJECT_PHRASES, ROOM_PHRASES
from ..language.nouns import called, room_answers
from .fit import NEVER, WRONG, Costs, Fit, Mask, Part, best, never, ramp

BESIDE_M = 3.6
FAR_M = 99.0
_THROUGH_M = 0.4
_TOUCH_M = 0.8  # a thing this near is at hand whatever stands between
_VISIBLE_PIXELS = 12
_BEHIND_DEG, _FRONT_DEG = 130.0, 75.0
_FLANKS_DEG = 60.0  # between two things that are at least so far apart


class Things:
    """The things beside one path over S places, a quarter of a metre apart."""

    def __init__(self, facts: PathFacts):
        """Spread the landmarks' moments over the path."""
        self.facts = facts
        self.length_m = facts.length_m
        samples = max(2, round(facts.length_m / MOMENT_M) + 1)
        self.along_m: Costs = np.linspace(0.0, facts.length_m, samples).astype(float)
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
        self.near_m = np.where(self.open | (self.distance <= _TOUCH_M), self.distance, np.inf)
        front: Mask = (np.abs(self.bearing) <= _FRONT_DEG) | ~np.isfinite(self.distance)
        behind = np.minimum(np.abs(self.bearing), np.abs(self.facing))[:, :1] >= _BEHIND_DEG
        # What is behind at the start is beside nothing until the walker faces it or comes back.
        self._behind: Mask = behind & ~np.logical_or.accumulate(front, axis=1)
        rooms = [{"", facts.room_at(along)} for along in self.along_m]
        rooms[-1].update(facts.goal_rooms)  # on whose threshold the path ends
        own = [[mark.room in near or bool(mark.leads) or mark.noun == "stairs"
                for near in rooms] for mark in facts.landmarks]  # fmt: skip
        self._own: Mask = np.array(own, dtype=bool).reshape(shape)  # in the walker's room
        self.places = samples

    def rooms(self, name: str) -> frozenset[str]:
        """Return the rooms that a name means here: those of just that name, if there are any."""
        own = frozenset((name,)) & {*self.facts.level_rooms}
        landing = name == "landing" and any(climb.landings_m for climb in self.facts.climbs)
        return (own or room_names(name)) | ({"landing"} if landing else frozenset())

    # fits -------------------------------------------------------------------------------------

    def passed(self, claim: Claim) -> Fit:
        """Return what it costs to say that a thing is passed."""
        off = np.where(self.distance <= 0.3, 0.0, np.abs(np.abs(self.bearing) - 90.0))
        angle = np.deg2rad(self.facing)
        near_m = np.minimum(self.near_m, FAR_M)
        to_go_m = near_m * np.abs(np.cos(angle)) / np.maximum(np.abs(np.sin(angle)), 0.2)
        to_go_m = np.where(self.distance <= 0.3, 0.0, to_go_m)  # a rug that is walked over
        abeam = np.max([
            ramp(near_m, 2.6, 3.3), ramp(off, 50.0, 75.0), self._beyond_nearest(),
            ramp(_beyond_least(to_go_m, self.along_m[1]), 0.2, 0.6), NEVER * self._behind,
        ], axis=0)  # fmt: skip
        if claim.side:  # ahead where it is never abeam
            ahead = np.maximum(ramp(near_m, 3.0, 3.8), ramp(np.abs(self.bearing), 50.0, 65.0))
            ahead += NEVER * (abeam <= 0.6).any(axis=1, keepdims=True)
            abeam = np.minimum(abeam, 0.5 + ahead)
        if claim.what == "door" and claim.side:  # one that is gone through is on no side
            abeam = np.maximum(abeam, NEVER * self.through())
        return self._of(claim, abeam, "is not beside the path")

    def through(self) -> Mask:
        """Return (N, 1) which doorways are gone through."""
        return np.asarray(self.near_m.min(axis=1, keepdims=True) <= _THROUGH_M)

    def seen_at(self, claim: Claim) -> Fit:
        """Return what it costs to say that a thing is in view; one on a side is nearby."""
        view = ramp(np.abs(self.bearing), 110.0, 130.0) + NEVER * ~self.seen
        sided = claim.side in ("left", "right")
        view = np.maximum(view, ramp(self.distance, *((3.2, 4.0) if sided else (7.0, 9.0))))
        far = np.minimum(view, ramp(self.near_m, 2.6, 3.3))
        if sided:
            far = np.maximum(far, NEVER * self._behind)
        if sided and claim.what == "thing":  # a door is walked up to
            far = np.maximum(far, self._beyond_nearest())
        return self._of(claim, far, "is never in view")

    def reached(self, claim: Claim) -> Fit:
        """Return what it costs to say that a thing is at hand, or close ahead."""
        ahead = np.maximum(ramp(self.near_m, 3.2, 4.0), ramp(np.abs(self.bearing), 50.0, 70.0))
        if claim.what == "door":
            ahead = np.full_like(ahead, NEVER)
        reach = (1.2, 2.2) if claim.what == "door" else (2.0, 2.8)
        return self._of(claim, np.minimum(ramp(self.near_m, *reach), ahead), "is not reached")

    def stopped_at(self, claim: Claim) -> Fit:
        """Return what it costs to say that the walker stops at a thing, wherever he is."""
        bearing = np.abs(self.bearing)
        reach = {"before": 2.4, "past": 3.2, "between": 2.4}.get(claim.place, 2.0)
        reach = max(
            reach, {"left": 2.4, "right": 2.4, "ahead": 3.2, "behind": 2.4}.get(claim.side, 0.0)
        )
        far = ramp(self.near_m, reach - 0.2, reach + 0.4)
        if claim.place == "past":
            far = np.maximum(ramp(self.distance, reach, reach + 0.4), ramp(-bearing, -65.0, -55.0))
        elif claim.place == "before":
            far = np.maximum(
                far, np.minimum(ramp(bearing, 100.0, 125.0), ramp(self.near_m, 0.6, 1.0))
            )
        elif not claim.side:
            far = np.maximum(
                far, np.minimum(ramp(bearing, 130.0, 155.0), ramp(self.near_m, 1.4, 2.0))
            )
        return self._of(claim, far, "is not at the end of the path")

    def _beyond_nearest(self) -> Costs:
        """Return (N, S) what it costs that things are farther than within 2 m of walking."""
        return ramp(_beyond_least(np.minimum(self.near_m, FAR_M), self.along_m[1]), 0.4, 0.9)

    def _of(self, claim: Claim, far: Costs, fault: str) -> Fit:
        """Return the fit of the things that a claim may mean, `far` (N, S) from where it says."""
        name = claim.name or "doorway"
        rows = self.meant(claim)
        if not rows:
            on_level = any(called(n, name) for n in self.facts.level_nouns)
            return never(
                self.places, f"there is no {name} {'on the route' if on_level else 'in this scene'}"
            )
        told: list[Part] = [(far[rows], f"the {name} {fault}")]
        if claim.what == "thing":
            own = self._own[rows]
            first = ((far[rows] <= 0.35) & own).any()  # who names one in the room means that one
            told.append(((1.2 if first else 0.4) * ~own, f"the {name} is in another room"))
        for kind, value in (("material", claim.material), ("colour", claim.colour)):
            # What neither label nor picture says of any of them cannot be checked.
            looks = [self._looks(n, kind) for n in rows]
            if value and any(looks):
                other = np.array([WRONG * (value not in own) for own in looks])[:, None]
                told.append((other, f"nothing says that the {name} is {value}"))
        if claim.ordinal:
            other = WRONG * ~self.ordinal(rows, claim)[:, None]
            told.append((other, f"that is not {name} number {claim.ordinal}"))
        if claim.count > 1 and claim.what != "door":
            told.append(
                (
                    WRONG * ~self._counted(rows, claim.count),
                    f"there are not {claim.count} of them ({name})",
                )
            )
        sides: list[Part] = []
        if claim.side in ("left", "right", "ahead", "behind"):
            sides.append(
                (self.sided(rows, claim.side), f"the {name} is not {spoken_side(claim.side)}")
            )
        return best(far[rows].shape, told, sides)

    def sided(self, rows: list[int], side: str) -> Costs:
        """Return (N, S) what it costs to say that things are on a side."""
        bearing, facing = self.bearing[rows], self.facing[rows]
        if side == "ahead":
            return ramp(np.minimum(np.abs(facing), np.abs(bearing)), 40.0, 60.0)
        if side == "behind":
            return ramp(-np.maximum(np.abs(facing), np.abs(bearing)), -115.0, -95.0)
        sign = 1 if side == "left" else -1
        sine = sign * np.sin(np.deg2rad(np.where(np.abs(bearing) <= 8.0, facing, bearing)))
        return ramp(-sine, -0.4, -0.1)

    # which things -----------------------------------------------------------------------------

    def flank(self, claim: Claim, other: Claim, at_end: bool = False) -> bool:
        """Return whether the walker has two things on different sides, on the way or at the end."""
        sides = []
        for rows in (self.meant(claim), self.meant(other)):
            near = self.near_m[rows] <= BESIDE_M
            near[:, : -2 if at_end else 0] = False
            sides.append(np.where(near, self.facing[rows], np.nan))
        apart = np.abs((sides[0][:, None] - sides[1][None] + 180.0) % 360.0 - 180.0)
        return bool((apart >= _FLANKS_DEG).any())

    def meant(self, claim: Claim) -> list[int]:
        """Return the things that a claim may mean, by name and room."""
        marks = list(enumerate(self.facts.landmarks))
        if claim.what == "door":
            names = self.rooms(claim.room)
            nouns = (DOOR, OPENING) if claim.name else (DOOR,)
            return [n for n, m in marks if m.noun in nouns and (not names or names & set(m.leads))]
        found = [n for n, m in marks if called(m.noun, claim.name)]
        head, _, kind = claim.name.rpartition(" ")
        if not found and head and self.rooms(head):
            found = [n for n, m in marks if called(m.noun, kind) and m.room in self.rooms(head)]
        if not found and head and head in OBJECT_PHRASES:
            present = any(called(m.noun, head) for _, m in marks)
            found = [n for n, m in marks if called(m.noun, kind)] if present else []
        if claim.room:
            return [n for n in found if self.facts.landmarks[n].room in self.rooms(claim.room)]
        return found

    def _looks(self, n: int, kind: str) -> set[str]:
        mark = self.facts.landmarks[n]
        if kind == "material":
            return {mark.material} - {""}
        own = {mark.colour, INNATE_COLOURS.get(mark.noun, "")} - {""}
        return own | {near for colour in own for near in COLOUR_NEIGHBOURS.get(colour, ())}

    def ordinal(self, chosen: list[int], claim: Claim) -> Mask:
        """Return which things have an ordinal, counted from the start, in a room, or on a side."""
        marks = self.facts.landmarks
        every = self.meant(Claim("see", "door")) if claim.what == "door" else chosen
        least_m = 0.4 * (claim.what == "door")  # not one that is gone through before
        near = [n for n in every if self.near_m[n].min() <= BESIDE_M
                and (n in chosen or self.near_m[n].min() > least_m)]  # fmt: skip
        near.sort(key=lambda n: marks[n].along_m)
        rows = [near]
        if claim.side in ("left", "right"):  # where it is nearest, not behind a later turn
            through = self.through()[:, 0]
            rows = [[n for n in near if marks[n].side in ("", claim.side) or through[n]]]
        visited = {"", *(visit.room for visit in self.facts.visits)}
        rows.append([n for n in rows[0] if marks[n].room in visited])  # none behind a door
        for visit in self.facts.visits:
            for first_m in (visit.from_m - 0.3, visit.from_m + 0.5)[bool(claim.side) :]:
                rows += [[n for n in row if first_m <= marks[n].along_m <= visit.to_m + 0.5]
                         for row in rows[:2]]  # fmt: skip
        if claim.what == "door" and claim.side:
            rows = rows[2:]  # of one room
        k = claim.ordinal - 1 if claim.ordinal > 0 else -1
        right = {row[k] for row in rows if (k == -1 and row) or 0 <= k < len(row)}
        return np.array([n in right for n in chosen], dtype=bool)

    def _counted(self, rows: list[int], number: int) -> Mask:
        k = max(1, round(1.5 / self.along_m[1]))

        def around(reach_m: float) -> Costs:
            near = (self.near_m[rows] <= reach_m).astype(float)
            wide = [
                np.convolve(row, np.ones(2 * k + 1), mode="same")[: self.places] > 0.5
                for row in near
            ]
            return np.sum(wide, axis=0)

        return (around(1.2) <= number) & (number <= around(4.5))


def _beyond_least(value: Costs, step_m: float) -> Costs:
    """Return by how much values (N, S) exceed the least within 2 m of walking."""
    window = max(1, round(2.0 / step_m))
    padded = np.pad(value, ((0, 0), (window, window)), constant_values=np.inf)
    views = np.lib.stride_tricks.sliding_window_view(padded, 2 * window + 1, axis=1)
    return value - views.min(axis=2)


def room_names(name: str) -> frozenset[str]:
    """Return the canonical rooms that a phrase may mean."""
    return frozenset(r for r in ROOM_PHRASES.get(name, ()) if name in room_answers(r))


def spoken_side(side: str) -> str:
    """Return a side in words."""
    return {"ahead": "ahead", "behind": "behind the walker"}.get(side, f"on the {side}")
