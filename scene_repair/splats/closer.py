"""Further cameras for surfaces that no station sees: the inside of a bathtub, floor behind a chair.

Gaussians around which the volume has seen nothing are grouped, and for each group a camera is
chosen from which most of it can be seen.
"""

import numpy as np

from ...formats.core.arrays import Array, Mask
from ...formats.core.frames import look_at
from ...formats.splats.record import GaussianCloud
from ...geometry.fusion.volume import DistanceVolume
from .solid import Solid

# Gaussians fainter than this make no surface worth a camera.
LEAST_OPACITY = 0.3
GROUP_M, LEAST_GAUSSIANS = 0.4, 12
# Groups that are looked at in one round, those with the most Gaussians first.
MOST_GROUPS = 160
# A voxel of less weight counts as unseen, as for meshing.
SEEN_WEIGHT = 0.5
# How far from a group its camera stands, and how far from any surface.
NEAREST_M, FARTHEST_M, CLEARANCE_M = 0.25, 2.2, 0.09
CANDIDATES, SAMPLES = 160, 12
# Cells in which lines of sight are tested. A line may end so far before its Gaussian.
SIGHT_CELL_M, SIGHT_END_M = 0.05, 0.1
LEAST_SHARE = 0.25

View = tuple[Array, Array]


def closer_views(
    surfaces: GaussianCloud, volume: DistanceVolume, solid: Solid, factor: float
) -> list[View]:
    """Return cameras, each as optical centre (3,) [m] and optical axes as columns (3, 3).

    `surfaces` are in normalised lengths [m], of which `factor` make a unit of the file; `volume` is
    what was seen of them so far, `solid` where cameras may stand, in units of the file.
    """
    position = surfaces.position.astype(np.float64)
    opaque = surfaces.opacity >= LEAST_OPACITY
    hidden = position[opaque & ~_seen(volume, position)]
    places = _places(solid, factor)
    if not len(hidden) or not len(places):
        return []
    sight = _Sight(position[opaque])
    # One stream of random numbers for a capture: the same file gives the same surface.
    rng = np.random.default_rng(len(position))
    views = []
    for group in _groups(hidden):
        view = _view_of(group, places, sight, rng)
        if view is not None:
            views.append(view)
    return views


def _seen(volume: DistanceVolume, points: Array) -> Mask:
    """Return whether the voxel of each point (N, 3) or one that shares a face with it was seen."""
    index = np.rint((points - volume.origin_m) / volume.voxel_m).astype(np.int64)
    most = np.array(volume.weight.shape) - 1
    seen = np.zeros(len(points), dtype=bool)
    for step in (np.zeros(3), *np.eye(3), *-np.eye(3)):
        at = np.clip(index + step.astype(np.int64), 0, most)
        seen |= volume.weight[tuple(at.T)] > SEEN_WEIGHT
    return seen


def _groups(points: Array) -> list[Array]:
    """Return points that lie in the same cell of a coarse grid, the largest groups first."""
    cell = np.floor(points / GROUP_M).astype(np.int64)
    _, of, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    largest = np.argsort(-count, kind="stable")[:MOST_GROUPS]
    order = np.argsort(of.ravel(), kind="stable")
    ends = np.cumsum(count)
    return [
        points[order[ends[k] - count[k] : ends[k]]] for k in largest if count[k] >= LEAST_GAUSSIANS
    ]


def _places(solid: Solid, factor: float) -> Array:
    cells = np.argwhere(solid.clearance * factor > CLEARANCE_M)
    return factor * (solid.origin + solid.cell * cells)


class _Sight:
    """Cells that surfaces occupy, for testing lines of sight."""

    def __init__(self, points: Array):
        self._lower = points.min(0)
        index = ((points - self._lower) / SIGHT_CELL_M).astype(np.int64)
        self._occupied = np.zeros(index.max(0) + 1, dtype=bool)
        self._occupied[tuple(index.T)] = True

    def open(self, eyes: Array, targets: Array) -> Mask:
        """Return (E, T) whether the line from an eye (E, 3) to a target (T, 3) is free."""
        direction = targets[None] - eyes[:, None]
        length = np.linalg.norm(direction, axis=2)
        direction = direction / np.maximum(length, 1e-9)[..., None]
        free = length > SIGHT_END_M
        shape = np.array(self._occupied.shape)
        for reached in np.arange(0, float(length.max()), 0.6 * SIGHT_CELL_M):
            point = eyes[:, None] + reached * direction
            index = np.floor((point - self._lower) / SIGHT_CELL_M).astype(np.int64)
            met = self._occupied[tuple(np.moveaxis(np.clip(index, 0, shape - 1), -1, 0))]
            met &= ((index >= 0) & (index < shape)).all(2)
            free &= ~met | (reached > length - SIGHT_END_M)
        return free


def _view_of(group: Array, places: Array, sight: _Sight, rng: np.random.Generator) -> View | None:
    """Return the camera that sees most of a group (N, 3); None if none sees enough of it."""
    target = np.median(group, axis=0)
    distance = np.linalg.norm(places - target, axis=1)
    near = np.flatnonzero((distance > NEAREST_M) & (distance < FARTHEST_M))
    if not len(near):
        return None
    near = rng.choice(near, min(CANDIDATES, len(near)), replace=False)
    samples = rng.choice(group, min(SAMPLES, len(group)), replace=False)
    share = sight.open(places[near], samples).mean(1)
    # Of those that see as much the nearest, whose image is the finest.
    best = near[np.lexsort((distance[near], -np.round(share, 1)))[0]]
    if share.max() < LEAST_SHARE:
        return None
    return places[best], look_at(places[best], target)
