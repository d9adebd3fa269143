"""Where along a path a thing is passed, seen, reached, or stopped at."""

import numpy as np
from numpy.typing import NDArray

from ..facts.doors import DOOR, OPENING
from ..facts.geometry import MOMENT_M
from ..facts.records import PathFacts
from ..language.claims import Claim
from ..language.lexicon import COLOUR_NEIGHBOURS, INNATE_COLOURS, OBJECT_PHRASES, ROOM_PHRASES
from ..language.nouns import called, room_answers

Mask = NDArray[np.bool_]
Place = tuple[Mask, str]  # where it holds, and why it holds nowhere

PASS_M, REACH_M, BESIDE_M, SEE_M = 3.0, 2.4, 3.6, 8.0
# How far from a thing the path may end, by the claim's place.
_STOP_M = {"before": 2.4, "past": 3.2, "between": 2.4}
_STOP_SIDED_M = {"": 2.0, "left": 2.4, "right": 2.4, "ahead": 3.2, "behind": 2.4}
THROUGH_M = 0.4
_TOUCH_M = 0.8  # a thing this near is at hand whatever stands between
_CLEARLY_M = 0.5  # by how much the thing that is meant is the nearest
_AT_HAND_M = 1.8
_ONE_PLACE_M = 3.0  # things of a name that are met this close together may all be meant
_VISIBLE_PIXELS = 12
_SIDE_DEG = (8.0, 172.0)
_CLEAR_SIDE_DEG = 25.0
_BEHIND_DEG, _FRONT_DEG = 130.0, 75.0
_FLANKS_DEG = 60.0  # between two things that are at least so far apart


class Things:
    """The things beside one path over S places, a quarter of a metre apart."""

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
        self.near_m = np.where(self.open | (self.distance <= _TOUCH_M), self.distance, np.inf)
        front: Mask = (np.abs(self.bearing) <= _FRONT_DEG) | ~np.isfinite(self.distance)
        behind = np.minimum(np.abs(self.bearing), np.abs(self.facing))[:, :1] >= _BEHIND_DEG
        # What is behind at the start is beside nothing until the walker faces it or comes back.
        self._behind: Mask = behind & ~np.logical_or.accumulate(front, axis=1)
        rooms = [facts.room_at(along) for along in self.along_m]
        own = [[mark.room in ("", room) for room in rooms] for mark in facts.landmarks]
        self._own: Mask = np.array(own, dtype=bool).reshape(shape)  # in the walker's room

    def rooms(self, name: str) -> frozenset[str]:
        """Return the rooms that a name means here: those of just that name, if there are any."""
        own = frozenset((name,)) & {*self.facts.level_rooms}
        return own or room_names(name)

    def between(self, low_m: float, high_m: float) -> Mask:
        """Return the places between two distances along the path."""
        return (self.along_m >= low_m - 0.13) & (self.along_m <= high_m + 0.13)

    def passed(self, claim: Claim, since: int = 0) -> Place:
        """Return where a thing is beside the walker, from place `since` on where it is."""
        abeam = (np.abs(self.bearing) >= 35.0) & (np.abs(self.bearing) <= 145.0)
        abeam |= self.distance <= 0.3  # a rug that is walked over
        near = (self.near_m <= PASS_M) & abeam & self._nearest() & ~self._behind
        if claim.what == "door" and claim.side:  # one that is gone through is on no side
            near &= self.near_m.min(axis=1, keepdims=True) > THROUGH_M
        if claim.side:  # ahead where it is never abeam
            ahead = (self.near_m <= BESIDE_M) & (np.abs(self.bearing) < 60.0)
            near |= ahead & ~near.any(axis=1, keepdims=True)
        return self._where(claim, near, "is not beside the path", since)

    def _nearest(self) -> Mask:
        """Return (N, S) where things are about as near as they get within 2 m of walking."""
        window = max(1, round(2.0 / self.along_m[1]))
        padded = np.pad(self.near_m, ((0, 0), (window, window)), constant_values=np.inf)
        views = np.lib.stride_tricks.sliding_window_view(padded, 2 * window + 1, axis=1)
        return self.near_m <= views.min(axis=2) + 0.5

    def seen_at(self, claim: Claim, since: int = 0) -> Place:
        """Return where a thing is in view; one on a side is nearby."""
        mask = self.seen & (np.abs(self.bearing) <= 125.0)
        if claim.side in ("left", "right"):
            near = mask & (self.distance <= BESIDE_M) | (self.near_m <= PASS_M)
            near &= ~self._behind
            near &= self._nearest() if claim.what == "thing" else True  # a door is walked up to
            return self._where(claim, near, "is never in view", since)
        mask = mask & (self.distance <= SEE_M) | (self.near_m <= PASS_M)
        return self._where(claim, mask, "is never in view")

    def reached(self, claim: Claim, since: int = 0) -> Place:
        """Return where a thing is at hand, or close ahead."""
        ahead = (self.near_m <= BESIDE_M) & (np.abs(self.bearing) <= 60.0)
        return self._where(claim, (self.near_m <= REACH_M) | ahead, "is not reached", since)

    def stopped_at(self, claim: Claim) -> str:
        """Return why the path does not stop at a thing, "" where it does."""
        return self._where(claim, self._at_end(claim), "is not at the end of the path")[1]

    def _at_end(self, claim: Claim) -> Mask:
        """Return (N, S) where things are at the end, as the claim says that they are."""
        last = np.zeros_like(self.open)
        reach_m = max(_STOP_M.get(claim.place, 0.0), _STOP_SIDED_M[claim.side])
        last[:, -2:] = self.near_m[:, -2:] <= reach_m
        bearing = np.abs(self.bearing)
        if claim.place == "past":
            last[:, -1] &= (bearing[:, -1] >= 60.0) & (self.distance[:, -1] <= reach_m)
            last[:, -2] = False
        elif claim.place == "before":
            last &= (bearing <= 112.0) | (self.near_m <= 0.6)
        elif not claim.side:
            last &= (bearing <= 140.0) | (self.near_m <= 1.4)
        return last

    def flank(self, claim: Claim, other: Claim, at_end: bool = False) -> bool:
        """Return whether the walker has two things on different sides, on the way or at the end."""
        sides = []
        for rows in (self.meant(claim), self.meant(other)):
            near = self.near_m[rows] <= BESIDE_M
            near[:, : -2 if at_end else 0] = False
            sides.append(np.where(near, self.facing[rows], np.nan))
        apart = np.abs((sides[0][:, None] - sides[1][None] + 180.0) % 360.0 - 180.0)
        return bool((apart >= _FLANKS_DEG).any())

    def stop_in_view(self, claim: Claim) -> Mask:
        """Return where a thing that the path stops at is in view."""
        rows = [n for n in self.meant(claim) if self._at_end(claim)[n].any()]
        view = self.seen[rows] & (self.distance[rows] <= SEE_M)
        return np.asarray((view & (np.abs(self.bearing[rows]) <= 125.0)).any(axis=0))

    def abeam_m(self, claim: Claim, since_m: float = 0.0) -> tuple[float, float] | None:
        """Return the first and last place [m] where what may be meant is passed, None if none."""
        chosen = [n for n in self.meant(claim) if self.near_m[n].min() <= PASS_M]
        if claim.side in ("left", "right"):
            chosen = [n for n in chosen if self.facts.landmarks[n].side in ("", claim.side)]
        least = min((self.near_m[n].min() for n in chosen), default=0.0)
        if least <= 0.1:  # none, a rug that is walked over, or a door that is gone through
            return None
        chosen = [n for n in chosen if self.near_m[n].min() < least + _CLEARLY_M]
        across = np.abs(np.abs(self.facing[chosen]) - 90.0) / 15.0 + self.near_m[chosen]
        places = self.along_m[np.argmin(across, axis=1)]
        if (later := places[places >= since_m - 1.0]).size:  # not what was passed before
            places = later
        return float(places.min()), float(places.max())

    def met_before_end(self, claim: Claim, since: int) -> bool:
        """Return whether a walker who stops at the first such thing stops in an earlier room."""
        chosen, room = self.meant(claim), self.facts.goal_room
        if not chosen or claim.ordinal:
            return False
        at = (self.near_m[chosen] <= _STOP_SIDED_M[""]) & self._own[chosen]
        at[:, :since] = False
        at[:, self.along_m > self.facts.visits[-1].from_m - 1.0] = False
        return bool(at.any()) and any(self.facts.landmarks[n].room != room for n in chosen)

    def _where(self, claim: Claim, mask: Mask, fault: str, since: int | None = None) -> Place:
        """Restrict a mask (N, S) to the things that a claim may mean.

        Args:
            since: the first place where the walker may be: what he meets first is meant.
        """
        nothing = np.zeros(len(self.along_m), dtype=bool)
        name = claim.name or "doorway"
        chosen = self.meant(claim)
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
        if since is not None and not claim.ordinal and claim.what == "thing":
            chosen = self._first_met(chosen, mask, since)
        here = mask[chosen]
        if not here.any():
            return nothing, f"the {name} {fault}"
        if claim.side in ("left", "right", "ahead", "behind"):
            here = here & self.sided(chosen, claim.side, here)
            if not here.any():
                return nothing, f"the {name} is not {spoken_side(claim.side)}"
        if claim.ordinal:
            here = here & self.ordinal(chosen, claim)[:, None]
            if not here.any():
                return nothing, f"that is not {name} number {claim.ordinal}"
        result = np.asarray(here.any(axis=0))
        if claim.count > 1 and claim.what != "door":
            result = result & self._counted(chosen, claim.count)
            if not result.any():
                return nothing, f"there are not {claim.count} of them ({name})"
        return result, ""

    def _first_met(self, chosen: list[int], mask: Mask, since: int) -> list[int]:
        """Return the things that are met first, of those in the walker's own room if any are."""
        here = mask[chosen].copy()
        here[:, :since] = False
        own = (here & self._own[chosen]).any(axis=1)
        rows = np.flatnonzero(own if own.any() else here.any(axis=1))
        if not len(rows):
            return chosen
        # Who could name one at hand does not mean one across the room.
        far_m = np.where(here[rows], self.distance[chosen][rows], np.inf).min(axis=1)
        rows = rows[far_m <= max(_AT_HAND_M, far_m.min() + 1.5)]
        first_m = self.along_m[here[rows].argmax(axis=1)]
        return [chosen[k] for k in rows[first_m <= first_m.min() + _ONE_PLACE_M]]

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

    def sided(self, chosen: list[int], side: str, where: Mask | None = None) -> Mask:
        """Return (N, S) where things are on a side; ahead of the walker is on neither.

        Unless they are never clearly on one at the places `where` (N, S).
        """
        bearing, facing = self.bearing[chosen], self.facing[chosen]
        if side == "ahead":
            return np.minimum(np.abs(facing), np.abs(bearing)) <= 50.0
        if side == "behind":
            return np.maximum(np.abs(facing), np.abs(bearing)) >= 105.0
        sign = 1 if side == "left" else -1
        low, high = _SIDE_DEG
        beside = (sign * bearing > low) & (sign * bearing < high)
        loose = beside | ((sign * facing > low) & (sign * facing < high) & (np.abs(bearing) <= low))
        if where is None:
            return loose
        clear = where & (np.abs(bearing) >= _CLEAR_SIDE_DEG) & (np.abs(bearing) <= 155.0)
        some = np.asarray(clear.any(axis=1, keepdims=True))
        return np.where(some, loose & clear, loose)

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
            through = self.near_m.min(axis=1) <= THROUGH_M
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

    def _counted(self, chosen: list[int], number: int) -> Mask:
        def around(reach_m: float) -> NDArray[np.int64]:
            rows = self.near_m[chosen] <= reach_m
            return np.sum([spread(row, self.along_m, 1.5) for row in rows], axis=0)

        return (around(1.2) <= number) & (number <= around(4.5))


def spread(mask: Mask, along_m: NDArray[np.float64], by_m: float) -> Mask:
    """Return the places within `by_m` of those in `mask`."""
    k = max(1, round(by_m / along_m[1]))
    return np.convolve(mask, np.ones(2 * k + 1), mode="same")[: len(mask)] > 0.5


def room_names(name: str) -> frozenset[str]:
    """Return the canonical rooms that a phrase may mean."""
    return frozenset(r for r in ROOM_PHRASES.get(name, ()) if name in room_answers(r))


def spoken_side(side: str) -> str:
    """Return a side in words."""
    return {"ahead": "ahead", "behind": "behind the walker"}.get(side, f"on the {side}")
