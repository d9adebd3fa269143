"""A scene before anything is cut: its parts, its true floor, and where things stand."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from vlnpe.formats.core.arrays import I64, Array, Mask
from vlnpe.formats.core.geometry import triangle_cross
from vlnpe.formats.scene.grid import GridSpec

from .planting.glb import Part
from .vertical import Surfaces, heights_near

CELL_M = 0.02
# Surfaces this near to the floor's height belong to it: rugs, thresholds, noise.
FLOOR_BAND_M = 0.05
# A real floor is as flat as this.
FLAT_M = 0.02
# Rays look for surfaces this far from it at most.
NEAR_FLOOR_M = 0.15
# Heights above the floor between which furniture is looked for.
FURNITURE_M = (0.12, 1.7)
WALL_SLICES_M = np.linspace(0.3, 2.0, 9, dtype=np.float64)
# Where walls are known by name, those under windows are found at their feet.
WALL_FOOT_M = np.linspace(0.1, 0.5, 5, dtype=np.float64)
# A wall's two faces stand at most this far apart.
WALL_THICKNESS_M = 0.28

Box = tuple[Array, Array]


@dataclass(frozen=True)
class Site:
    """Facts about a scene, z up [m]; heights are of its one storey.

    Attributes:
        name: of the scene.
        parts: its meshes.
        grid: cells of the following masks.
        floor_z_m: height of the floor.
        exact: whether the true floor is exactly a plane at that height, except for rugs.
        true_floor: (rows, columns) where there is floor in truth.
        scanned: where the scan has it.
        building: everything inside the outer walls, and they.
        wall: where walls stand.
        furniture: what something hangs or stands over, lower than head height.
        doors: boxes (lower, upper) (2,) in plan of doorways.
        rugs: likewise, of rugs.
    """

    name: str
    parts: list[Part]
    grid: GridSpec
    floor_z_m: float
    exact: bool
    true_floor: Mask
    scanned: Mask
    building: Mask
    wall: Mask
    furniture: Mask
    doors: list[Box]
    rugs: list[Box]

    def near_floor(self, parts: list[Part]) -> Surfaces:
        """Return what of some parts lies about the floor's height."""
        z = self.floor_z_m
        return Surfaces.between(*soup_of(parts), z - NEAR_FLOOR_M, z + NEAR_FLOOR_M)


def floor_height(parts: list[Part], about_m: float) -> float:
    """Return the height [m] near `about_m` at which most of the level area lies."""
    vertices, faces = soup_of(parts)
    corners = vertices[faces]
    cross = triangle_cross(corners)
    z = corners[..., 2].mean(axis=1)
    near = np.abs(z - about_m) < NEAR_FLOOR_M
    share, edges = np.histogram(z[near], bins=60, weights=np.abs(cross[near, 2]))
    peak = edges[int(share.argmax())]
    close = near & (np.abs(z - peak) < FLAT_M)
    return float(np.average(z[close], weights=np.abs(cross[close, 2])))


def soup_of(parts: list[Part]) -> tuple[Array, I64]:
    """Return all triangles of parts as one (V, 3) and (F, 3)."""
    offset = np.cumsum([0] + [len(p.points_m) for p in parts[:-1]])
    faces = [p.faces + at for p, at in zip(parts, offset, strict=True)]
    return np.concatenate([p.points_m for p in parts]), np.concatenate(faces)


def survey(
    name: str,
    parts: list[Part],
    floor_z_m: float,
    *,
    exact: bool,
    true_floor: tuple[GridSpec, Mask] | None = None,
    building: Mask | None = None,
    doors: Sequence[Box] = (),
    rugs: Sequence[Box] = (),
    wall_parts: list[Part] | None = None,
) -> Site:
    """Look over a scene.

    Args:
        name: of the scene.
        parts: its meshes.
        floor_z_m: height of its floor.
        exact: whether that is all there is to know about its heights.
        true_floor: where there is floor; None = where the scan has it and no wall stands.
        building: the building's footprint; None = the scan's.
        doors: boxes of doorways in plan.
        rugs: likewise, of rugs.
        wall_parts: the meshes that walls are made of; None = any may be.
    """
    vertices, faces = soup_of(parts)
    everything = Surfaces.between(vertices, faces)
    if true_floor is None:
        lower, upper = vertices.min(axis=0)[:2], vertices.max(axis=0)[:2]
        grid = GridSpec.covering(lower - 0.5, upper + 0.5, CELL_M)
    else:
        grid = true_floor[0]
    centers = cell_centers(grid)

    def surface_near(z: float, within: float) -> Mask:
        return np.isfinite(heights_near(everything, centers, z, within)).reshape(grid.shape)

    scanned = surface_near(floor_z_m, FLOOR_BAND_M)
    low, high = FURNITURE_M
    furniture = surface_near(floor_z_m + (low + high) / 2, (high - low) / 2)
    slices = WALL_SLICES_M if wall_parts is None else WALL_FOOT_M
    wall = _walls(*soup_of(wall_parts or parts), grid, floor_z_m + slices)
    anything = surface_near(floor_z_m + 5.0, 6.0)
    # A scan shows the inner faces of outer walls; the building reaches a little farther.
    solid = filled(ndimage.binary_closing(np.pad(anything, 20), iterations=15))
    footprint = ndimage.binary_dilation(solid, iterations=2)[20:-20, 20:-20]
    # A headset's closed surface rises towards things; that is not floor.
    floor = surface_near(floor_z_m, FLAT_M) & ~wall if true_floor is None else true_floor[1]
    return Site(
        name=name,
        parts=parts,
        grid=grid,
        floor_z_m=floor_z_m,
        exact=exact,
        true_floor=floor,
        scanned=scanned,
        building=footprint if building is None else building,
        wall=wall,
        furniture=furniture,
        doors=list(doors),
        rugs=list(rugs),
    )


def filled(mask: Mask) -> Mask:
    """Return the mask without holes."""
    return np.asarray(ndimage.binary_fill_holes(mask), dtype=bool)


def cell_centers(grid: GridSpec) -> Array:
    """Return (rows · columns, 2) centres of all cells."""
    return grid.center_of(
        np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), axis=-1)
    ).reshape(-1, 2)


def _walls(
    vertices: Array,
    faces: I64,
    grid: GridSpec,
    slices_m: Array,
) -> Mask:
    """Return cells that surfaces pass at most heights, and those between a wall's faces."""
    count = np.zeros(grid.shape, dtype=np.int32)
    corners = vertices[faces]
    for height in slices_m:
        z = corners[..., 2] - height
        crossing = corners[(z.min(axis=1) < 0) & (z.max(axis=1) > 0)]
        mask = np.zeros(grid.shape, dtype=bool)
        cells = grid.cell_of(_samples(crossing, height, grid.cell_m / 2))
        cells = cells[grid.inside(cells)]
        mask[cells[:, 0], cells[:, 1]] = True
        # A surface wavers between neighbouring cells.
        count += ndimage.binary_dilation(mask, np.ones((3, 3)))
    steps = round(WALL_THICKNESS_M / grid.cell_m)
    tall = np.pad(count >= 0.75 * len(slices_m), steps)
    solid = ndimage.binary_closing(tall, np.ones((steps, steps)))
    return ndimage.binary_erosion(solid, np.ones((3, 3)))[steps:-steps, steps:-steps]


def _samples(corners: Array, height_m: float, step_m: float) -> Array:
    """Return the points (N, 2) along the lines in which triangles (F, 3, 3) meet a height."""
    z = corners[..., 2] - height_m
    ends = []
    for k in range(3):
        a, b = corners[:, k], corners[:, (k + 1) % 3]
        za, zb = z[:, k], z[:, (k + 1) % 3]
        cuts = (za < 0) != (zb < 0)
        t = np.where(cuts, za / np.where(cuts, za - zb, 1.0), np.nan)[:, None]
        ends.append(a[:, :2] + t * (b - a)[:, :2])
    stacked = np.stack(ends, axis=1)
    order = np.isnan(stacked[..., 0]).argsort(axis=1, kind="stable")[:, :2]
    pair = np.take_along_axis(stacked, order[..., None], axis=1)
    length = np.linalg.norm(pair[:, 1] - pair[:, 0], axis=1)
    steps = np.ceil(length / step_m).astype(np.int64) + 1
    start = np.repeat(np.cumsum(steps) - steps, steps)
    t = ((np.arange(len(start)) - start) / np.repeat(np.maximum(steps - 1, 1), steps))[:, None]
    return np.repeat(pair[:, 0], steps, axis=0) * (1 - t) + np.repeat(pair[:, 1], steps, axis=0) * t
