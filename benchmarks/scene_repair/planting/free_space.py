"""Where decoys find room: floor that is free, and the ceiling above it."""

import numpy as np

from vlnpe.formats.core.arrays import Array, Mask

from ..site import Site, soup_of

TRIES = 60


def free_rectangle(
    site: Site,
    rng: np.random.Generator,
    taken: Mask,
    sizes_m: tuple[tuple[float, float], tuple[float, float]],
) -> tuple[Array, Array] | None:
    """Return a box in plan where floor is and nothing stands, at random among the places."""
    (short_low, short_high), (long_low, long_high) = sizes_m
    free = site.true_floor & site.scanned & ~site.furniture & ~site.wall & ~taken
    total = np.pad(free.astype(np.int64), ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    for trial in range(TRIES):
        shrink = 1.0 - trial / TRIES
        short = short_low + (rng.uniform(short_low, short_high) - short_low) * shrink
        long = long_low + (rng.uniform(long_low, long_high) - long_low) * shrink
        sides = np.array([short, long] if trial % 2 else [long, short])
        columns, rows = np.ceil(sides / site.grid.cell_m).astype(int)
        if rows >= free.shape[0] or columns >= free.shape[1]:
            continue
        inside = (
            total[rows:, columns:]
            - total[:-rows, columns:]
            - total[rows:, :-columns]
            + total[:-rows, :-columns]
        )
        spots = np.argwhere(inside >= 0.995 * rows * columns)
        if len(spots):
            corner = spots[int(rng.integers(len(spots)))]
            lower = site.grid.center_of(corner - 0.5)
            return lower, lower + sides
    return None


def ceiling_z_m(site: Site, lower: Array, upper: Array) -> float:
    """Return the height of what hangs over the middle of a box.

    2.6 m above the floor if nothing does.
    """
    vertices, _ = soup_of(site.parts)
    inside = np.all((vertices[:, :2] > lower) & (vertices[:, :2] < upper), axis=1)
    high = vertices[inside, 2]
    high = high[high > site.floor_z_m + 2.0]
    return float(np.median(high)) if len(high) else site.floor_z_m + 2.6
