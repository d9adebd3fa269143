"""The look of filled floor: an orthographic picture of the scanned floor, continued into holes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..formats.grid import GridSpec
from .columns import Columns, sample_columns
from .inpaint import inpaint
from .maps import grow
from .shading import Looks, barycentric
from .world_mesh import WorldMesh

# This much floor around a hole is what its filling is copied from.
AROUND_M = 1.5
MARGIN_PX = 3


def paint_floor(
    mesh: WorldMesh,
    looks: Looks,
    floor_faces: NDArray[np.int64],
    region: NDArray[np.bool_],
    grid: GridSpec,
    texel_m: float,
    max_px: int,
) -> tuple[Image.Image, GridSpec]:
    """Texture for the patches of one level.

    Args:
        mesh: the scan without patches.
        looks: its materials.
        floor_faces: (n,) scanned floor.
        region: (rows, columns) cells under patches.
        grid: their grid.
        texel_m: wanted texel size; coarser if the level is too large for `max_px`.
        max_px: largest side of the image.

    Returns:
        The image (row 0 at the top, i.e. greatest y) and its texel grid (row 0 at least y).
    """
    rows, columns = np.nonzero(region)
    low = grid.center_of((rows.min(), columns.min())) - grid.cell_m
    high = grid.center_of((rows.max(), columns.max())) + grid.cell_m
    texel_m = max(texel_m, float((high - low).max() + 2 * AROUND_M) / (max_px - 2))
    texels = GridSpec.covering(low, high, texel_m)
    around = GridSpec.covering(low - AROUND_M, high + AROUND_M, texel_m)
    i, j = np.indices(around.shape)
    center = around.center_of(np.stack([i, j], axis=-1))
    cell = grid.cell_of(center)
    inside = grid.inside(cell)
    wanted = np.zeros(around.shape, dtype=bool)
    wanted[inside] = region[tuple(cell[inside].T)]
    wanted = grow(wanted, MARGIN_PX)
    image, known = _look_down(mesh, looks, floor_faces, around)
    if known.any():
        image = inpaint(image, known, wanted)
    di, dj = np.rint(
        (np.asarray(texels.origin_xy_m) - np.asarray(around.origin_xy_m))[::-1] / texel_m
    ).astype(int)
    cropped = image[di : di + texels.rows, dj : dj + texels.columns]
    pixels = np.clip(np.rint(cropped[::-1] * 255.0), 0, 255).astype(np.uint8)
    return Image.fromarray(pixels), texels


def uv_on(grid: GridSpec, xy_m: NDArray[np.float64]) -> NDArray[np.float32]:
    """Texture coordinates (..., 2), v up, of world points (..., 2) on a texel grid's image."""
    size = np.array([grid.columns, grid.rows]) * grid.cell_m
    return ((xy_m - np.asarray(grid.origin_xy_m)) / size).astype(np.float32)


def _look_down(
    mesh: WorldMesh, looks: Looks, floor_faces: NDArray[np.int64], texels: GridSpec
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Colours (rows, columns, 3) of the floor seen from above, and where there is any."""
    columns: Columns = sample_columns(mesh.vertices, mesh.faces[floor_faces], texels)
    top = columns.start[1:] - 1
    hit = np.diff(columns.start) > 0
    face = floor_faces[columns.face[top[hit]]]
    cell = np.flatnonzero(hit)
    point = texels.center_of(np.stack([cell // texels.columns, cell % texels.columns], axis=-1))
    weights = barycentric(mesh.vertices[mesh.faces[face], :2], point)
    uv = np.einsum("nk,nkd->nd", weights, mesh.corner_uv[face]).astype(np.float32)
    image = np.zeros((texels.rows * texels.columns, 3), dtype=np.float32)
    image[cell] = looks.at(mesh.face_material[face], uv)
    return image.reshape(*texels.shape, 3), hit.reshape(texels.shape)
