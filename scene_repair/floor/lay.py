"""Lay a floor, or a ceiling, into a building that has none of its own.

Of a simulated building the world had a ground plane; modellers and scanners leave ceilings out.
"""

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
from .outline import cell_squares, cell_strips

CELL_M = 0.05
# The outside is what a disc of this radius reaches from beyond the walls; doors keep it out.
OUTSIDE_RADIUS_M = 0.75
MARGIN_M = 2.0
# Where walls are looked for that carry a ceiling: over doors and windows, but not at their ends.
BELOW_CEILING_M = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
WHERE = {"floor": ("above", "begin"), "ceiling": ("below", "end")}


def with_floor(scan: Scan, source_to_world: Array, height_m: float) -> Scan:
    """Return the scan with a level floor inside its walls at the world height `height_m`.

    Raises:
        SceneError: walls enclose nothing at that height.
    """
    above_m = np.concatenate([WALL_HEIGHTS_M, LINTEL_HEIGHTS_M])
    return _with_sheet(scan, source_to_world, "floor", height_m, above_m)


def with_ceiling(scan: Scan, source_to_world: Array, height_m: float) -> Scan:
    """Return the scan with a level ceiling over its walls at the world height `height_m`.

    Raises:
        SceneError: walls enclose nothing below that height.
    """
    return _with_sheet(scan, source_to_world, "ceiling", height_m, -BELOW_CEILING_M)


def _with_sheet(scan: Scan, source_to_world: Array, kind: str, at_m: float, walls_m: Array) -> Scan:
    """Return the scan with a sheet at the height `at_m`, inside walls `walls_m` (n,) above it.

    Under a ceiling these are negative.
    """
    mesh = WorldMesh.of(scan, source_to_world)
    lower, upper = robust_bounds(mesh.vertices, mesh.faces)
    grid = GridSpec.covering(lower[:2] - MARGIN_M, upper[:2] + MARGIN_M, CELL_M)
    wall = slice_marks(mesh.vertices, mesh.faces, grid, at_m + walls_m) > 0
    radius = OUTSIDE_RADIUS_M / CELL_M
    parts, _ = label(distance_to(wall) > radius)
    outside = distance_to(parts == parts[0, 0]) <= radius
    inside = ~outside & ~wall
    if not inside.any():
        (side, ends), (near, *_, far) = WHERE[kind], np.abs(walls_m)
        raise SceneError(
            f"--{kind} {at_m:g}: no walls enclose a place {near:g} to {far:g} m {side} it; "
            f"valid: the height at which its walls {ends}"
        )
    # Under the walls, too, so that rooms join at doors and no slit stays open at their feet.
    tiles = ndimage.binary_closing(inside | wall, iterations=2) & ~outside
    nodes, faces = (cell_squares if kind == "floor" else cell_strips)(tiles)
    xy = nodes[:, ::-1] * grid.cell_m + grid.origin_xy_m
    world = np.column_stack([xy, np.full(len(xy), at_m)])
    inverse = np.linalg.inv(source_to_world)
    points = world @ inverse[:3, :3].T + inverse[:3, 3]
    count = len(faces)

    def grown(values: I32, number: int) -> I32:
        return np.append(values, np.full(count, number, dtype=np.int32))

    laid = f"--{kind}: {inside.sum() * CELL_M**2:.1f} m² laid at {at_m:.2f} m inside the walls"
    return replace(
        scan,
        vertices=np.concatenate([scan.vertices, points]),
        faces=np.concatenate([scan.faces, faces + len(scan.vertices)]),
        corner_uv=np.concatenate([scan.corner_uv, np.zeros((count, 3, 2), np.float32)]),
        face_material=grown(scan.face_material, len(scan.materials)),
        face_object=grown(scan.face_object, len(scan.objects)),
        face_part=grown(scan.face_part, 0),
        materials=(*scan.materials, ScanMaterial(kind, DEFAULT_COLOR)),
        objects=(*scan.objects, ScanObject(kind.capitalize(), kind)),
        warnings=(*scan.warnings, laid),
    )
