"""Close thin spots of a capture for physics: surfaces with only a few faint Gaussians left.

Where training saw too little, a seat or a patch of floor is a loose sheet of small Gaussians that
lets nearly all light through. Nothing else lies in their plane, so that each may cover the space up
to its neighbours.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from ...formats.core.frames import quat_to_matrix
from ...formats.splats.record import GaussianCloud

NEIGHBOURS, COPLANAR = 5, 4
# A Gaussian stands apart if its fifth neighbour is further than this many of its standard
# deviations; where surfaces are closed that is 1.5 to 2.5.
APART = 2.8
# What lies further apart is no sheet [m].
MOST_M = 0.08
# Distance of neighbours from its plane, as a share of their distance.
OFF_PLANE = 0.3
# Thickest a flat Gaussian is, as a share of its middle axis.
FLAT = 0.6
# Only Gaussians that share a cell of this size with few others are looked at [m].
CELL_M, FEW = 0.03, 4
# Standard deviation, as a share of the distance to the fifth neighbour, and opacity.
SPREAD, OPACITY = 0.55, 0.9


def with_thin_spots_closed(surfaces: GaussianCloud) -> GaussianCloud:
    """Return the Gaussians of surfaces, in metres, those of loose sheets widened and opaque."""
    size = np.sort(surfaces.scale, axis=1)
    cell = np.floor((surfaces.position - surfaces.position.min(0)) / CELL_M).astype(np.int64)
    key = (cell[:, 0] << 42) | (cell[:, 1] << 21) | cell[:, 2]
    _, of, count = np.unique(key, return_inverse=True, return_counts=True)
    lonely = count[of.ravel()] <= FEW
    rows = np.flatnonzero(lonely & (size[:, 0] < FLAT * size[:, 1]))
    if len(surfaces) <= NEIGHBOURS or not len(rows):
        return surfaces
    tree = KDTree(surfaces.position, balanced_tree=False, compact_nodes=False)
    distance, near = tree.query(surfaces.position[rows], k=NEIGHBOURS + 1)
    reach = np.asarray(distance)[:, -1]
    apart = (reach > APART * size[rows, 1:].mean(1)) & (reach < MOST_M)
    rows, reach, near = rows[apart], reach[apart], np.asarray(near)[apart, 1:]
    axes = quat_to_matrix(surfaces.quat_wxyz[rows])
    thinnest = np.argmin(surfaces.scale[rows], axis=1)
    normal = np.take_along_axis(axes, thinnest[:, None, None], axis=2)[..., 0]
    away = surfaces.position[near] - surfaces.position[rows, None]
    off = np.abs(np.einsum("nki,ni->nk", away, normal))
    sheet = (off < OFF_PLANE * reach[:, None]).sum(1) >= COPLANAR
    rows, reach, thinnest = rows[sheet], reach[sheet], thinnest[sheet]
    scale, opacity = surfaces.scale.copy(), surfaces.opacity.copy()
    wide = np.maximum(scale[rows], (SPREAD * reach[:, None]).astype(np.float32))
    np.put_along_axis(
        wide, thinnest[:, None], np.take_along_axis(scale[rows], thinnest[:, None], 1), axis=1
    )
    scale[rows] = wide
    opacity[rows] = np.maximum(opacity[rows], np.float32(OPACITY))
    return replace(surfaces, scale=scale, opacity=opacity)
