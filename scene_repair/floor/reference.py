"""The reference floor: a smooth height in every cell, known or missing."""

from typing import Any

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.linalg import spsolve

from ...formats.core.arrays import I64, Array, Mask
from ..grid.height_field import extend
from ..grid.morphology import distance_to, grow, grown_window, label, linked, nearest_in, windows

# Heights around a hole that differ by more, with none between, are two floors with a step between.
STEP_M = 0.06
# A piece of floor is level if heights of neighbouring cells differ by less in this share of it.
LEVEL_M, LEVEL_SHARE = 0.01, 0.4
# Level pieces smaller than this are no floor of their own.
PIT_M2 = 0.1


def remove_narrow(z_m: Array, cell_m: float, width_m: float, height_m: float) -> Array:
    """Remove bumps and dents narrower than `width_m`; NaN (no floor) stays NaN.

    Grey opening, then closing, with a square of that width (Serra, 1982). What deviates by more
    than `height_m` and is mostly level is real, the corner of a sunken area for example, and stays;
    what is not is the foot of a thing, melted into the floor by the scanner.
    """
    size = 2 * round(width_m / cell_m / 2) + 1
    filled = extend(z_m)
    opened = ndimage.grey_opening(filled, size=(size, size))
    closed = ndimage.grey_closing(opened, size=(size, size))
    parts, count = label(np.abs(closed - z_m) > height_m)
    spread = ndimage.maximum_filter(filled, 3) - ndimage.minimum_filter(filled, 3)
    level = np.asarray(ndimage.mean(spread < LEVEL_M, parts, np.arange(count + 1)))
    real = (level >= LEVEL_SHARE) & (np.arange(count + 1) > 0)
    return np.where(real[parts], z_m, np.where(np.isfinite(z_m), closed, np.nan))


def without_pits(z_m: Array, cell_m: float) -> Array:
    """Remove small pieces that a step separates from the larger floor nearest to them.

    Pits and blisters of a scan, where it closed a surface over what it had not seen.
    """
    cell = np.arange(z_m.size).reshape(z_m.shape)
    pairs = []
    for own, beside in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        level = np.abs(z_m[own] - z_m[beside]) < LEVEL_M
        pairs.append(np.stack([cell[own][level], cell[beside][level]]))
    first, second = np.concatenate(pairs, axis=1)
    group = linked(first, second, z_m.size).reshape(z_m.shape)
    large = np.isfinite(z_m) & (np.bincount(group.ravel())[group] * cell_m**2 >= PIT_M2)
    if not large.any():
        return z_m
    nearby = z_m[nearest_in(large)]
    return np.where(large | (np.abs(z_m - nearby) < STEP_M), z_m, np.nan)


def fill_heights(z_m: Array, missing: Mask, reach: int) -> Array:
    """Continue the known heights into the `missing` cells; other cells are unchanged.

    Per connected region a plane is fitted to the known cells within `reach` cells around it (a
    level one unless a slope is significant), and the remainder at the rim is spread inwards by the
    discrete Laplace equation, free (no flux) where there is no known neighbour.
    """
    result = z_m.copy()
    region, _ = label(missing, diagonal=True)
    for k, window in enumerate(windows(region), start=1):
        grown = grown_window(window, reach, z_m.shape)
        mask = region[grown] == k
        z = z_m[grown]
        near = distance_to(mask) <= reach
        scanned = near & np.isfinite(z) & ~mask
        if not scanned.any():
            continue
        scanned &= _alike(z, scanned, mask)
        plane = _plane(z, scanned)
        inside = _spread(np.where(scanned, z - plane, np.nan), mask)
        result[grown][mask] = (plane + inside)[mask]
    return result


def _alike(z: Array, scanned: Mask, mask: Mask) -> Mask:
    """Return which heights belong to the floor along most of the rim, not beyond a step."""
    rim = scanned & grow(mask)
    if not rim.any():
        return scanned
    heights = np.sort(z[rim])
    parts = np.split(heights, np.flatnonzero(np.diff(heights) > STEP_M) + 1)
    floor = max(parts, key=len)
    return (z >= floor[0] - STEP_M) & (z <= floor[-1] + STEP_M)


def _plane(z: Array, scanned: Mask) -> Array:
    """Fit a robust plane to the window: reweighted least squares; level if the slope is slight."""
    i, j = np.nonzero(scanned)
    values = z[scanned]
    centre = np.array([i.mean(), j.mean()])
    design = np.stack([i - centre[0], j - centre[1], np.ones(len(i))], axis=1)
    weight = np.ones(len(i))
    level = float(np.median(values))
    spread = np.ptp(np.stack([i, j]), axis=1)
    coefficients = np.array([0.0, 0.0, level])
    if len(i) >= 50 and spread.min() >= 4:
        for _ in range(5):
            w = np.sqrt(weight)[:, None]
            coefficients = np.linalg.lstsq(design * w, values * w[:, 0], rcond=None)[0]
            residual = np.abs(values - design @ coefficients)
            scale = 1.4826 * np.median(residual) + 1e-4
            weight = 1.0 / (1.0 + (residual / (2.0 * scale)) ** 2)
        rise = np.hypot(*coefficients[:2]) * float(np.hypot(*spread))
        noise = float(np.median(np.abs(values - level)))
        flat_cost = float(np.mean(np.abs(values - level)))
        plane_cost = float(np.mean(np.abs(values - design @ coefficients)))
        if rise < 0.02 or plane_cost > 0.7 * flat_cost or noise == 0.0:
            coefficients = np.array([0.0, 0.0, level])
    rows, columns = np.indices(z.shape)
    return (
        coefficients[0] * (rows - centre[0])
        + coefficients[1] * (columns - centre[1])
        + coefficients[2]
    )


def _spread(remainder: Array, mask: Mask) -> Array:
    """Solve Laplace's equation in `mask` with the known remainder around it as boundary values."""
    index = np.full(mask.shape, -1)
    count = int(mask.sum())
    index[mask] = np.arange(count)
    # A weak pull to zero keeps cells without any known neighbour defined.
    diagonal = np.full(count, 1e-6)
    right = np.zeros(count)
    rows: list[I64] = []
    columns: list[I64] = []
    for di, dj in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        i, j = np.nonzero(mask)
        ni, nj = i + di, j + dj
        valid = (ni >= 0) & (nj >= 0) & (ni < mask.shape[0]) & (nj < mask.shape[1])
        own, ni, nj = index[i, j][valid], ni[valid], nj[valid]
        inner = mask[ni, nj]
        rows.append(own[inner])
        columns.append(index[ni[inner], nj[inner]])
        np.add.at(diagonal, own[inner], 1.0)
        edge = remainder[ni, nj]
        scanned = ~inner & np.isfinite(edge)
        np.add.at(diagonal, own[scanned], 1.0)
        np.add.at(right, own[scanned], edge[scanned])
    r, c = np.concatenate(rows), np.concatenate(columns)
    matrix = sparse.coo_matrix((np.full(len(r), -1.0), (r, c)), shape=(count, count))
    solution: Any = spsolve((matrix + sparse.diags(diagonal)).tocsc(), right)
    result = np.zeros(mask.shape)
    result[mask] = solution
    return result
