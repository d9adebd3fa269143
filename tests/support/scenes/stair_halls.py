"""Two storeys joined by a straight, L- or U-shaped staircase, whose treads are known exactly.

World coordinates: z up, metres.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import trimesh
from numpy.typing import NDArray

from . import scans

SIZE_M = (7.0, 7.0)
SLAB_M = 0.25
# A handrail runs along the first flight's left side.
RAIL_M = 0.9


@dataclass(frozen=True)
class StairHall:
    """A building, and the truth about its staircase.

    Attributes:
        parts: its surfaces.
        treads: (n, 2, 2) lower and upper corner [m] of each tread and landing, going up.
        top_m: (n,) their heights.
        rise_m: height of the upper floor.
        foot_m, head_m: (2,) middle of the first and of the last riser.
        landing: index of the landing among the treads, −1 = none.
    """

    parts: list[trimesh.Trimesh]
    treads: NDArray[np.float64]
    top_m: NDArray[np.float64]
    rise_m: float
    foot_m: NDArray[np.float64]
    head_m: NDArray[np.float64]
    landing: int


def stair_hall(
    shape: str,
    riser_m: float = 0.17,
    going_m: float = 0.28,
    width_m: float = 1.0,
    *,
    closed: bool = False,
    nosing_m: float = 0.0,
) -> StairHall:
    """Return a hall of 7 × 7 m; `shape` is `straight`, `L` or `U`. There are 16 risers.

    If it is `closed`, ceiling and floor run on over the stairs. Treads but the first reach
    `nosing_m` over the one below.
    """
    run, x, y = 7 * going_m, 1.0, 1.2
    rise = 16 * riser_m
    ahead = [((x, y + k * going_m), (x + width_m, y + (k + 1) * going_m)) for k in range(7)]
    end = y + run
    if shape == "straight":
        treads = [((x, y + k * going_m), (x + width_m, y + (k + 1) * going_m)) for k in range(15)]
        head, voids = (x + width_m / 2, y + 15 * going_m), [treads[0][0] + treads[-1][1]]
    elif shape == "L":
        landing = ((x, end), (x + width_m, end + width_m))
        left = x + width_m
        steps = [
            ((left + k * going_m, end), (left + (k + 1) * going_m, end + width_m)) for k in range(7)
        ]
        treads = [*ahead, landing, *steps]
        head = (left + run, end + width_m / 2)
        voids = [(x, y, x + width_m, end + width_m), (x, end, left + run, end + width_m)]
    else:
        left = x + width_m + 0.1
        landing = ((x, end), (left + width_m, end + width_m))
        steps = [
            ((left, end - (k + 1) * going_m), (left + width_m, end - k * going_m)) for k in range(7)
        ]
        treads = [*ahead, landing, *steps]
        head, voids = (left + width_m / 2, y), [(x, y, left + width_m, end + width_m)]
    if closed:
        voids = [(0.0, 0.0, 0.0, 0.0)]
    corners = np.array(treads)
    top = np.array([riser_m * (k + 1) for k in range(len(treads))])
    parts = [
        scans.sheet((0, 0), SIZE_M, step=0.25),
        *scans.walls((0, 0), SIZE_M, rise - SLAB_M),
        *_around(voids, rise - SLAB_M, facing_up=False),
        *_around(voids, rise, facing_up=True),
        *[w.apply_translation((0, 0, rise)) for w in scans.walls((0, 0), SIZE_M, 2.5)],
        scans.sheet((0, 0), SIZE_M, z=rise + 2.5, step=0.5, facing_up=False),
    ]
    # One can walk under the second flight.
    for (low, high), z in zip(corners, top, strict=True):
        parts.append(scans.box((*low, max(z - 0.4, 0.0)), (*high, z)))
    if nosing_m:
        for (below, tread), z in zip(pairwise(corners), top[1:], strict=True):
            low = np.maximum(tread[0] - nosing_m, below[0])
            high = np.minimum(tread[1] + nosing_m, below[1])
            parts.append(scans.box((*low, z - 0.03), (*high, z)))
    rails = [
        scans.box((x, low[1], z + RAIL_M - 0.04), (x + 0.04, high[1], z + RAIL_M))
        for (low, high), z in zip(corners[:7], top, strict=False)
    ]
    return StairHall(
        [*parts, *rails],
        corners,
        top,
        rise,
        np.array([x + width_m / 2, y]),
        np.array(head),
        -1 if shape == "straight" else 7,
    )


def _around(voids: list[tuple[float, ...]], z_m: float, facing_up: bool) -> list[trimesh.Trimesh]:
    """A level sheet of the hall's size without rectangles (low x, low y, high x, high y)."""
    edges = [
        np.unique([0.0, SIZE_M[axis], *(v[axis] for v in voids), *(v[axis + 2] for v in voids)])
        for axis in (0, 1)
    ]
    gap = scans.either(*(scans.rectangle(v[:2], v[2:]) for v in voids))
    cells = [
        ((x0, y0), (x1, y1))
        for x0, x1 in pairwise(edges[0].tolist())
        for y0, y1 in pairwise(edges[1].tolist())
    ]
    return [
        scans.sheet(low, high, z=z_m, step=1.0, facing_up=facing_up)
        for low, high in cells
        if not gap(np.mean([[low, high]], axis=1))[0]
    ]
