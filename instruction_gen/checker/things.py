"""Where along a path a claim about a thing is true."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..facts.doors import DOOR
from ..facts.geometry import MOMENT_M
from ..facts.records import LandmarkFact, PathFacts
from ..language.clauses import Noun
from ..language.lexicon import COLOUR_NEIGHBOURS, INNATE_COLOURS, OBJECT_PHRASES, ROOM_PHRASES
from ..language.nouns import called, room_answers

Mask = NDArray[np.bool_]

PASS_M = 2.8  # a thing this near is passed
REACH_M = 2.4  # one this near is reached, or stopped at
BESIDE_M = 3.5
AFTER_M = 3.0  # one stops after a thing that was passed this shortly before
SEE_M = 8.0
DOOR_M = 0.7  # along the path, around a passage
_SIDE_DEG = (8.0, 172.0)
_FACING_DEG = 60.0
_VISIBLE_PIXELS = 12
_COUNT_WINDOW_M = 1.6
_NEAREST_M = 0.2
_UNDERFOOT_M = 0.3
_TOGETHER_M = 3.0
_DOORSTEP_M = 0.5
_THROUGH_M = 0.25
_ALMOST_M = 3.4
VAGUE = 0.5  # strength where words are vague: `ahead` and `behind` are said of much


@dataclass(frozen=True)
class Found:
    """Where a claim holds.

    Attributes:
        mask: (S,) which places of the path.
        reason: why it holds nowhere, "" when it holds somewhere.
        strength: of that reason as a contradiction, see `align`.
        view: (S,) from which places the things meant are in view, and no others of their name;
            None where that is unknown.
    """

    mask: Mask
    reason: str = ""
    strength: float = 1.0
    view: Mask | None = None


class Things:
    """The things of one path as arrays over S places, a quarter of a metre apart."""

    def __init__(self, facts: PathFacts):
        """Spread the landmarks' moments over the path."""
        self.facts = facts
        self.length_m = facts.length_m
        samples = max(2, round(facts.length_m / MOMENT_M) + 1)
        self.along_m: NDArray[np.float64] = np.linspace(0.0, facts.length_m, samples).astype(float)
        shape = (len(facts.landmarks), len(self.along_m))
        self.distance = np.full(shape, np.inf)
        self.bearing = np.zeros(shape)
        self.facing = np.full(shape, 180.0)
        self.open = np.zeros(shape, dtype=bool)
        self.seen = np.zeros(shape, dtype=bool)
        for n, mark in enumerate(facts.landmarks):
            if not mark.moments:
                continue
            rows = np.array(
                [
                    (m.along_m, m.distance_m, m.bearing_deg, m.facing_deg, m.open, m.pixels)
                    for m in mark.moments
                ]
            )
            k = np.clip(np.rint(rows[:, 0] / self.along_m[1]), 0, shape[1] - 1).astype(int)
            self.distance[n, k], self.bearing[n, k] = rows[:, 1], rows[:, 2]
            self.facing[n, k], self.open[n, k] = rows[:, 3], rows[:, 4] > 0
            self.seen[n, k] = (rows[:, 4] > 0) | (rows[:, 5] >= _VISIBLE_PIXELS)

    # things -----------------------------------------------------------------------------------

    def passed(self, noun: Noun) -> Found:
        """Return where a thing is close by, on the side said."""
        beside = (np.abs(self.bearing) >= 38.0) & (np.abs(self.bearing) <= 145.0)
        beside |= self.distance <= _UNDERFOOT_M  # a rug that is walked over
        return self._where(noun, self._near(PASS_M) & beside & self._nearest(), "beside the path")

    def abeam(self, noun: Noun) -> float | None:
        """Return where the middle of a thing is passed [m]; None if it is one of several."""
        near = [n for n in self._called(noun.head) if self._is_beside(n)]
        if len(near) != 1:
            return None
        across = np.abs(np.abs(self.facing[near[0]]) - 90.0)
        across[~self._near(PASS_M)[near[0]]] = np.inf
        if across.min() > 35.0:
            return None
        return float(self.along_m[np.argmin(across / 15.0 + self.distance[near[0]])])

    def beside(self, noun: Noun) -> Found:
        """Return where a thing is abeam, or near and ahead, on the side said."""
        ahead = self._near(BESIDE_M) & (np.abs(self.bearing) < 60.0)
        abeam = (np.abs(self.bearing) >= 38.0) & (np.abs(self.bearing) <= 145.0)
        abeam &= self._near(PASS_M) & (self._nearest() | (self.distance <= 1.2))
        if noun.side in ("behind", "beside"):
            return self._where(noun, self._near(BESIDE_M), "beside the path")
        return self._where(noun, ahead | abeam, "beside the path")

    def reached(self, noun: Noun) -> Found:
        """Return where a thing is at hand."""
        return self._where(noun, self._near(REACH_M), "reached")

    def seen_at(self, noun: Noun) -> Found:
        """Return where a thing is in view, on the side said."""
        # "With the sofa on your left" is said of a sofa nearby.
        reach = BESIDE_M if noun.side and noun.prep == "with" else SEE_M
        mask = self.seen & (self.distance <= reach) & (np.abs(self.bearing) <= 115.0)
        return self._where(noun, mask | self._near(PASS_M), "in view")

    def headed_for(self, noun: Noun) -> Found:
        """Return where one walks towards a thing, or has come to it."""
        ahead = self.seen & (self.distance <= SEE_M) & (np.abs(self.facing) <= _FACING_DEG)
        closer = np.zeros_like(ahead)
        closer[:, :-2] = self.distance[:, 2:] < self.distance[:, :-2]
        return self._where(noun, (ahead & closer) | self._near(REACH_M), "walked towards")

    def stopped_at(self, noun: Noun) -> Found:
        """Return the end of the path, where a thing is at hand there on the side said."""
        mask = np.zeros_like(self.open)
        reach = REACH_M
        here = self.distance[:, -1]
        mask[:, -1] = (here <= reach) & (self.open[:, -1] | (here <= 0.8))
        # What lies well behind has been passed; it is not where one stops.
        mask[:, -1] &= (here <= 1.3) | (np.abs(self.bearing[:, -1]) <= 130.0)
        found = self._where(noun, mask, "at the end of the path")
        if found.reason and self._where(noun, mask | self._almost(), "").mask.any():
            return dataclasses.replace(found, strength=VAGUE)
        if found.reason or not found.mask.any():
            return found
        return dataclasses.replace(found, mask=self.at_goal())

    def _almost(self) -> Mask:
        """Return (N, S) which things one stops some steps away from."""
        mask = np.zeros_like(self.open)
        mask[:, -1] = (self.distance[:, -1] <= _ALMOST_M) & self.open[:, -1]
        return mask

    def stopped_after(self, noun: Noun) -> Found:
        """Return the end of the path, where a thing was passed shortly before."""
        found = self.passed(noun)
        at_m = self.abeam(noun)
        late = found.mask & self.at_goal(AFTER_M)
        if at_m is not None and at_m < self.length_m - AFTER_M:
            late = np.zeros_like(late)
        if found.reason or late.any():
            return dataclasses.replace(found, mask=self.at_goal() if late.any() else found.mask)
        return Found(late, f"the {noun.text} is not just before the end of the path")

    def at_goal(self, within_m: float = 2.2) -> Mask:
        """Return the last stretch."""
        return self.along_m >= self.length_m - within_m

    def _near(self, reach_m: float) -> Mask:
        return (self.distance <= reach_m) & (self.open | (self.distance <= 0.8))

    def _nearest(self) -> Mask:
        """Return where each thing is about as near as it gets within 1.5 m of walking."""
        window = max(1, round(1.5 / self.along_m[1]))
        hidden = np.where(self.open | (self.distance <= 0.8), self.distance, np.inf)
        padded = np.pad(hidden, ((0, 0), (window, window)), constant_values=np.inf)
        views = np.lib.stride_tricks.sliding_window_view(padded, 2 * window + 1, axis=1)
        return self.distance <= views.min(axis=2) + _NEAREST_M

    def _where(self, noun: Noun, mask: Mask, what: str) -> Found:
        """Restrict a mask (N, S) to the things that a noun phrase may mean."""
        nothing = np.zeros(len(self.along_m), dtype=bool)
        name = noun.text
        chosen = self._called(noun.head)
        if not chosen:
            known = any(called(n, noun.head) for n in self.facts.level_nouns)
            where = "on the route" if known else "in this scene"
            return Found(nothing, f"there is no {name} {where}")
        if noun.material:
            chosen = [n for n in chosen if self.facts.landmarks[n].material == noun.material]
            if not chosen:
                return Found(nothing, f"nothing says that the {name} is {noun.material}")
        if noun.colour:
            matching = [n for n in chosen if _coloured(self.facts.landmarks[n], noun.colour)]
            if not matching:
                return Found(nothing, f"nothing says that the {name} is {noun.colour}")
            chosen = matching
        here = mask[chosen]
        if not here.any():
            return Found(nothing, f"the {name} is never {what}")
        if noun.side:
            here = here & self._sided(chosen, noun.side)
            if not here.any():
                beside = noun.side in ("left", "right")
                where = f"on the {noun.side}" if beside else f"{noun.side} the walker"
                return Found(nothing, f"the {name} is not {where}", 1.0 if beside else VAGUE)
        if noun.ordinal:
            keep = self._ordinal(chosen, noun)
            here = here & keep[:, None]
            if not here.any():
                return Found(nothing, f"that is not {name} number {noun.ordinal}")
        if noun.only and sum(self._is_beside(n) for n in chosen) > 1:
            return Found(nothing, f"it is not the only {name}")
        result = np.asarray(here.any(axis=0))
        meant = {n for n, row in zip(chosen, here, strict=True) if row.any()}
        if noun.number > 1 or noun.plural:
            result = result & self._counted(chosen, noun.number)
            if not result.any():
                said = noun.number or "several"
                return Found(nothing, f"there are not {said} of them ({name})")
        return Found(result, view=self._unmistakable(meant, noun.head))

    def _unmistakable(self, meant: set[int], head: str) -> Mask | None:
        """Return from where things are in view, and no others that are called `head`.

        None where they stand too far apart to be one place.
        """
        places = [self.facts.landmarks[n].along_m for n in meant]
        if max(places) - min(places) > _TOGETHER_M:
            return None
        marks = enumerate(self.facts.landmarks)
        others = [n for n, m in marks if n not in meant and answers_to(m, head)]
        return np.asarray(self.seen[sorted(meant)].any(axis=0) & ~self.seen[others].any(axis=0))

    def _called(self, head: str) -> list[int]:
        """Return the things that `head` may mean.

        A compound that names no kind of thing is read by its parts: `kitchen table` is the table
        in the kitchen, `bath mat` a mat, if there is a bath as well.
        """
        marks = enumerate(self.facts.landmarks)
        first, _, kind = head.partition(" ")
        if not kind or head in OBJECT_PHRASES:
            found = [n for n, m in marks if answers_to(m, head)]
            return found or self._in_room(*head.rsplit(" ", 1)) if kind else found
        direct = [n for n, m in marks if answers_to(m, head)]
        if direct:
            return direct
        room, last = head.rsplit(" ", 1)
        if room_names(room):
            return self._in_room(room, last)
        known = first not in OBJECT_PHRASES or any(called(n, first) for n in self.facts.level_nouns)
        return self._called(kind) if known else []

    def _in_room(self, room: str, kind: str) -> list[int]:
        marks = enumerate(self.facts.landmarks)
        names = room_names(room)
        return [n for n, m in marks if m.room in names and answers_to(m, kind)]

    def _sided(self, chosen: list[int], side: str) -> Mask:
        if side == "ahead":
            return np.minimum(np.abs(self.facing[chosen]), np.abs(self.bearing[chosen])) <= 50.0
        if side == "behind":
            return np.abs(self.facing[chosen]) >= 80.0
        if side == "beside":
            return self.distance[chosen] <= 1.8
        bearing = self.bearing[chosen] * (1 if side == "left" else -1)
        facing = self.facing[chosen] * (1 if side == "left" else -1)
        low, high = _SIDE_DEG
        return ((bearing > low) & (bearing < high)) | (
            (facing > low) & (facing < high) & (np.abs(bearing) <= low)
        )

    def _is_beside(self, n: int) -> bool:
        return bool(self._near(PASS_M)[n].any())

    def _ordinal(self, chosen: list[int], noun: Noun) -> Mask:
        """Return which of the chosen things have that ordinal, from the start or in their room."""
        beside = [n for n in chosen if self._is_beside(n)]
        if noun.kind == "door" and noun.side:
            # Where it is passed; the door that one goes through may be said to be on either side.
            here = [self.facts.landmarks[n] for n in beside]
            through = [m.distance_m <= _THROUGH_M for m in here]
            beside = [
                n for n, m, t in zip(beside, here, through, strict=True) if t or m.side == noun.side
            ]
        beside.sort(key=lambda n: self.facts.landmarks[n].along_m)
        right = self._in_place(beside, noun)
        if noun.kind != "door" and noun.side:
            # "The second table on your left" may be the second of all, or of those on the left.
            sided = self._sided(beside, noun.side) & self._near(PASS_M)[beside]
            there = [n for n, row in zip(beside, sided, strict=True) if row.any()]
            right |= self._in_place(there, noun)
        return np.array([n in right for n in chosen], dtype=bool)

    def _in_place(self, beside: list[int], noun: Noun) -> set[int]:
        """Return which of some things, in the order of the path, have the ordinal of a phrase."""
        right = set(beside[noun.ordinal - 1 : noun.ordinal])
        for visit in self.facts.visits:
            inside = [
                n
                for n in beside
                if visit.from_m - 0.2 <= self.facts.landmarks[n].along_m <= visit.to_m + 0.2
            ]
            right |= set(inside[noun.ordinal - 1 : noun.ordinal])
            # Doors are counted from that of coming in, which is none of them, to that of going out.
            low_m = visit.from_m + _DOORSTEP_M
            onward = [
                n
                for n in beside
                if low_m <= self.facts.landmarks[n].along_m <= visit.to_m + _DOORSTEP_M
            ]
            if noun.kind == "door":
                right |= set(onward[noun.ordinal - 1 : noun.ordinal])
        return right

    def _counted(self, chosen: list[int], number: int) -> Mask:
        """Return where as many things are around as said; several, where no number is."""

        def around(reach_m: float) -> NDArray[np.int64]:
            near = (self._near(reach_m) | (self.seen & (self.distance <= reach_m)))[chosen]
            return np.sum([spread(row, self.along_m, _COUNT_WINDOW_M) for row in near], axis=0)

        low, high = around(1.2), around(4.0)
        return (high >= 2) if not number else (low <= number) & (number <= high)


def spread(mask: Mask, along_m: NDArray[np.float64], by_m: float) -> Mask:
    """Return the places within `by_m` of those in `mask`."""
    k = max(1, round(by_m / along_m[1]))
    at, total = np.arange(len(mask)), np.cumsum(mask)
    before = np.where(at > k, total[np.maximum(at - k - 1, 0)], 0)
    return np.asarray(total[np.minimum(at + k, len(mask) - 1)] > before)


def answers_to(mark: LandmarkFact, head: str) -> bool:
    """Return whether a landmark may be called `head`."""
    if mark.noun == DOOR:
        return head in (DOOR, "door")
    return called(mark.noun, head)


def room_names(head: str) -> frozenset[str]:
    """Return the canonical rooms that `head` may mean."""
    direct = {room for room in ROOM_PHRASES.get(head, ()) if head in room_answers(room)}
    return frozenset(direct)


def replace_side(noun: Noun, side: str) -> Noun:
    """Return the same phrase on another side."""
    return dataclasses.replace(noun, side=side)


def replace_head(noun: Noun, head: str) -> Noun:
    """Return the same phrase about another kind of thing."""
    return Noun(
        noun.text, noun.kind, head, noun.plural, noun.number, noun.ordinal, "", "", noun.only,
        noun.side, noun.prep, noun.part, noun.start, noun.stop,
    )  # fmt: skip


def _coloured(mark: LandmarkFact, colour: str) -> bool:
    has = {mark.colour, INNATE_COLOURS.get(mark.noun, "")} - {""}
    return any(colour == own or colour in COLOUR_NEIGHBOURS.get(own, ()) for own in has)
