"""Doorways, passages, the front door and windows of a floor plan."""

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from ..config import ApartmentConfig
from .partition.apartment import Cell
from .plan import SIDES, Block, Opening, Room

_DOOR_MARGIN_M = 0.22
# A passage leaves this much wall at its ends, and is at most so wide.
_PASSAGE_MARGIN_M, _WIDEST_PASSAGE_M = 0.1, 3.0
_PASSAGES = ({"hallway"}, {"hallway", "stairwell"}, {"hallway", "office"})
_PUBLIC = {"hallway": 0, "living room": 1, "office": 1, "kitchen": 2, "dining room": 3}
_PRIVATE = {"bathroom", "bedroom", "study", "children's room"}
_PRIVATE |= {"meeting room", "storeroom", "stairwell"}

Span = tuple[float, float]


def contact(a: Cell, b: Cell) -> tuple[int, int, float, float] | None:
    """Return the common wall of two cells seen from `a`: (axis, sign, start, end), or None."""
    low = np.array([a[1:3], b[1:3]])
    high = np.array([a[3:5], b[3:5]])
    for axis, sign in SIDES:
        side_a = high[0, axis] if sign > 0 else low[0, axis]
        side_b = low[1, axis] if sign > 0 else high[1, axis]
        start = max(low[0, 1 - axis], low[1, 1 - axis])
        end = min(high[0, 1 - axis], high[1, 1 - axis])
        if abs(side_a - side_b) < 1e-6 and end - start > 1e-6:
            return axis, sign, float(start), float(end)
    return None


class Openings:
    """Draws the openings of one storey.

    Args:
        blocks: stairs and voids; no opening leads into them.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        rooms: Sequence[Room],
        config: ApartmentConfig,
        blocks: Sequence[Block] = (),
    ):
        self._rng, self._rooms, self._config, self._blocks = rng, rooms, config, blocks
        self._contacts = self._find_contacts()

    def _find_contacts(self) -> dict[tuple[int, int], tuple[int, int, float, float]]:
        half, pairs = self._config.wall_m / 2, {}
        cells: list[Cell] = [
            ("", r.lower_m[0] - half, r.lower_m[1] - half, r.upper_m[0] + half, r.upper_m[1] + half)
            for r in self._rooms
        ]
        for i, j in permutations(range(len(cells)), 2):
            if common := contact(cells[i], cells[j]):
                axis, sign, start, end = common
                pairs[i, j] = (axis, sign, start + half, end - half)
        return pairs

    def _blocked(self, room: int, axis: int, sign: int) -> list[Span]:
        """Return the stretches of a room's side that stairs or a void lie against."""
        face = self._rooms[room].wall_at(axis, sign)
        spans = []
        for block in (b for b in self._blocks if b.room == room and b.kind != "column"):
            rect = block.rect()
            if abs(rect[int(sign > 0), axis] - face) < 0.3:
                spans.append((float(rect[0, 1 - axis]), float(rect[1, 1 - axis])))
        return spans

    def _usable(self, pair: tuple[int, int]) -> tuple[int, int, float, float]:
        """Return the contact of two rooms, cut down to its longest stretch that nothing blocks."""
        axis, sign, start, end = self._contacts[pair]
        kinds = {self._rooms[k].kind for k in pair}
        if kinds == {"hallway", "stairwell"}:
            return axis, sign, start, end
        occupied = self._blocked(pair[0], axis, sign) + self._blocked(pair[1], axis, -sign)
        spans = _gaps(start, end, occupied)
        return (axis, sign, *max(spans, key=lambda s: s[1] - s[0], default=(start, start)))

    def doors(self) -> list[Opening] | None:
        """Return a spanning tree of doorways through public rooms, plus some loops, if possible."""
        rng, rooms, config = self._rng, self._rooms, self._config
        need = config.door_width_m[1] + 2 * _DOOR_MARGIN_M
        contacts = {pair: self._usable(pair) for pair in self._contacts}
        usable = {(i, j): c for (i, j), c in contacts.items() if i < j and c[3] - c[2] >= need}
        doors: list[Opening] = []
        pairs = self._joined(usable)
        if pairs is None:
            return None
        for i, j in pairs:
            axis, sign, start, end = usable[i, j]
            if {rooms[i].kind, rooms[j].kind} in _PASSAGES:
                spare = end - start - 2 * _PASSAGE_MARGIN_M
                width = min(spare, _WIDEST_PASSAGE_M)
                first = start + _PASSAGE_MARGIN_M + 0.5 * (spare - width)
                doors += self._pair("passage", (i, j), (axis, sign), (first, first + width))
                continue
            width = float(rng.uniform(*config.door_width_m))
            room_left = end - start - width - 2 * _DOOR_MARGIN_M
            # Doors near a corner leave whole walls for furniture.
            where = float(np.clip(rng.choice([0.08, 0.5, 0.92]) + rng.normal(0, 0.06), 0, 1))
            first = start + _DOOR_MARGIN_M + where * room_left
            doors += self._pair("door", (i, j), (axis, sign), (first, first + width))
        return doors

    def _pair(
        self, kind: str, rooms: tuple[int, int], side: tuple[int, int], span: Span
    ) -> list[Opening]:
        """Return the opening between two rooms, as either room sees it."""
        (i, j), (axis, sign) = rooms, side
        hole = (*span, 0.0, self._config.door_height_m)
        return [
            Opening(kind, i, axis, sign, *hole, other_room=j),
            Opening(kind, j, axis, -sign, *hole, other_room=i),
        ]

    def _joined(
        self, usable: dict[tuple[int, int], tuple[int, int, float, float]]
    ) -> list[tuple[int, int]] | None:
        """Return pairs of rooms to join so that all are reached, public rooms first."""
        rng, rooms = self._rng, self._rooms

        def cost(pair: tuple[int, int]) -> float:
            ranks = sorted(_PUBLIC.get(rooms[k].kind, 6) for k in pair)
            return ranks[0] * 10 + ranks[1]

        group = list(range(len(rooms)))
        pairs: list[tuple[int, int]] = []
        for i, j in sorted(usable, key=cost):
            kinds = {rooms[i].kind, rooms[j].kind}
            private = kinds <= _PRIVATE
            joined = kinds == {"kitchen", "living room"} or kinds in _PASSAGES
            loop = not private and "bathroom" not in kinds
            if group[i] != group[j] or joined or (loop and rng.random() < 0.3):
                # Private rooms are not entered through a bathroom or over the stairs.
                closed = "bathroom" in kinds or "stairwell" in kinds
                if private and group[i] != group[j] and closed:
                    continue
                if "stairwell" in kinds and kinds != {"hallway", "stairwell"}:
                    continue
                pairs.append((i, j))
                old = group[j]
                group = [group[i] if g == old else g for g in group]
        return pairs if len(set(group)) == 1 else None

    def _free_spans(
        self, room: int, axis: int, sign: int, openings: Sequence[Opening]
    ) -> list[Span]:
        """Return the stretches of a room's side that face the outside and hold no opening."""
        wall_m = self._config.wall_m
        occupied = [
            (c[2] - wall_m, c[3] + wall_m)
            for (i, _), c in self._contacts.items()
            if i == room and (c[0], c[1]) == (axis, sign)
        ]
        occupied += [
            (o.start_m, o.end_m) for o in openings if (o.room, o.axis, o.sign) == (room, axis, sign)
        ]
        occupied += self._blocked(room, axis, sign)
        return _gaps(*self._rooms[room].span(axis), occupied, 0.5)

    def entry(self, doors: Sequence[Opening]) -> list[Opening]:
        """Return the closed front door, in a hallway or living room; none without an outer wall."""
        rng = self._rng
        for kind in ("hallway", "living room", "office"):
            for index in (k for k, room in enumerate(self._rooms) if room.kind == kind):
                sides = [
                    (axis, sign, span)
                    for axis, sign in SIDES
                    for span in self._free_spans(index, axis, sign, doors)
                    if span[1] - span[0] > 1.3
                ]
                if sides:
                    axis, sign, (start, end) = sides[rng.integers(len(sides))]
                    first = float(rng.uniform(start + 0.2, end - 1.15))
                    return [Opening("entry", index, axis, sign, first, first + 0.95, 0.0, 2.08)]
        return []

    def windows(self, openings: Sequence[Opening], ceiling_m: float) -> list[Opening]:
        """Return windows on outer walls: small and high in bathrooms, some low in living rooms."""
        rng = self._rng
        windows: list[Opening] = []
        for index, room in enumerate(self._rooms):
            for axis, sign in SIDES:
                for start, end in self._free_spans(index, axis, sign, openings):
                    length = end - start
                    if length < 1.3 or (room.kind != "living room" and rng.random() < 0.2):
                        continue
                    bottom, top = float(rng.uniform(0.75, 0.95)), float(rng.uniform(2.1, 2.25))
                    width = float(min(rng.uniform(1.1, 1.9), length - 0.5))
                    if room.kind == "bathroom":
                        bottom, width = 1.3, min(width, 0.9)
                    elif room.kind == "kitchen":
                        bottom = 1.12
                    elif room.kind == "living room":
                        width = float(min(rng.uniform(1.6, 2.4), length - 0.5))
                        bottom = float(rng.choice([0.35, bottom]))
                    count = 2 if length > 2.6 * width and length > 4.2 else 1
                    if length > 9.0:
                        count = round(length / 4.0)
                    for k in range(count):
                        middle = start + length * (k + 0.5) / count
                        spare = max(length / count - width - 0.5, 0)
                        middle += float(rng.uniform(-0.5, 0.5)) * spare
                        span = middle - width / 2, middle + width / 2
                        height = bottom, min(top, ceiling_m - 0.2)
                        windows.append(Opening("window", index, axis, sign, *span, *height))
        return windows


def _gaps(start: float, end: float, occupied: list[Span], least_m: float = 0.0) -> list[Span]:
    """Return the stretches of start … end longer than `least_m` that no occupied span covers."""
    spans, at = [], start
    for low, high in sorted(occupied):
        if low - at > least_m:
            spans.append((at, min(low, end)))
        at = max(at, high)
    if end - at > least_m:
        spans.append((at, end))
    return spans
