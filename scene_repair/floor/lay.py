"""Lay a floor into a building that has none of its own: its world had a ground plane."""

from dataclasses import replace

import numpy as np
from scipy import ndimage

from ...formats.core.arrays import I32, Array
from ...formats.core.errors import SceneError
from ...formats.scene.grid import GridSpec
from ..grid.morphology import distance_to, label
from ..grid.slices import slice_marks
from ..grid.world_mesh import WorldMesh
from ..orient.bounds import robust_bounds
from ..scan.record import DEFAULT_COLOR, Scan, ScanMaterial, ScanObject
from .evidence import LINTEL_HEIGHTS_M, WALL_HEIGHTS_M
from .outline import cell_squares

CELL_M = 0.05
# The outside is what a disc of this radius reaches from beyond the walls; doors keep it out.
OUTSIDE_RADIUS_M = 0.75
MARGIN_M = 2.0


def with_floor(scan: Scan, source_to_world: Array, height_m: float) -> Scan:
    """Return the scan with a level floor inside its walls at the world height `height_m`.

    Raises:
        SceneError: walls enclose nothing at that height.
    """
    mesh = WorldMesh.of(scan, source_to_world)
    lower, upper = robust_bounds(mesh.vertices, mesh.faces)
    grid = GridSpec.covering(lower[:2] - MARGIN_M, upper[:2] + MARGIN_M, CELL_M)
    heights = height_m + np.concatenate([WALL_HEIGHTS_M, LINTEL_HEIGHTS_M])
    wall = slice_marks(mesh.vertices, mesh.faces, grid, heights) > 0
    radius = OUTSIDE_RADIUS_M / CELL_M
    parts, _ = label(distance_to(wall) > radius)
    outside = distance_to(parts == parts[0, 0]) <= radius
    inside = ~outside & ~wall
    if not inside.any():
        raise SceneError(
            f"--floor {height_m:g}: no walls enclose a place {WALL_HEIGHTS_M[0]:g} to "
            f"{LINTEL_HEIGHTS_M[-1]:g} m above it; valid: the height at which its walls begin"
        )
    # Under the walls, too, so that rooms join at doors and no slit stays open at their feet.
    tiles = ndimage.binary_closing(inside | wall, iterations=2) & ~outside
    nodes, faces = cell_squares(tiles)
    xy = nodes[:, ::-1] * grid.cell_m + grid.origin_xy_m
    world = np.column_stack([xy, np.full(len(xy), height_m)])
    inverse = np.linalg.inv(source_to_world)
    points = world @ inverse[:3, :3].T + inverse[:3, 3]
    count = len(faces)

    def grown(values: I32, number: int) -> I32:
        return np.append(values, np.full(count, number, dtype=np.int32))

    return replace(
        scan,
        vertices=np.concatenate([scan.vertices, points]),
        faces=np.concatenate([scan.faces, faces + len(scan.vertices)]),
        corner_uv=np.concatenate([scan.corner_uv, np.zeros((count, 3, 2), np.float32)]),
        face_material=grown(scan.face_material, len(scan.materials)),
        face_object=grown(scan.face_object, len(scan.objects)),
        face_part=grown(scan.face_part, 0),
        materials=(*scan.materials, ScanMaterial("floor", DEFAULT_COLOR)),
        objects=(*scan.objects, ScanObject("Floor", "floor")),
        warnings=(
            *scan.warnings,
            f"--floor: {inside.sum() * CELL_M**2:.1f} m² laid at {height_m:.2f} m inside the walls",
        ),
    )
