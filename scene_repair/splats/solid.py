"""Tell the Gaussians of surfaces from floaters and far background, and find the space between.

No unit is known yet, so that every length follows from the extent of the capture itself.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ...formats.core.arrays import F32, Array, Mask
from ...formats.core.errors import SceneError
from ...formats.splats.record import GaussianCloud
from ..grid.morphology import distance_to, linked

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
# Half-open space from this share of the volume on is a part of a room; objects have less around.
# Enclosed space that makes up less than this share of it is pockets.
OPEN_SHARE, POCKET_SHARE = 0.2, 0.25


@dataclass(frozen=True)
class Solid:
    """The part of a capture that physics is made of.

    Attributes:
        keep: (N,) bool: the Gaussian belongs to a surface.
        lower, upper: (3,) box of the surfaces, in units of the file.
        cell, origin: side of the cells of `clearance`, and centre (3,) of the first one.
        clearance: (X, Y, Z) distance to the nearest surface where a camera may stand, else 0.
        floaters, background: numbers of Gaussians left out.
    """

    keep: Mask
    lower: Array
    upper: Array
    cell: float
    origin: Array
    clearance: F32
    floaters: int
    background: int


def find_solid(cloud: GaussianCloud) -> Solid:
    """Find surfaces and the free space that they enclose; raise SceneError if there are too few."""
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


def enclosed(occupied: Mask) -> Mask:
    """Return the free cells (X, Y, Z) from which most of the six axes meet a surface.

    Five do in a room. Where that leaves only pockets, as under a table, while four or three leave
    much, the capture is a part of a room, which is open on some sides.
    """
    met = np.zeros(occupied.shape, dtype=np.uint8)
    for axis in range(3):
        ahead = np.maximum.accumulate(occupied, axis=axis)
        behind = np.flip(np.maximum.accumulate(np.flip(occupied, axis), axis=axis), axis)
        met += ahead.astype(np.uint8) + behind.astype(np.uint8)
    spaces = [(met >= sides) & ~occupied for sides in (5, 4, 3)]
    widest = float(spaces[-1].mean())
    if widest < OPEN_SHARE:
        return spaces[0]
    return next(space for space in spaces if space.mean() >= POCKET_SHARE * widest)


def _main_part(points: Array) -> Mask:
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
    first, second = np.concatenate(pairs, axis=1)
    part = linked(first, second, len(cells))
    held = np.bincount(part, np.where(crowded, count, 0))
    return (held[part] >= MIN_SHARE * len(points))[of] & crowded[of]
