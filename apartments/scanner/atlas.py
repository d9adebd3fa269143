"""Charts of the scan (connected, nearly flat pieces of one object), and their texture pages."""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import F32, I32, I64, Array
from ...geometry.fusion.surface import ScanMesh, neighbours, pieces, smooth_normals, sums, unit

# A triangle leaning more than 60° against its chart would be stretched to twice its texels.
_LEAST_FACING = 0.5
_SMALL_CHART = 24
# No triangle may be coarser than this, however much it leans.
_COARSEST_M = 0.0098
PADDING = 2


@dataclass(frozen=True)
class Charts:
    """Charts of a mesh.

    Attributes:
        chart: (F,) int32 chart of each triangle.
        object: (C,) int32 object of each chart.
        corner: (F, 3, 2) float64 position of the corners in their chart [texels], from (0, 0).
        size: (C, 2) int64 width and height [texels].
        normal: (F, 3) float32 smoothed unit normals.
    """

    chart: I32
    object: I32
    corner: Array
    size: I64
    normal: F32


def cut(mesh: ScanMesh, label: I32, texel_m: Array) -> Charts:
    """Cut `mesh` into charts, by triangles' objects (F,) and objects' texel sides (O,) [m]."""
    normals = smooth_normals(mesh, 2)
    true_normals, area = mesh.normals()
    pairs = neighbours(mesh.faces)
    direction = np.argmax(np.concatenate([normals, -normals], axis=1), axis=1)
    chart = _grouped(len(label), pairs, label, direction)
    for _ in range(2):
        direction = _absorb_small(chart, direction, label, pairs, normals)
        chart = _grouped(len(label), pairs, label, direction)
    axes = _mean_normals(chart, true_normals, area)
    facing = np.einsum("ij,ij->i", axes[chart], true_normals)
    # Triangles that lean too far leave their chart, and form charts of their own.
    leaning = facing < _LEAST_FACING
    own = np.argmax(np.concatenate([true_normals, -true_normals], axis=1), axis=1)
    direction = np.where(leaning, own + 6, direction)
    chart = _grouped(len(label), pairs, label, direction)
    axes = _mean_normals(chart, true_normals, area)
    return _flatten(
        mesh, chart, label, axes=axes, true_normals=true_normals, normals=normals, texel_m=texel_m
    )


def _grouped(count: int, pairs: I64, label: I32, direction: I64) -> I32:
    a, b = pairs.T
    return pieces(count, pairs[(label[a] == label[b]) & (direction[a] == direction[b])])


def _absorb_small(chart: I32, direction: I64, label: I32, pairs: I64, normals: Array) -> I64:
    """Assign triangles of small charts the direction of the largest neighbouring chart."""
    size = np.bincount(chart)
    a, b = np.concatenate([pairs, pairs[:, ::-1]]).T
    use = (size[chart[a]] < _SMALL_CHART) & (label[a] == label[b]) & (chart[a] != chart[b])
    a, b = a[use], b[use]
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    fits = np.einsum("ij,ij->i", axes[direction[b]], normals[a]) > _LEAST_FACING
    a, b = a[fits & (size[chart[b]] > size[chart[a]])], b[fits & (size[chart[b]] > size[chart[a]])]
    order = np.lexsort((b, size[chart[b]]))
    result = direction.copy()
    # The last write, from the largest neighbour, wins.
    result[a[order]] = direction[b[order]]
    return result


def _mean_normals(chart: I32, normals: Array, area: Array) -> Array:
    return unit(sums(chart, normals * area[:, None], int(chart.max(initial=-1)) + 1))


def _flatten(
    mesh: ScanMesh,
    chart: I32,
    label: I32,
    *,
    axes: Array,
    true_normals: Array,
    normals: Array,
    texel_m: Array,
) -> Charts:
    count = len(axes)
    owner = np.zeros(count, dtype=np.int32)
    owner[chart] = label
    flat = np.abs(axes[:, 2]) > 0.7
    helper = np.where(flat[:, None], (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    right = np.cross(helper, axes)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    up = np.cross(axes, right)
    facing = np.einsum("ij,ij->i", axes[chart], true_normals)
    worst = np.ones(count)
    np.minimum.at(worst, chart, np.maximum(facing, 0.08))
    texel = np.minimum(texel_m[owner], _COARSEST_M * np.sqrt(worst))
    points = mesh.vertices[mesh.faces]
    corner = np.stack(
        [np.einsum("fki,fi->fk", points, frame[chart]) for frame in (right, up)], axis=-1
    )
    corner /= texel[chart][:, None, None]
    low = np.full((count, 2), np.inf)
    high = np.full((count, 2), -np.inf)
    for k in range(3):
        np.minimum.at(low, chart, corner[:, k])
        np.maximum.at(high, chart, corner[:, k])
    corner -= low[chart][:, None]
    size = np.maximum(np.ceil(high - low), 1).astype(np.int64)
    # Lying charts pack better than standing ones.
    tall = size[:, 1] > size[:, 0]
    corner = np.where(tall[chart][:, None, None], corner[..., ::-1], corner)
    size = np.where(tall[:, None], size[:, ::-1], size)
    return Charts(chart, owner, corner, size, normals.astype(np.float32))


@dataclass(frozen=True)
class Packing:
    """Positions of the charts.

    Attributes:
        page: (C,) int64 page of each chart.
        origin: (C, 2) int64 x, y of each chart's first texel, padding excluded.
        page_size: width and height of every page [texels].
    """

    page: I64
    origin: I64
    page_size: tuple[tuple[int, int], ...]


def pack(charts: Charts, page_px: int) -> Packing:
    """Pack charts onto pages of at most `page_px` squared, in shelves.

    Raises:
        ValueError: one object alone does not fit on a page.
    """
    boxes = charts.size + 2 * PADDING
    objects = np.unique(charts.object)
    need = np.bincount(charts.object, boxes.prod(1))
    page = np.zeros(len(boxes), dtype=np.int64)
    origin = np.zeros((len(boxes), 2), dtype=np.int64)
    sizes: list[tuple[int, int]] = []
    at = 0
    while at < len(objects):
        total = np.cumsum(need[objects[at:]])
        # Shelves lose a little space, so that a full page's worth of area may overflow.
        take = max(int(np.searchsorted(total, 0.97 * page_px**2)), 1)
        while True:
            selected = np.flatnonzero(np.isin(charts.object, objects[at : at + take]))
            places, height = _shelves(boxes[selected], page_px)
            if height <= page_px:
                break
            if take == 1:
                raise ValueError(
                    f"texture of one object needs {height} rows; valid: at most page_px = {page_px}"
                )
            take = max(int(take * 0.95), 1) if take > 20 else take - 1
        page[selected] = len(sizes)
        origin[selected] = places + PADDING
        sizes.append((page_px, -(-height // 4) * 4))
        at += take
    return Packing(page, origin, tuple(sizes))


def _shelves(boxes: I64, width: int) -> tuple[I64, int]:
    """Return places (N, 2) of boxes (N, 2) in shelves of falling height, and the total height."""
    order = np.lexsort((boxes[:, 0], -boxes[:, 1]))
    places = np.zeros_like(boxes)
    x = y = shelf = 0
    for k in order.tolist():
        w, h = int(boxes[k, 0]), int(boxes[k, 1])
        if w > width:
            return places, 1 << 30
        if x + w > width:
            x, y, shelf = 0, y + shelf, 0
        places[k] = x, y
        x += w
        shelf = max(shelf, h)
    return places, y + shelf
