"""Tell the Gaussians of surfaces from floaters and far background, and find the space between.

No unit is known yet, so that every length follows from the extent of the capture itself.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ...formats.core.errors import SceneError
from ...formats.splats.record import GaussianCloud
from ..grid.morphology import distance_to

# Gaussians fainter than this never make a surface on their own.
MIN_OPACITY = 0.08
# Cells along the diagonal of the middle nine tenths of all Gaussians, for finding the main part.
COARSE_CELLS = 30
# A part of the capture with less than this share of its Gaussians is background.
MIN_SHARE = 0.02
# Cells of the volume in which free space is found.
CELLS = 200_000
# A Gaussian is a floater if its neighbourhood holds less than this share of the typical number.
FLOATER_SHARE = 0.04
# Larger ones, in cells, stand for no surface, unless they are as thin as this share.
MAX_SIZE_CELLS, FLAT = 2.0, 0.25
LEAST_GAUSSIANS = 500


@dataclass(frozen=True)
class Solid:
    """The part of a capture that physics is made of.

    Attributes:
        keep: (N,) bool: the Gaussian belongs to a surface.
        lower, upper: (3,) box of the surfaces, in units of the file.
        cell: side of a cell of `free` [units].
        origin: (3,) centre of its first cell.
        clearance: (X, Y, Z) float32 distance to the nearest surface where a camera may stand
            [units]; 0 elsewhere.
        floaters, background: numbers of Gaussians left out.
    """

    keep: NDArray[np.bool_]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    cell: float
    origin: NDArray[np.float64]
    clearance: NDArray[np.float32]
    floaters: int
    background: int


def find_solid(cloud: GaussianCloud) -> Solid:
    """Find surfaces and the free space that they enclose.

    Raises:
        SceneError: too few Gaussians for a scene.
    """
    visible = cloud.opacity >= MIN_OPACITY
    main = visible.copy()
    main[visible] = _main_part(cloud.position[visible].astype(np.float64))
    if main.sum() < LEAST_GAUSSIANS:
        raise SceneError(f"only {int(main.sum())} Gaussians lie close together")
    position = cloud.position.astype(np.float64)
    lower, upper = (np.quantile(position[main], q, axis=0) for q in (0.002, 0.998))
    if not (upper > lower).any():
        raise SceneError(f"its {int(main.sum()):,} Gaussians lie in one point")
    margin = 0.02 * float((upper - lower).max())
    lower, upper = lower - margin, upper + margin
    boxed = ((position > lower) & (position < upper)).all(1)
    inside = main & boxed
    cell = float((np.prod(upper - lower) / CELLS) ** (1 / 3))
    shape = np.ceil((upper - lower) / cell).astype(int)
    index = np.clip(((position - lower) / cell).astype(np.int64), 0, shape - 1)
    flat = np.ravel_multi_index(tuple(index.T), tuple(shape))
    flat = np.asarray(flat)
    count = np.bincount(flat[inside], minlength=int(np.prod(shape))).reshape(shape)
    around = ndimage.uniform_filter(count.astype(np.float32), 3, mode="constant") * 27
    typical = float(np.median(around.ravel()[flat[inside]]))
    dense = around.ravel()[flat] >= FLOATER_SHARE * typical
    size = np.sort(cloud.scale, axis=1)
    shaped = (size[:, 2] < MAX_SIZE_CELLS * cell) | (size[:, 0] < FLAT * size[:, 1])
    shaped &= size[:, 2] < 4 * MAX_SIZE_CELLS * cell
    keep = inside & dense & shaped
    if not keep.any():
        raise SceneError(f"none of its {len(cloud):,} Gaussians is as small as a part of a surface")
    weight = np.bincount(flat[keep], cloud.opacity[keep], minlength=count.size).reshape(shape)
    occupied = weight >= 0.1 * float(np.median(weight[weight > 0]))
    clearance = distance_to(occupied).astype(np.float32) * np.float32(cell)
    clearance[~enclosed(occupied)] = 0.0
    return Solid(
        keep,
        lower,
        upper,
        cell,
        lower + 0.5 * cell,
        clearance,
        floaters=int((visible & boxed & ~keep).sum()),
        background=int((visible & ~boxed).sum()),
    )


def enclosed(occupied: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the free cells (X, Y, Z) from which at least five of the six axes meet a surface."""
    met = np.zeros(occupied.shape, dtype=np.uint8)
    for axis in range(3):
        ahead = np.maximum.accumulate(occupied, axis=axis)
        behind = np.flip(np.maximum.accumulate(np.flip(occupied, axis), axis=axis), axis)
        met += ahead.astype(np.uint8) + behind.astype(np.uint8)
    return (met >= 5) & ~occupied


def _main_part(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points (N, 3) lie in the largest connected parts of the capture."""
    if len(points) < LEAST_GAUSSIANS:
        return np.zeros(len(points), dtype=bool)
    low, high = (np.quantile(points, q, axis=0) for q in (0.05, 0.95))
    cell = float(np.linalg.norm(high - low)) / COARSE_CELLS
    index = np.floor((points - low) / max(cell, 1e-12)).astype(np.int64)
    index = np.clip(index, -(1 << 19), 1 << 19)
    key = (index[:, 0] << 40) + (index[:, 1] << 20) + index[:, 2]
    cells, of, count = np.unique(key, return_inverse=True, return_counts=True)
    # Cells of the far background hold one or two Gaussians each.
    crowded = count >= max(3, 0.02 * float(np.median(count[of])))
    steps = [(i << 40) + (j << 20) + k for i, j, k in np.ndindex(3, 3, 3)]
    steps = [s - ((1 << 40) + (1 << 20) + 1) for s in steps]
    pairs = []
    for step in steps:
        at = np.clip(np.searchsorted(cells, cells + step), 0, len(cells) - 1)
        hit = np.flatnonzero((cells[at] == cells + step) & crowded & crowded[at])
        pairs.append(np.stack([hit, at[hit]]))
    i, j = np.concatenate(pairs, axis=1)
    graph = coo_matrix((np.ones(len(i)), (i, j)), shape=(len(cells), len(cells)))
    part = connected_components(graph, directed=False)[1]
    held = np.bincount(part, np.where(crowded, count, 0))
    return (held[part] >= MIN_SHARE * len(points))[of] & crowded[of]
