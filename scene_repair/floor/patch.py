"""Triangulated patches that close holes and share the rim's vertices."""

from dataclasses import dataclass
from typing import Any

import manifold3d
import numpy as np
from scipy.spatial import KDTree

from ...formats.core.arrays import I64, Array, Mask
from ...formats.scene.grid import GridSpec
from ..grid.height_field import heights_at
from ..grid.world_mesh import WorldMesh
from .evidence import COVER_NORMAL_Z
from .outline import cell_polygons, cell_squares, face_outline, trace_loops
from .patch_region import Rectangles
from .reference import STEP_M

# Inner vertices of a patch stand this far apart, so that it can follow a floor that is not plane.
INNER_M = 0.1
# … and where it passes a step, those of its border.
BORDER_M = 0.05
# Clipping keeps eight decimals; what lies nearer than this is the same point.
SAME_M = 1e-6
MIN_PIECE_M2, MIN_WIDTH_M = 1e-6, 2e-4


@dataclass(frozen=True)
class Patch:
    """New floor: `vertices` (N, 3) [m]; `faces` (T, 3) index the mesh's vertices, then these.

    Its connected pieces are outer and inner rings (n, 2) [m], with a horizontal area each.
    """

    vertices: Array
    faces: I64
    pieces: list[list[Array]]
    area_m2: list[float]


def build_patch(
    mesh: WorldMesh,
    floor_faces: I64,
    region: list[tuple[Mask, GridSpec]],
    height_m: Array,
    grid: GridSpec,
) -> Patch:
    """Close the regions by patches that end at the outline of the floor.

    `floor_faces` are (n,) faces that count as floor; `height_m` (rows, columns) over `grid` is the
    height of new vertices.
    """
    flat = floor_faces[np.abs(mesh.normals[floor_faces, 2]) >= COVER_NORMAL_Z]
    bounds = Rectangles.around(mesh.vertices[mesh.faces[flat], :2])
    builder = _Builder(mesh, height_m, grid)
    pieces: list[list[Array]] = []
    areas: list[float] = []
    for cells, local in region:
        near = flat[bounds.near(local)]
        rim = face_outline(mesh.faces[near], mesh.normals[near, 2] > 0)
        target = _cross_section(cell_polygons(cells, local))
        loops = [mesh.vertices[loop, :2] for loop in trace_loops(rim)]
        if loops:
            target = target - _cross_section(loops)
        builder.start(rim)
        for piece in target.decompose():
            # Slivers of rounding along edges that fit already are not gaps.
            if piece.area() < MIN_PIECE_M2 or piece.offset(-MIN_WIDTH_M / 2).is_empty():
                continue
            areas.append(piece.area())
            pieces.append(_rings(piece))
            builder.add(piece)
    vertices, triangles = builder.result()
    return Patch(vertices, triangles, pieces, areas)


def _cross_section(polygons: list[Array]) -> manifold3d.CrossSection:
    rings: Any = [np.ascontiguousarray(p) for p in polygons]
    return manifold3d.CrossSection(rings, manifold3d.FillRule.Positive)


def _rings(section: manifold3d.CrossSection) -> list[Array]:
    rings: Any = section.to_polygons()
    return rings


class _Builder:
    """Collects triangles; rim points become the mesh's own vertices."""

    def __init__(self, mesh: WorldMesh, height_m: Array, grid: GridSpec):
        self.mesh, self.height_m, self.grid = mesh, height_m, grid
        self.vertices: list[Array] = []
        self.faces: list[I64] = []
        self.count = len(mesh.vertices)
        self.start(np.empty((0, 2), dtype=np.int64))

    def start(self, rim: I64) -> None:
        """Begin a region whose surrounding floor has the border edges `rim` (E, 2)."""
        # At a step two floors have their rims in one place; the patch joins one of them.
        corner = self.mesh.vertices[rim]
        level = heights_at(self.height_m, self.grid, corner[..., :2].reshape(-1, 2)).reshape(
            rim.shape
        )
        self.rim = rim[(np.abs(corner[..., 2] - level) <= STEP_M).all(axis=1)]
        self.rim_vertices = np.unique(self.rim)
        points = self.mesh.vertices[self.rim_vertices, :2]
        self.tree = KDTree(points) if len(points) else None

    def add(self, piece: manifold3d.CrossSection) -> None:
        """Triangulate one connected piece: squares inside, triangles between them and the border.

        Every vertex of the border stays in use, also on straight runs, so that no T-junction opens.
        """
        outline, squares, nodes = _inner_squares(piece)
        rings = [self._with_rim_vertices(ring) for ring in _rings(piece)]
        if np.ptp(heights_at(self.height_m, self.grid, np.concatenate(rings))) > STEP_M:
            # Or a triangle with a corner at a step would carry its slope far along the border.
            rings = [_dense(ring) for ring in rings]
        # What the squares cover is cut out: their outlines run the other way round.
        rings += [ring[::-1] for ring in outline]
        points = np.concatenate(rings)
        polygons: Any = [np.ascontiguousarray(ring) for ring in rings]
        border: Any = manifold3d.triangulate(polygons)
        triangles = np.concatenate([np.asarray(border, dtype=np.int64), squares + len(points)])
        joined = self._ids(np.concatenate([points, nodes]))[triangles]
        proper = (
            (joined[:, 0] != joined[:, 1])
            & (joined[:, 1] != joined[:, 2])
            & (joined[:, 2] != joined[:, 0])
        )
        self.faces.append(joined[proper])

    def result(self) -> tuple[Array, I64]:
        """Return new vertices and all faces."""
        if not self.faces:
            return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
        vertices = np.concatenate(self.vertices) if self.vertices else np.empty((0, 3))
        return vertices, np.concatenate(self.faces)

    def _with_rim_vertices(self, polygon: Array) -> Array:
        """Insert rim vertices that lie on a polygon's edges, so that no T-junction opens."""
        if self.tree is None:
            return polygon
        parts = []
        for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            parts.append(a[None])
            length = float(np.linalg.norm(b - a))
            if length < 2 * SAME_M:
                continue
            candidates = self.tree.query_ball_point((a + b) / 2, length / 2 + SAME_M)
            if not candidates:
                continue
            points = self.tree.data[candidates]
            along = (points - a) @ (b - a) / length
            across = np.abs((points - a) @ np.array([a[1] - b[1], b[0] - a[0]])) / length
            on = (across < SAME_M) & (along > SAME_M) & (along < length - SAME_M)
            if on.any():
                order = np.argsort(along[on])
                inserted = points[on][order]
                distinct = np.ones(len(inserted), dtype=bool)
                distinct[1:] = np.linalg.norm(np.diff(inserted, axis=0), axis=1) > SAME_M
                parts.append(inserted[distinct])
        return np.concatenate(parts)

    def _ids(self, points: Array) -> I64:
        """Return vertex ids of 2-D points: the rim's own where they coincide, else new ones."""
        ids = np.full(len(points), -1, dtype=np.int64)
        if self.tree is not None:
            nearest: Any = self.tree.query(points, distance_upper_bound=SAME_M)
            same = np.isfinite(nearest[0])
            ids[same] = self.rim_vertices[nearest[1][same]]
        new = ids < 0
        unique, inverse = np.unique(np.round(points[new], 8), axis=0, return_inverse=True)
        if len(unique):
            z = self._height(unique)
            self.vertices.append(np.column_stack([unique, z]))
            ids[new] = self.count + inverse.ravel()
            self.count += len(unique)
        return ids

    def _height(self, xy: Array) -> Array:
        """Return heights of new vertices: on a rim edge the edge's, else the reference's."""
        z = heights_at(self.height_m, self.grid, xy)
        if not len(self.rim):
            return z
        a = self.mesh.vertices[self.rim[:, 0]]
        b = self.mesh.vertices[self.rim[:, 1]]
        middle = KDTree((a[:, :2] + b[:, :2]) / 2)
        reach = float(np.linalg.norm(b[:, :2] - a[:, :2], axis=1).max()) / 2 + SAME_M
        for k, near in enumerate(middle.query_ball_point(xy, reach)):
            if not near:
                continue
            p, q = a[near], b[near]
            edge = q[:, :2] - p[:, :2]
            length2 = np.maximum((edge**2).sum(axis=1), 1e-18)
            t = ((xy[k] - p[:, :2]) * edge).sum(axis=1) / length2
            foot = p[:, :2] + t[:, None] * edge
            on = (np.linalg.norm(foot - xy[k], axis=1) < SAME_M) & (t >= 0) & (t <= 1)
            if on.any():
                first = int(np.flatnonzero(on)[0])
                z[k] = p[first, 2] + t[first] * (q[first, 2] - p[first, 2])
        return z


def _dense(polygon: Array) -> Array:
    """Subdivide a polygon to edges of at most `BORDER_M`."""
    ahead = np.roll(polygon, -1, axis=0)
    steps = np.ceil(np.linalg.norm(ahead - polygon, axis=1) / BORDER_M).astype(int).clip(1)
    parts = [
        a + (b - a) * (np.arange(n) / n)[:, None]
        for a, b, n in zip(polygon, ahead, steps, strict=True)
    ]
    return np.concatenate(parts)


def _inner_squares(piece: manifold3d.CrossSection) -> tuple[list[Array], I64, Array]:
    """Return the squares of a coarse grid well inside a piece.

    These are outlines with a vertex at every node, triangles (T, 3), and nodes (N, 2) [m].
    """
    nothing = [], np.empty((0, 3), dtype=np.int64), np.empty((0, 2))
    # More than half a square's diagonal away from the border, so that a square whose corners are
    # inside cannot contain a piece of border.
    core = piece.offset(-0.75 * INNER_M)
    if core.is_empty():
        return nothing
    low_x, low_y, high_x, high_y = core.bounds()
    grid = GridSpec.covering((low_x, low_y), (high_x, high_y), INNER_M)
    x0, y0 = grid.origin_xy_m
    corners = GridSpec(
        (x0 - INNER_M / 2, y0 - INNER_M / 2), INNER_M, grid.rows + 1, grid.columns + 1
    )
    inside = _points_inside(core, corners)
    cells = inside[:-1, :-1] & inside[1:, :-1] & inside[:-1, 1:] & inside[1:, 1:]
    # Squares that meet only in a corner would make the outline touch itself.
    for a, b in ((slice(None, -1), slice(1, None)), (slice(1, None), slice(None, -1))):
        pinch = cells[:-1, a] & cells[1:, b] & ~cells[:-1, b] & ~cells[1:, a]
        cells[:-1, a] &= ~pinch
    if not cells.any():
        return nothing
    nodes, triangles = cell_squares(cells)
    outline = cell_polygons(cells, grid, keep_straight=True)
    return outline, triangles, grid.center_of(nodes - 0.5)


def _points_inside(section: manifold3d.CrossSection, grid: GridSpec) -> Mask:
    """Return which cell centres of `grid` lie inside, by the even-odd rule along each row."""
    inside = np.zeros(grid.shape, dtype=bool)
    rows = grid.center_of(np.stack([np.arange(grid.rows), np.zeros(grid.rows)], axis=1))[:, 1]
    polygons = _rings(section)
    a = np.concatenate(polygons)
    b = np.concatenate([np.roll(p, -1, axis=0) for p in polygons])
    for i, y in enumerate(rows):
        crossing = (a[:, 1] <= y) != (b[:, 1] <= y)
        p, q = a[crossing], b[crossing]
        x = np.sort(p[:, 0] + (y - p[:, 1]) / (q[:, 1] - p[:, 1]) * (q[:, 0] - p[:, 0]))
        j = (x - grid.origin_xy_m[0]) / grid.cell_m - 0.5
        for left, right in zip(j[0::2], j[1::2], strict=True):
            inside[i, max(int(np.ceil(left)), 0) : max(int(np.floor(right)) + 1, 0)] = True
    return inside
