"""Where the flights and the landing of a staircase lie: straight, L- or U-shaped.

Coordinates of the stairs: u from their front, where they rise, and v from their open side to the
wall along them.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..config import StairsConfig

FLIGHT_M, SPINE_M = 0.95, 0.1
# Where stairs end inside a room, this much floor is left before them; a gallery is as wide.
BEFORE_M = 1.3
# The first riser stands this far behind the opening to the corridor. An L begins in a corner, where
# a walker must be past the opening's side before it lines up.
SETBACK_M = {"U": 0.15, "L": BEFORE_M}
# The first flight of an L has so many treads at least.
_FIRST_TREADS = 5
_RISER_M = (0.15, 0.19)
_LEAST_RISERS = 3

Span = tuple[float, float]


@dataclass(frozen=True)
class Flight:
    """A flight of stairs.

    Attributes:
        axis, sign: it rises along u (0) or v (1), towards higher (1) or lower (−1) values.
        foot_m: the value of that coordinate at its first riser.
        across_m: its extent along the other coordinate.
        risers: how many it has; the last one leads onto the landing or the upper floor.
        before: risers of the flights below it.
        open_m: the one of `across_m` at which it has a banister; None = between walls.
    """

    axis: int
    sign: int
    foot_m: float
    across_m: Span
    risers: int
    before: int = 0
    open_m: float | None = None

    def lane_m(self) -> float:
        """Return where one walks on it, on the coordinate across."""
        low, high = self.across_m
        aside = 0.0 if self.open_m is None else 0.05 * (1 if self.open_m == low else -1)
        return (low + high) / 2 + aside


@dataclass(frozen=True)
class Stairs:
    """The plan of a staircase.

    Attributes:
        shape: `straight`, `L` or `U`.
        riser_m, tread_m: height and depth of a step.
        size_m: extents along u and v.
        flights: lowest first.
        landing_m: extents of the landing along u and v; None = there is none.
        rails_m: how far the railing around the opening above reaches along v at the front, and
            along u at the open side.
        wall_sign: side of the wall along them, on the world's axis across u.
    """

    shape: str
    riser_m: float
    tread_m: float
    size_m: Span
    flights: tuple[Flight, ...]
    landing_m: tuple[Span, Span] | None
    rails_m: Span
    wall_sign: int = -1

    def run_m(self, flight: Flight) -> float:
        """Return the length of one of the flights."""
        return (flight.risers - 1) * self.tread_m


def draw_steps(rng: np.random.Generator, config: StairsConfig) -> tuple[float, float]:
    """Return the riser that a house's stairs aim at, and their tread [m]."""
    riser, tread = (
        span[0] if span[0] == span[1] else float(rng.uniform(*span))
        for span in (config.riser_m, config.tread_m)
    )
    return riser, tread


def _risers(rise_m: float, riser_m: float) -> int:
    """Return how many risers near `riser_m` make `rise_m`, none of them too low or too high."""
    low, high = math.ceil(rise_m / _RISER_M[1]), math.floor(rise_m / _RISER_M[0])
    return min(max(round(rise_m / riser_m), low), high)


def least_stairwell_m(shape: str, rise_m: float, steps_m: Span, depth_m: float) -> Span:
    """Return the least extents of a stairwell, along its hallway and away from it [m].

    Args:
        rise_m: the highest that the stairs may have to reach.
        steps_m: riser and tread.
        depth_m: least extent of a stairwell away from its hallway.
    """
    if shape == "straight":
        return lay_out(shape, rise_m, steps_m, depth_m).size_m[0] + 2 * BEFORE_M, depth_m
    if shape == "L":
        depth_m = max(depth_m, SETBACK_M[shape] + _FIRST_TREADS * steps_m[1] + FLIGHT_M)
        return lay_out(shape, rise_m, steps_m, depth_m).size_m[1] + BEFORE_M, depth_m
    run = (_risers(rise_m / 2, steps_m[0]) - 1) * steps_m[1]
    return 2 * FLIGHT_M + SPINE_M + BEFORE_M, SETBACK_M[shape] + run + FLIGHT_M


def lay_out(shape: str, rise_m: float, steps_m: Span, depth_m: float) -> Stairs:
    """Return stairs that rise by `rise_m`.

    Args:
        steps_m: the riser that they aim at, and their tread.
        depth_m: extent of the stairwell away from its hallway; L- and U-shaped stairs fill it.
    """
    target, tread = steps_m
    length = depth_m - SETBACK_M.get(shape, 0.0)
    if shape == "U":
        half = _risers(rise_m / 2, target)
        run, width = (half - 1) * tread, 2 * FLIGHT_M + SPINE_M
        flights = (
            Flight(0, 1, 0.0, (0.0, FLIGHT_M), half, open_m=0.0),
            Flight(0, -1, run, (width - FLIGHT_M, width), half, half),
        )
        landing = ((run, length), (0.0, width))
        riser = rise_m / half / 2
        return Stairs(shape, riser, tread, (length, width), flights, landing, (FLIGHT_M, length))
    risers = _risers(rise_m, target)
    riser = rise_m / risers
    if shape == "straight":
        run, width = (risers - 1) * tread, FLIGHT_M
        flights = (Flight(0, 1, 0.0, (0.0, width), risers, open_m=0.0),)
        return Stairs(shape, riser, tread, (run, width), flights, None, (width, run))
    # The flight from the hallway is as long as the stairwell allows; its landing is in the corner.
    first = min(math.floor((length - FLIGHT_M) / tread) + 1, risers - _LEAST_RISERS)
    run, side = (first - 1) * tread, (risers - first - 1) * tread
    width = side + FLIGHT_M
    flights = (
        Flight(0, 1, 0.0, (side, width), first, open_m=side),
        Flight(1, -1, side, (run, length), risers - first, first, open_m=run),
    )
    landing = ((run, length), (side, width))
    return Stairs(shape, riser, tread, (length, width), flights, landing, (width, run))
