"""Where along a path a claim about a room or a door is true."""

from dataclasses import replace

import numpy as np

from ..facts.doors import DOOR
from ..facts.records import PassageFact
from ..language.clauses import Noun
from .things import (
    DOOR_M,
    REACH_M,
    VAGUE,
    Found,
    Mask,
    Things,
    replace_head,
    replace_side,
    room_names,
    spread,
)

_INTO_M = 1.5  # who starts on a threshold comes into the room until then
_BEFORE_DOORS_M, _DOORS_M, _APART_DEG = 1.5, 6.0, 15.0

__all__ = ["Found", "Ground", "Mask", "room_names", "spread"]


class Ground(Things):
    """The facts of one path: its things, rooms and doors."""

    @property
    def passages_m(self) -> list[float]:
        """Where along the path rooms are changed [m], with the threshold that it stops on."""
        ends = [self.length_m] if self.facts.goal_rooms else []
        return [*(p.along_m for p in self.facts.passages), *ends]

    # rooms ------------------------------------------------------------------------------------

    def entered(self, noun: Noun) -> Found:
        """Return where a room is entered."""
        edges = self._thresholds(noun)
        if edges is not None:
            return edges
        return self._rooms(noun, lambda v: self._around(v.from_m) if v.from_m > 0 else None)

    def left(self, noun: Noun) -> Found:
        """Return where a room is left, on the side said."""
        end = self.length_m
        if noun.side:
            sided = [p for p in self.facts.passages if self._door_side(p.along_m, noun.side)]
            near = [self._around(p.along_m) for p in sided]
            found = self.left(replace_side(noun, ""))
            mask = found.mask & np.any(near, axis=0) if near else np.zeros_like(found.mask)
            if not found.reason and not mask.any():
                return Found(mask, f"the {noun.text} is not left on the {noun.side}")
            return Found(mask, found.reason)
        found = self._rooms(noun, lambda v: self._around(v.to_m) if v.to_m < end - 0.05 else None)
        inside = self.facts.visits[0].room in room_names(noun.head)
        if not inside and self._is_in(noun, self.facts.start_rooms):
            return Found(found.mask | self._around(0.0))
        return found

    def _thresholds(self, noun: Noun) -> Found | None:
        """Return where a room is entered at the very start or end of the path.

        None where it is not.
        """
        names = room_names(noun.head)
        visits = self.facts.visits
        start = visits[0].room in names and bool(self.facts.start_rooms)
        end = visits[-1].room not in names and self._is_in(noun, self.facts.goal_rooms)
        if not start and not end:
            return None
        masks = [self._around(v.from_m) for v in visits if v.room in names and v.from_m > 0]
        masks += [self._between(0.0, _INTO_M)] * start + [self.at_goal(1.2)] * end
        return Found(np.any(masks, axis=0))

    @staticmethod
    def _is_in(noun: Noun, rooms: tuple[str, ...]) -> bool:
        return bool(room_names(noun.head) & set(rooms))

    def inside(self, noun: Noun) -> Found:
        """Return where one is in a room."""
        return self._rooms(noun, lambda v: self._between(v.from_m - 0.4, v.to_m + 0.4))

    def room_ahead(self, noun: Noun) -> Found:
        """Return where a room lies ahead, or is entered."""
        return self._rooms(noun, lambda v: self._between(v.from_m - 7.0, v.from_m + 1.0))

    def room_end(self, noun: Noun) -> Found:
        """Return the far end of a room, as it is walked."""
        return self._rooms(noun, lambda v: self._between(max(v.from_m, v.to_m - 2.5), v.to_m + 0.6))

    def room_in_view(self, noun: Noun) -> Found:
        """Return everywhere for a room of the level: a doorway may show it."""
        if room_names(noun.head) & {*self.facts.level_rooms, *(v.room for v in self.facts.visits)}:
            return Found(np.ones(len(self.along_m), dtype=bool))
        return Found(np.zeros(len(self.along_m), dtype=bool), f"the {noun.text} is never in view")

    def room_behind_opening(self, noun: Noun) -> Found:
        """Return where one is in a room with an opening to the one said, entered or not."""
        names = room_names(noun.head)
        visits = [v for v in self.facts.visits if names & set(v.beyond)]
        if not visits:
            nothing = np.zeros(len(self.along_m), dtype=bool)
            return Found(nothing, f"the path does not come by the {noun.text}")
        return Found(np.any([self._between(v.from_m, v.to_m) for v in visits], axis=0))

    def stopped_in(self, noun: Noun) -> Found:
        """Return the end of the path, if that is in the room."""
        nothing = np.zeros(len(self.along_m), dtype=bool)
        if self._is_in(noun, (self.facts.goal_room, *self.facts.goal_rooms)):
            return Found(self.at_goal())
        return Found(nothing, f"the path does not end in the {noun.text}")

    def stopped_before(self, noun: Noun) -> Found:
        """Return the end of the path, if that is close to a way into the room."""
        entered = self.entered(noun).mask & self.at_goal(2.6)
        if entered.any() or self._is_in(noun, self.facts.goal_near_rooms):
            return Found(self.at_goal())
        return self.stopped_in(noun)

    def _rooms(self, noun: Noun, place) -> Found:
        nothing = np.zeros(len(self.along_m), dtype=bool)
        names = room_names(noun.head)
        visits = [v for v in self.facts.visits if v.room in names]
        if not visits:
            return Found(nothing, f"the path does not visit the {noun.text}")
        masks = [mask for v in visits if (mask := place(v)) is not None]
        if not masks:
            return Found(nothing, f"the {noun.text} is not entered or left so")
        return Found(np.any(masks, axis=0))

    # doors ------------------------------------------------------------------------------------

    def through_door(self, noun: Noun) -> Found:
        """Return where the path passes from one room into another."""
        nothing = np.zeros(len(self.along_m), dtype=bool)
        passages = list(self.facts.passages)
        if noun.side not in ("", "left", "right"):
            noun = replace_side(noun, "")  # what one goes through is ahead of one anyway
        if noun.side:
            passages = [p for p in passages if self._door_side(p.along_m, noun.side)]
            ends = bool(self.facts.goal_rooms) and self._door_side(self.length_m, noun.side)
            if not passages and self.facts.passages and not ends:
                reason = f"no doorway that is walked through is on the {noun.side}"
                return Found(nothing, reason, VAGUE)
        masks = [self._around(p.along_m) for p in passages]
        # A doorway inside of what the map calls one room.
        near = [n for n, m in enumerate(self.facts.landmarks) if m.noun == DOOR]
        masks += [self.distance[n] <= 0.5 for n in near if not noun.side]
        if self.facts.goal_rooms and (not noun.side or self._door_side(self.length_m, noun.side)):
            masks.append(self.at_goal(1.0))
        result = np.any(masks, axis=0) if masks else nothing
        if not result.any():
            return Found(nothing, "the path goes through no doorway")
        if noun.ordinal:
            there = result & self._numbered(noun, noun.ordinal)
            if not there.any():
                # People begin to count at the door that they came by, or at the one after it.
                others = [self._numbered(noun, noun.ordinal + k) for k in (-1, 1)]
                strength = VAGUE if (result & np.any(others, axis=0)).any() else 1.0
                return Found(nothing, f"that is not doorway number {noun.ordinal}", strength)
            result = there
        return Found(result)

    def _numbered(self, noun: Noun, number: int) -> Mask:
        """Return where doorways are of a number, on the side of `noun` if it has one."""
        marks = self.facts.landmarks
        doors = [n for n, m in enumerate(marks) if m.noun == DOOR]
        keep = self._ordinal(doors, replace(noun, ordinal=max(number, 1)))
        at_m = [marks[n].along_m for n, kept in zip(doors, keep, strict=True) if kept]
        near = [np.abs(self.along_m - m) <= DOOR_M for m in at_m]
        return np.any([np.zeros(len(self.along_m), dtype=bool), *near], axis=0)

    def door_near(self, noun: Noun, reach_m: float = REACH_M) -> Found:
        """Return where a doorway is at hand."""
        return self._where(replace_head(noun, DOOR), self._near(reach_m), "beside the path")

    def stopped_at_door(self, reach_m: float = 2.0) -> Found:
        """Return the end of the path, if a doorway is there."""
        near = [n for n, m in enumerate(self.facts.landmarks) if m.noun == DOOR]
        if any(self.distance[n, -1] <= reach_m for n in near):
            return Found(self.at_goal())
        if any(self.length_m - p.along_m <= reach_m for p in self.facts.passages):
            return Found(self.at_goal())
        nothing = np.zeros(len(self.along_m), dtype=bool)
        return Found(nothing, "no doorway is at the end of the path")

    def _door_side(self, along_m: float, side: str) -> bool:
        sign = 1 if side == "left" else -1
        for p in self.facts.passages:
            if abs(p.along_m - along_m) >= 0.05:
                continue
            if sign * p.bearing_deg > 10.0 or self._beside_another(p, sign):
                return True
        return any(
            abs(t.along_m - along_m) <= 1.5 and sign * t.angle_deg > 15.0 for t in self.facts.turns
        )

    def _beside_another(self, passage: PassageFact, sign: int) -> bool:
        """Return whether a doorway is the left (sign 1) or right (−1) one of two that lie ahead."""
        k = int(np.searchsorted(self.along_m, max(0.0, passage.along_m - _BEFORE_DOORS_M)))
        return any(
            mark.noun == DOOR
            and self.open[n, k]
            and self.distance[n, k] <= _DOORS_M
            and sign * (passage.bearing_deg - self.bearing[n, k]) > _APART_DEG
            for n, mark in enumerate(self.facts.landmarks)
        )

    def _around(self, along_m: float) -> Mask:
        return self._between(along_m - DOOR_M, along_m + DOOR_M)

    def _between(self, low_m: float, high_m: float) -> Mask:
        return (self.along_m >= low_m - 0.13) & (self.along_m <= high_m + 0.13)
