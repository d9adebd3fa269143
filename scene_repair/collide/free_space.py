"""Free space of a robot, and the surfaces it can touch."""

import numpy as np
from scipy import ndimage

from ...formats.core.arrays import F32, U8, Array, Mask
from ..grid.morphology import distance_to, grow_box, label
from .boxes import MAY, MUST, NEVER
from .voxels import STEPS, Voxels

# Floor is a place if it is this large and a disc of this radius fits somewhere; what is smaller
# is the inside of a wall or a cupboard.
MIN_PLACE_M2, MIN_PLACE_RADIUS_M = 1.0, 0.32
# A surface that wavers over a voxel's border by less than this share is the neighbour's.
SLIVER = 0.25
# Boxes may spread this many voxels into space that nothing reaches.
SPREAD = 3


def headroom(voxels: Voxels, height_m: Array, above_m: float) -> F32:
    """Return the free height (rows, columns) [m] above the floor, infinite where all is free.

    What ends at most `above_m` above the floor is stepped over and does not count.
    """
    side = voxels.grid.cell_m
    layers = voxels.upper.shape[2]
    bottom = voxels.z0_m + side * np.arange(layers)
    top = bottom + side * (voxels.upper[..., 2] / STEPS)
    in_the_way = voxels.occupied & (top > height_m[..., None] + above_m)
    lowest = np.argmax(in_the_way, axis=2)[..., None]
    lower = np.take_along_axis(voxels.lower[..., 2], lowest, axis=2)[..., 0] / STEPS
    free = np.maximum(bottom[lowest[..., 0]] + side * lower - height_m, 0.0)
    return np.where(in_the_way.any(axis=2), free, np.inf).astype(np.float32)


def places(free: Mask, cell_m: float) -> Mask:
    """Return the connected parts of `free` (rows, columns) that are large enough for a robot."""
    parts, count = label(free)
    area = np.bincount(parts.ravel(), minlength=count + 1) * cell_m**2
    radius = distance_to(~np.pad(free, 1))[1:-1, 1:-1] * cell_m
    widest = np.asarray(ndimage.maximum(radius, parts, np.arange(count + 1)))
    roomy = (area >= MIN_PLACE_M2) & (widest >= MIN_PLACE_RADIUS_M)
    roomy[0] = False
    return roomy[parts]


def touchable(voxels: Voxels, place: Mask, height_m: Array) -> U8:
    """Return what boxes must, may and must not cover, (rows, columns, layers) as in `boxes`.

    Air that a probe of three voxels reaches from a `place` (rows, columns) for robots stays air;
    the surfaces next to it must be covered. What nothing reaches (insides of walls and furniture,
    gaps narrower than the probe, the world behind the walls) is left open, so that boxes can be
    large.
    """
    occupied = voxels.occupied
    layers = occupied.shape[2]
    center = voxels.z0_m + voxels.grid.cell_m * (np.arange(layers) + 0.5)
    ground = center[None, None, :] < height_m[..., None]
    # Below the floor and above the top the probe finds no resistance: it only has to fit sideways.
    solid = np.pad(occupied, ((1, 1), (1, 1), (0, 0)), constant_values=True)
    fits = ~grow_box(solid)[1:-1, 1:-1]
    parts, count = label(fits & ~ground)
    reached = np.zeros(count + 1, dtype=bool)
    reached[np.unique(parts[place])] = True
    reached[0] = False
    air = grow_box(reached[parts]) & ~occupied
    air |= place[..., None] & ~occupied & ~ground
    near = grow_box(air)
    sliver, stands = _slivers(voxels)
    must = (occupied & near & ~sliver) | stands
    state = np.full(occupied.shape, NEVER)
    state[grow_box(must, SPREAD) & ~air] = MAY
    state[must] = MUST
    return state


def _slivers(voxels: Voxels) -> tuple[Mask, Mask]:
    """Return voxels into which a surface barely reaches from an occupied neighbour in x or y.

    The neighbours that stand for them are returned, too; no voxel is both.
    """
    least = round(SLIVER * STEPS)
    sliver = np.zeros(voxels.upper.shape[:3], dtype=bool)
    stands = np.zeros_like(sliver)
    for index_axis, extent_axis in ((0, 1), (1, 0)):
        lower, upper = voxels.lower[..., extent_axis], voxels.upper[..., extent_axis]
        occupied = voxels.occupied
        for step, thin, reaches in (
            (1, upper <= least, upper >= STEPS - 1),
            (-1, lower >= STEPS - least, lower <= 1),
        ):
            neighbour = np.roll(occupied & reaches & ~sliver, step, axis=index_axis)
            thin_ends = occupied & thin & neighbour & ~stands
            sliver |= thin_ends
            stands |= np.roll(thin_ends, -step, axis=index_axis)
    return sliver, stands
