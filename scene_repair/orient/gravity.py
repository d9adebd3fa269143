"""Estimate gravity: floors, ceilings and table tops share one normal, walls are orthogonal."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage

from ...formats.core.arrays import I64, Array, Mask
from ...formats.core.geometry import triangle_normals_and_areas

# Normals are gathered in cells of about a degree, whose mean is exact.
CELLS_PER_UNIT = 60
MODES, APART_DEG = 12, 12.0
# A face counts as level (or upright) within this angle of it; noise of scans is as large.
WIDE_DEG = 6.0
# The refinement trusts residuals of this size, and less what lies further off.
TRUSTED_DEG = 0.3
REFINE_DEG = (8.0, 6.0, 5.0, 4.0, 3.0, 3.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0)
HEIGHT_BINS = 64
# Floors and ceilings are where at least this share of the strongest height's level area lies …
STRONG_SHARE = 0.25
# … and where this share lies there is a slab or a suspended ceiling, which says nothing of up.
SLAB_SHARE = 0.5
# … and this share of the height between them next to either is theirs: what remains are things.
SHELL = 0.12
# Strong heights nearer together than this share of the whole are one floor, without a ceiling.
LEAST_ROOM = 0.3
# Where things are says more than which way they face: normals made for point clouds may be wrong.
FACING = 0.3
# Less level area between floor and ceiling than this share of theirs is sills and heads of doors
# and windows, of which there are more heads: they are evidence in proportion only.
FURNISHED = 0.08
# Points spread over the surface, and cells along its longest side, that show where walls stand.
POINTS, SIDE_CELLS = 60_000, 40
# Upright surfaces that run on over this share of the height are walls.
WALL_SHARE = 0.3


@dataclass(frozen=True)
class Surfaces:
    """A scan's faces as directions and places.

    Attributes:
        normals, area, centers: (F, 3) unit, (F,) and (F, 3).
        points, point_face: (N, 3) spread evenly over the surface, and the face (N,) of each.
        cells, cell_area: mean normals (N, 3) of like-directed faces, their areas (N,); opposite
            directions count as one.
    """

    normals: Array
    area: Array
    centers: Array
    points: Array
    point_face: I64
    cells: Array
    cell_area: Array

    @staticmethod
    def of(vertices: Array, faces: I64) -> "Surfaces":
        """Compute from triangles of non-zero area: vertices (V, 3), faces (F, 3)."""
        corners = vertices[faces]
        normals, area = triangle_normals_and_areas(corners)
        x, y, z = normals.T
        # A direction stands for itself and its opposite.
        side = np.where((z > 0) | ((z == 0) & ((y > 0) | ((y == 0) & (x > 0)))), 1.0, -1.0)
        index = np.rint(normals * side[:, None] * CELLS_PER_UNIT).astype(np.int64) + 64
        _, cell = np.unique(
            (index[:, 0] << 16) | (index[:, 1] << 8) | index[:, 2], return_inverse=True
        )
        weight = area * side
        count = int(cell.max()) + 1
        sums = np.stack(
            [np.bincount(cell, weight * normals[:, k], count) for k in range(3)], axis=1
        )
        length = np.linalg.norm(sums, axis=1)
        directed = length > 0
        return Surfaces(
            normals,
            area,
            (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3.0,
            *_spread(corners, area),
            sums[directed] / length[directed, None],
            np.bincount(cell, area, count)[directed].astype(np.float64),
        )


def _spread(corners: Array, area: Array) -> tuple[Array, I64]:
    """Return points (N, 3) spread over triangles (F, 3, 3) of areas (F,), and the face of each."""
    passed = np.cumsum(area)
    number = np.arange(POINTS) + 0.5
    face = np.minimum(np.searchsorted(passed, number / POINTS * passed[-1]), len(area) - 1)
    # Roberts' sequence: pairs that leave no gaps, folded into the triangle.
    u, v = np.mod(number[:, None] * [0.7548776662466927, 0.5698402909980532], 1.0).T
    folded = u + v > 1.0
    u, v = np.where(folded, 1.0 - u, u)[:, None], np.where(folded, 1.0 - v, v)[:, None]
    a, b, c = corners[face].swapaxes(0, 1)
    return a + u * (b - a) + v * (c - a), face


def modes(surfaces: Surfaces) -> Array:
    """Return the directions (n, 3) that most area faces, largest first."""
    cells, area = surfaces.cells, surfaces.cell_area
    left = area.copy()
    directions = []
    for _ in range(MODES):
        if not left.max() > 0.002 * area.sum():
            break
        up = cells[np.argmax(left)]
        for _ in range(4):
            cosine = cells @ up
            near = np.abs(cosine) > np.cos(np.deg2rad(WIDE_DEG))
            mean = (cells[near] * (np.sign(cosine[near]) * area[near])[:, None]).sum(axis=0)
            up = mean / np.linalg.norm(mean)
        left[np.abs(cells @ up) > np.cos(np.deg2rad(APART_DEG))] = 0.0
        directions.append(up)
    return np.array(directions).reshape(-1, 3)


def level_and_upright(
    surfaces: Surfaces, up: Array, within_deg: float = WIDE_DEG
) -> tuple[float, float]:
    """Return the shares of the area that are level and upright if `up` (3,) is up."""
    cosine = np.abs(surfaces.cells @ up)
    total = surfaces.cell_area.sum()
    level = surfaces.cell_area[cosine > np.cos(np.deg2rad(within_deg))].sum()
    upright = surfaces.cell_area[cosine < np.sin(np.deg2rad(within_deg))].sum()
    return float(level / total), float(upright / total)


def refine(surfaces: Surfaces, up: Array) -> Array:
    """Refine a direction to fit level faces and the orthogonal upright ones.

    Minimises Σ w (1 − (n·u)²) over level and Σ w (n·u)² over upright faces, an eigenvector of the
    summed dyads, with weights that lessen what disagrees: where the floor slopes, the walls win.
    """
    cells, area = surfaces.cells, surfaces.cell_area
    for degrees in REFINE_DEG:
        cosine = np.clip(np.abs(cells @ up), 0.0, 1.0)
        off = np.minimum(np.arccos(cosine), np.arcsin(cosine))
        near = off < np.deg2rad(degrees)
        weight = area / (off + np.deg2rad(TRUSTED_DEG))
        level = near & (cosine > 0.7)
        upright = near & (cosine < 0.7)
        if not level.any():
            return up
        dyads = (cells[level] * weight[level, None]).T @ cells[level]
        dyads -= (cells[upright] * weight[upright, None]).T @ cells[upright]
        best = np.linalg.eigh(dyads)[1][:, -1]
        up = best * np.sign(best @ up)
    return up


def height_range(surfaces: Surfaces, up: Array) -> tuple[float, float]:
    """Return the 0.1 and 99.9 percentile of the area along `up` (3,)."""
    height = surfaces.centers @ up
    order = np.argsort(height)
    passed = np.cumsum(surfaces.area[order])
    low, high = np.searchsorted(passed, np.array([0.001, 0.999]) * passed[-1])
    return float(height[order[low]]), float(height[order[min(high, len(order) - 1)]])


def likeness(surfaces: Surfaces, up: Array) -> float:
    """Return a score of how likely `up` (3,) is a building's vertical.

    Level area per height, more so if it gathers at few heights: walls in a direction lie at many
    places, floors and ceilings at few; and storeys are lower than buildings are wide.
    """
    level = np.abs(surfaces.normals @ up) > np.cos(np.deg2rad(WIDE_DEG))
    if not level.any():
        return 0.0
    low, high = height_range(surfaces, up)
    tall = max(high - low, 1e-12)
    share = (surfaces.centers[level] @ up - low) / tall
    histogram = np.histogram(share, HEIGHT_BINS, (-0.01, 1.01), weights=surfaces.area[level])[0]
    inside = histogram.sum()
    if not inside > 0:
        return 0.0
    gathered = np.sqrt(np.square(histogram / inside).sum())
    width = np.sqrt(surfaces.area.sum())
    return float(inside / surfaces.area.sum() * gathered * width / tall)


def enclosure(surfaces: Surfaces, up: Array) -> float:
    """Return the share of the ground plan along `up` (3,) that walls enclose on three sides.

    What lies on its side and has no floor or ceiling of its own is open along its longest edges.
    """
    across = np.linalg.svd(up[None])[2][1:]
    place = surfaces.points @ np.vstack([across, up]).T
    place -= place.min(axis=0)
    cell = (place / max(float(place.max()), 1e-12) * (SIDE_CELLS - 1)).astype(np.int64)
    solid = np.zeros(cell.max(axis=0) + 1, dtype=bool)
    solid[tuple(cell.T)] = True
    plan: Any = ndimage.binary_fill_holes(solid.any(axis=2))
    # A wall whose faces lie between two cells stands in either.
    solid = ndimage.maximum_filter(solid, (3, 3, 1))
    run = longest = np.zeros(plan.shape, dtype=np.int64)
    for layer in np.moveaxis(solid, 2, 0):
        run = (run + 1) * layer
        longest = np.maximum(longest, run)
    wall = longest >= WALL_SHARE * solid.shape[2]
    met = np.zeros(plan.shape, dtype=np.int64)
    for axis in (0, 1):
        met += np.maximum.accumulate(wall, axis=axis)
        met += np.flip(np.maximum.accumulate(np.flip(wall, axis), axis=axis), axis)
    inside = plan & ~wall
    return float((met >= 3)[inside].mean()) if inside.any() else 1.0


def side_evidence(surfaces: Surfaces, up: Array) -> tuple[float, str]:
    """Return which end of the axis `up` (3,) is up (positive: `up`), and the reason.

    Furniture stands, it does not hang: what is no wall lies in the lower half. And where faces look
    into the room, more of what lies between floor and ceiling looks up: undersides go unseen.
    """
    cosine, area = surfaces.normals @ up, surfaces.area
    level = np.abs(cosine) > 0.9
    low, high, slab = _slabs(surfaces.centers[level] @ up, area[level])
    bottom, top = height_range(surfaces, up)
    if not top > bottom:
        return 0.0, "everything lies in one plane"
    if high - low < LEAST_ROOM * (top - bottom):
        # One surface with walls on one side of it: a floor, for ceilings go unscanned more often.
        center = (0.5 * (low + high) - bottom) / (top - bottom)
        return 2.0 * (0.5 - center), (
            f"the one large level surface is at {100 * center:.0f} % of the height"
        )
    share = (surfaces.centers @ up - low) / (high - low)
    signed = area * np.sign(cosine)
    floor, ceiling = level & (share < SHELL), level & (share > 1 - SHELL)
    shell = float(area[floor].sum() + area[ceiling].sum())
    looks_in = float(signed[floor].sum() - signed[ceiling].sum()) / shell
    things = level & ~floor & ~ceiling
    things[level] &= ~slab
    weight = float(area[things].sum())
    if not weight > 0:
        return 0.0, "nothing stands between floor and ceiling"
    mean = float((share * area)[things].sum()) / weight
    facing = looks_in * float(signed[things].sum()) / weight
    trust = min(weight / (FURNISHED * shell), 1.0) if shell > 0 else 1.0
    return trust * (2.0 * (0.5 - mean) + FACING * facing), (
        f"what lies level between floor and ceiling is at {100 * mean:.0f} % of the height on "
        f"average, and {50 + 50 * facing:.0f} % of it looks up"
    )


def _slabs(height: Array, area: Array) -> tuple[float, float, Mask]:
    """Return the lowest and highest of places (n,) with much of the areas (n,); those with most."""
    if not len(height):
        return 0.0, 0.0, np.zeros(0, dtype=bool)
    histogram, edges = np.histogram(height, 4 * HEIGHT_BINS, weights=area)
    smooth = np.convolve(histogram, np.ones(3), mode="same")
    strong = np.flatnonzero(smooth > STRONG_SHARE * smooth.max())
    middle = 0.5 * (edges[1:] + edges[:-1])
    place = np.clip(np.searchsorted(edges, height, side="right") - 1, 0, len(smooth) - 1)
    slab = smooth[place] > SLAB_SHARE * smooth.max()
    return float(middle[strong[0]]), float(middle[strong[-1]]), slab
