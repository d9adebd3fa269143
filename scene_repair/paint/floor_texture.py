"""Texture of filled floor: an orthographic image of the scanned floor, continued into holes."""

import numpy as np
from PIL import Image

from ...formats.core.arrays import F32, I32, I64, Array, Mask
from ...formats.process.threads import in_order
from ...formats.scene.grid import GridSpec
from ..grid.columns import top_faces
from ..grid.morphology import Window, grow
from ..grid.world_mesh import WorldMesh
from .inpaint import inpaint
from .materials import MaterialSampler

# This much floor around a hole is what its filling is copied from.
AROUND_M = 2.0
# With less floor in a room, its neighbours' is copied.
LEAST_FLOOR_M2 = 0.05
MARGIN_PX = 3


def paint_floor(
    mesh: WorldMesh,
    sampler: MaterialSampler,
    floor_faces: I64,
    region: Mask,
    rooms: I32,
    grid: GridSpec,
    *,
    texel_m: float,
    max_px: int,
) -> tuple[Image.Image, GridSpec]:
    """Paint the texture for the patches of one level.

    Args:
        floor_faces: (n,) scanned floor of the mesh, which has no patches yet.
        region: (rows, columns) cells under patches.
        rooms: (rows, columns) number of each cell's room, from 1, within which floors continue.
        texel_m: texel size; coarser if the level is too large for an image of `max_px`.

    Returns:
        The image (row 0 at the top, i.e. greatest y) and its texel grid (row 0 at least y).
    """
    rows, columns = np.nonzero(region)
    low = grid.center_of((rows.min(), columns.min())) - grid.cell_m
    high = grid.center_of((rows.max(), columns.max())) + grid.cell_m
    texel_m = max(texel_m, float((high - low).max() + 2 * AROUND_M) / (max_px - 2))
    texels = GridSpec.covering(low, high, texel_m)
    picture = np.zeros((*texels.shape, 3), dtype=np.uint8)
    used, corners = np.unique(mesh.faces[floor_faces], return_inverse=True)
    floor = WorldMesh(
        mesh.vertices[used],
        corners.reshape(-1, 3),
        mesh.corner_uv[floor_faces],
        mesh.face_material[floor_faces],
        mesh.face_object[floor_faces],
    )

    def paint(room: int) -> tuple[Window, F32, Mask]:
        own = rooms == room
        return _paint_room(
            floor, sampler, region=region & own, others=region, room=own, grid=grid, texels=texels
        )

    for window, image, target in in_order(paint, np.unique(rooms[region]).tolist()):
        picture[window][target] = np.rint(np.clip(image[target], 0.0, 1.0) * 255.0)
    return Image.fromarray(picture[::-1]), texels


def _paint_room(
    floor: WorldMesh,
    sampler: MaterialSampler,
    *,
    region: Mask,
    others: Mask,
    room: Mask,
    grid: GridSpec,
    texels: GridSpec,
) -> tuple[Window, F32, Mask]:
    """Paint the cells `region` of a `room`, whose floor is copied; `others` are painted in any.

    Returns:
        A window of `texels`, colours (h, w, 3) for it, and where they count (h, w).
    """
    rows, columns = np.nonzero(region)
    around = round(AROUND_M / texels.cell_m)
    corners = grid.center_of(np.array([[rows.min(), columns.min()], [rows.max(), columns.max()]]))
    (i0, j0), (i1, j1) = texels.cell_of(corners)
    i0, j0, i1, j1 = i0 - around, j0 - around, i1 + around + 1, j1 + around + 1
    x, y = texels.origin_xy_m
    corner = (x + j0 * texels.cell_m, y + i0 * texels.cell_m)
    seen = GridSpec(corner, texels.cell_m, int(i1 - i0), int(j1 - j0))
    cells = np.ix_(
        *(np.clip(k, 0, n - 1) for k, n in zip(grid.under(seen), grid.shape, strict=True))
    )
    selected = region[cells]
    target = grow(selected, MARGIN_PX) & (selected | ~others[cells])
    face, uv = top_faces(floor.vertices, floor.faces, floor.corner_uv, seen)
    inside = (face >= 0) & room[cells]
    scanned = face >= 0
    if np.count_nonzero(inside) * texels.cell_m**2 >= LEAST_FLOOR_M2:
        # Beyond a wall lies another floor, which does not continue here.
        scanned = inside
    image = np.zeros((*seen.shape, 3), dtype=np.float32)
    image[scanned] = sampler.at(floor.face_material[face[scanned]], uv[scanned])
    if scanned.any():
        image = inpaint(image, scanned, target, texels.cell_m)
    window = (slice(max(i0, 0), min(i1, texels.rows)), slice(max(j0, 0), min(j1, texels.columns)))
    crop = tuple(
        slice(w.start - first, w.stop - first) for w, first in zip(window, (i0, j0), strict=True)
    )
    return window, image[crop], target[crop]


def uv_on(grid: GridSpec, xy_m: Array) -> F32:
    """Return texture coordinates (..., 2), v up, of world points (..., 2) on a texel grid."""
    size = np.array([grid.columns, grid.rows]) * grid.cell_m
    return ((xy_m - np.asarray(grid.origin_xy_m)) / size).astype(np.float32)
