"""Put flights and landings together to staircases: boxes with true edges, and a middle line."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...formats.core.arrays import Array
from ...formats.scene.staircase import Staircase, Treads
from .flights import Flight, measure_flight
from .levels import ScannedFloor
from .surfaces import Surfaces
from .treads import ScannedTread, ways_up

# A tread with more than this many times the usual area is a landing.
LANDING_AREAS = 1.7
# Fewer risers than this make a step, not a flight.
LEAST_RISERS = 3
# The middle line begins and ends this far from the first and the last riser.
LINE_END_M = 0.45
# The upper floor's edge is a box this long.
EDGE_M = 0.3
# Boxes reach this far below the lower of their neighbours' upper faces, so that nothing passes
# between them.
OVERLAP_M = 0.05
# The middle line keeps this far from a landing's edges where it turns, if it can.
TURN_M = 0.62
# A landing's samples cover this share of a rectangle.
FULL_SHARE = 0.75
# Treads higher than this over others are another storey of stairs.
OVER_M = 1.0
# Corners of the middle line that are nearer to each other are one.
CORNER_M = 0.3


@dataclass(frozen=True)
class ScannedStaircase:
    """A staircase, its flights in order of walking up, and its boxes; none if it has a problem."""

    staircase: Staircase
    flights: tuple[Flight, ...]
    treads: Treads | None


def find_staircases(surfaces: Surfaces, floors: list[ScannedFloor]) -> list[ScannedStaircase]:
    """Return all staircases between neighbouring levels that have a flight."""
    return [
        staircase
        for k, (lower, upper) in enumerate(pairwise(floors))
        for treads in ways_up(surfaces, lower, upper)
        if (staircase := _staircase(treads, (k, k + 1), lower.grid.cell_m))
    ]


def _staircase(
    treads: Sequence[ScannedTread], levels: tuple[int, int], cell_m: float
) -> ScannedStaircase | None:
    """Divide a staircase by its landings, and measure it."""
    sizes = np.array([len(t.open_m) for t in treads], dtype=np.float64)
    usual = np.median(sizes[1:-1]) if len(treads) > 2 else 0.0
    at = np.flatnonzero(sizes > LANDING_AREAS * usual)
    runs = list(pairwise(np.unique([0, *at, len(treads) - 1]).tolist()))
    flights = [
        measure_flight(treads[first : last + 1], levels, cell_m)
        for first, last in runs
        if last - first >= LEAST_RISERS
    ]
    if not flights:
        return None
    landings = [
        _landing(treads[k], lower, upper, cell_m)
        for k, (lower, upper) in zip(at.tolist(), pairwise(flights), strict=False)
    ]
    problem = next((f.problem for f in flights if f.problem), "")
    if not problem and len(flights) < len(runs):
        first, last = min(runs, key=lambda run: run[1] - run[0])
        count = last - first
        problem = f"has a flight of {count} riser{'s' * (count > 1)}; valid: {LEAST_RISERS} or more"
    if not problem:
        problem = next((landing.problem for landing in landings if landing.problem), "")
    boxes = None
    if not problem:
        boxes = _boxes(flights, landings)
        if _passes_over_itself(boxes):
            problem, boxes = "passes over itself between two levels", None
    staircase = Staircase(
        levels=levels,
        line_world_m=_line(flights, landings),
        width_m=min(f.width_m for f in flights),
        riser_m=max(float(f.risers_m.max()) for f in flights),
        going_m=min(f.going_m for f in flights),
        problem=problem,
    )
    return ScannedStaircase(staircase, tuple(flights), boxes)


@dataclass(frozen=True)
class _Landing:
    """A landing as a rectangle along the flight that leads to it.

    `corners_xy_m` (N, 2) are of the middle line across it; `problem` says why it is none.
    """

    box: Treads
    corners_xy_m: Array
    problem: str


def _landing(tread: ScannedTread, lower: Flight, upper: Flight, cell_m: float) -> _Landing:
    """Fit a rectangle that reaches to the flights before and behind it."""
    axes = np.stack([lower.ahead, [-lower.ahead[1], lower.ahead[0]]])
    own = tread.points_m[:, :2] @ axes.T
    low, high = own.min(axis=0) - cell_m / 2, own.max(axis=0) + cell_m / 2
    # Its edges are the flights' risers, whatever was scanned there.
    low[0] = lower.head_world_m[:2] @ axes[0]
    foot = np.array([upper.foot_world_m[:2] + s * _left(upper) for s in _reach(upper)]) @ axes.T
    head = np.array([lower.head_world_m[:2] + s * _left(lower) for s in _reach(lower)]) @ axes.T
    low = np.minimum(low, np.minimum(foot.min(axis=0), head.min(axis=0)))
    high = np.maximum(high, np.maximum(foot.max(axis=0), head.max(axis=0)))
    inside = np.all((own >= low - cell_m) & (own <= high + cell_m), axis=1)
    share = inside.sum() * cell_m**2 / np.prod(high - low)
    half = (high - low) / 2
    bottom = lower.risers_m[-1] + OVERLAP_M
    box = Treads(
        np.array([[*((low + high) / 2 @ axes), tread.z_m - bottom / 2]]),
        np.array([[*half, bottom / 2]]),
        np.array([np.arctan2(*lower.ahead[::-1])]),
    )
    # Straight on from the flight below, then straight to the one above.
    depth = np.abs(axes @ upper.ahead) @ half
    corners = np.array(
        [
            lower.head_world_m[:2] + half[0] * lower.ahead,
            upper.foot_world_m[:2] - depth * upper.ahead,
        ]
    )
    # A robot that turns there needs room around it.
    middle, room = (low + high) / 2, np.maximum(half - TURN_M, 0.0)
    corners = np.clip(corners @ axes.T, middle - room, middle + room) @ axes
    if np.linalg.norm(corners[1] - corners[0]) < CORNER_M:
        corners = corners.mean(axis=0, keepdims=True)
    problem = "" if share >= FULL_SHARE else "has a landing that is no rectangle"
    return _Landing(box, corners, problem)


def _left(flight: Flight) -> Array:
    return np.array([-flight.ahead[1], flight.ahead[0]])


def _reach(flight: Flight) -> tuple[float, float]:
    right, left = flight.sides_m
    return -right, left


def _boxes(flights: Sequence[Flight], landings: Sequence[_Landing]) -> Treads:
    """Return the boxes of all treads and landings, and of the upper floor's edge."""
    parts = []
    for k, flight in enumerate(flights):
        parts.append(_steps(flight))
        parts += [landing.box for landing in landings[k : k + 1]]
    last = flights[-1]
    return Treads.joined([*parts, _row(last, [len(last.risers_m) - 1], EDGE_M)])


def _steps(flight: Flight) -> Treads:
    return _row(flight, range(len(flight.risers_m) - 1), flight.going_m)


def _row(flight: Flight, risers: Sequence[int], length_m: float) -> Treads:
    """Return boxes of a length behind some risers of a flight."""
    k = np.asarray(risers)
    right, left = flight.sides_m
    along = k * flight.going_m + length_m / 2
    xy = (
        flight.foot_world_m[:2] + along[:, None] * flight.ahead + (left - right) / 2 * _left(flight)
    )
    top = flight.foot_world_m[2] + np.cumsum(flight.risers_m)[k]
    height = flight.risers_m[k] + OVERLAP_M
    half = np.array([length_m / 2, (left + right) / 2])
    return Treads(
        np.column_stack([xy, top - height / 2]),
        np.column_stack([np.tile(half, (len(k), 1)), height / 2]),
        np.full(len(k), np.radians(flight.direction_world_deg)),
    )


def _passes_over_itself(boxes: Treads) -> bool:
    """Return whether a tread lies over another, by more than the next ones overlap."""
    top = boxes.top_m
    return bool((boxes.holds(boxes.center_m[:, :2]) & (np.abs(top - top[:, None]) > OVER_M)).any())


def _line(flights: Sequence[Flight], landings: Sequence[_Landing]) -> Array:
    """Return the middle line (K, 3) going up, from floor to floor."""
    first, last = flights[0], flights[-1]
    line = [first.foot_world_m - LINE_END_M * np.array([*first.ahead, 0.0])]
    for k, flight in enumerate(flights):
        line += [flight.foot_world_m, flight.head_world_m]
        for landing in landings[k : k + 1]:
            z = flight.head_world_m[2]
            line += [np.array([*xy, z]) for xy in landing.corners_xy_m]
    line.append(last.head_world_m + LINE_END_M * np.array([*last.ahead, 0.0]))
    return np.array(line)
