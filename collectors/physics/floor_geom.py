"""The floor of a level as one MuJoCo geom: a plane where it is flat, else a height field."""

import mujoco
import numpy as np
from scipy.ndimage import map_coordinates, maximum_filter

from ...formats.core.arrays import F32, Array, Mask
from ...formats.scene.freemap import Freemap
from ...formats.scene.grid import GridSpec
from .config import LevelModelConfig
from .floor_surface import FloorSurface

GROUND_BODY, FLOOR_GEOM = "ground", "floor"
_STRIDES = (8, 6, 4, 3, 2)


def add_floor(
    scene: mujoco.MjSpec,
    surface: FloorSurface,
    walked: F32,
    config: LevelModelConfig,
) -> str:
    """Add the floor to a scene, as a geom of a body of its own.

    Args:
        walked: heights of the cells a robot can walk on [m], see `walked_heights`.
        config: how flat is flat, how coarse a height field may be, how deep the void is.

    Returns:
        What it became, in words.
    """
    body = scene.worldbody.add_body(name=GROUND_BODY)
    friction = [config.friction, 0.02, 0.01]
    if not len(walked) or np.ptp(walked) < config.flat_within_m:
        z = float(np.median(walked)) if len(walked) else float(np.median(surface.floor.height_m))
        body.add_geom(
            name=FLOOR_GEOM,
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[0.0, 0.0, 1.0],
            pos=[0.0, 0.0, z],
            friction=friction,
        )
        return "plane"
    grid, height, solid = _coarsened(surface, config.floor_error_m)
    low = float(height[solid].min())
    if not solid.all():
        height = np.where(solid, height, low - config.void_depth_m)
        low -= config.void_depth_m
    top = float(height.max())
    # Samples lie at the cell centres, so the field ends half a cell inside the grid.
    half = 0.5 * grid.cell_m * np.array([grid.columns - 1, grid.rows - 1])
    middle = np.asarray(grid.origin_xy_m) + 0.5 * grid.cell_m * np.array([grid.columns, grid.rows])
    scene.add_hfield(
        name="ground",
        nrow=grid.rows,
        ncol=grid.columns,
        size=[*half, top - low, 0.5],
        userdata=((height - low) / (top - low)).ravel(),
    )
    body.add_geom(
        name=FLOOR_GEOM,
        type=mujoco.mjtGeom.mjGEOM_HFIELD,
        hfieldname="ground",
        pos=[*middle, low],
        friction=friction,
    )
    return "height field"


def _coarsened(surface: FloorSurface, error_m: float) -> tuple[GridSpec, Array, Mask]:
    """Return the floor on the coarsest grid that keeps every solid cell's height to `error_m`.

    A foot touches every triangle near it, so larger triangles mean fewer contacts to solve.
    """
    grid, solid = surface.floor.grid, surface.solid
    height = surface.floor.height_m.astype(np.float64)
    at = np.indices(grid.shape)
    for stride in _STRIDES:
        pad = [(0, -(n - 1) % stride) for n in grid.shape]
        coarse = np.pad(height, pad, mode="edge")[::stride, ::stride]
        if min(coarse.shape) < 2:
            continue
        again = map_coordinates(coarse, at / stride, order=1, mode="nearest")
        if np.abs(again - height)[solid].max() > error_m:
            continue
        # A coarse sample is solid when any cell is that it helps to interpolate: the floor may
        # reach farther into the void by one coarse cell, but never less far.
        reach = 2 * stride - 1
        wide = np.pad(maximum_filter(solid, size=reach), pad, mode="edge")[::stride, ::stride]
        # Sample (0, 0) stays where it was, at the centre of the first fine cell.
        shift = 0.5 * grid.cell_m * (1 - stride)
        origin = (grid.origin_xy_m[0] + shift, grid.origin_xy_m[1] + shift)
        return GridSpec(origin, grid.cell_m * stride, *coarse.shape), coarse, wide
    return grid, height, solid


def walked_heights(surface: FloorSurface, freemap: Freemap) -> F32:
    """Return the heights (N,) [m] of covered floor cells whose centres are traversable."""
    rows, columns = np.nonzero(surface.floor.covered)
    xy = surface.floor.grid.center_of(np.stack([rows, columns], axis=1))
    cells = freemap.grid.cell_of(xy)
    inside = freemap.grid.inside(cells)
    walked = np.zeros(len(xy), dtype=bool)
    walked[inside] = freemap.traversable[tuple(cells[inside].T)]
    return surface.floor.height_m[rows[walked], columns[walked]]
