"""Draw a scene of Gaussians: chunks from near to far, each Gaussian once, until tiles are full.

Chunks are taken in groups, in order of their nearest centre. What lies nearer than any chunk still
to come is sorted and blended; the rest waits. As soon as all pixels of a tile are opaque, chunks
behind it are not even projected: the picture is that of a full sort at a fraction of its cost.
"""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import F32, I32, I64, Array
from ...formats.core.camera import CameraModel
from .blend import TABLE, blend_tiles, count_unfinished, list_tiles, split_by_depth
from .project import COLUMNS, TILE, cull_chunks, project_chunks
from .scene import CHUNK, SplatScene

NEAR_M = 0.05
# Gaussians that are projected, sorted and blended together.
GROUP = 32_768


@dataclass(frozen=True)
class SplatImage:
    """A drawn image.

    Attributes:
        color: (H, W, 3) float32 sRGB 0–1 over black.
        light: (H, W) float32 share of the background's light that gets through.
        depth_m: (H, W) float32 mean planar depth, weighted by light [m]; 0 where nothing is.
        deviation_m: (H, W) float32 standard deviation of that depth [m].
        median_m: (H, W) float32 depth at which half of the light is gone; 0 = never.
    """

    color: F32
    light: F32
    depth_m: F32
    deviation_m: F32
    median_m: F32


@dataclass(frozen=True)
class Eye:
    """The camera and pose of an image.

    Attributes:
        position_world_m: (3,) optical centre.
        rotation_world: (3, 3) optical axes as columns.
    """

    camera: CameraModel
    position_world_m: Array
    rotation_world: Array


def draw_splats(
    scene: SplatScene,
    eye: Eye,
    *,
    cover_m: F32 | None = None,
    cut_above_m: float = np.inf,
    with_depth: bool = False,
    near_m: float = NEAR_M,
    detail_px: float = 0.0,
    least_light: float = 0.0,
) -> SplatImage:
    """Draw the Gaussians as seen from `eye`.

    Args:
        cover_m: (H, W) depth of an opaque body in front of the scene [m], inf = none; what lies
            behind it is left out.
        cut_above_m: if the camera is above this world z, Gaussians above it are left out.
        with_depth: compute the depths, which are empty otherwise.
        near_m: Gaussians nearer than this are left out.
        detail_px: chunks are drawn at the coarsest level of detail whose Gaussians have a standard
            deviation below this [px]; 0 = draw the capture itself.
        least_light: a pixel is finished as soon as less of the light than this gets through: the
            colour then is at most so far off. 0 = where the published formula stops.
    """
    camera = eye.camera
    width, height = camera.width_px, camera.height_px
    state = _State.of(width, height, cover_m, with_depth)
    position = np.asarray(eye.position_world_m, dtype=np.float64)
    rotation = np.ascontiguousarray(eye.rotation_world, dtype=np.float64)
    cut = cut_above_m if position[2] > cut_above_m else np.inf
    view = np.array([0.5 * width / camera.focal_px, 0.5 * height / camera.focal_px, near_m])
    count = scene.width.shape[1]
    nearest = np.empty(count)
    low, high, reach = (bound[:count] for bound in (scene.low, scene.high, scene.reach))
    cull_chunks(low, high, reach, rotation, position, view, nearest)
    visible = np.flatnonzero(np.isfinite(nearest))
    visible = visible[np.argsort(nearest[visible], kind="stable")]
    limits = nearest[visible]
    if detail_px > 0:
        visible = _at_detail(scene, visible, limits, detail_px / camera.focal_px)
    settings = (near_m, float(scene.antialiased), cut)
    lines = (rotation, position, np.array([camera.focal_px, width, height, *settings]))
    gaussians = (scene.position, scene.covariance, scene.opacity)
    data = (*gaussians, scene.color, scene.harmonics, scene.starts)
    bounds = (scene.low, scene.high, scene.reach)
    image = (state.light, state.color, state.cover, state.depth)
    step, enough = GROUP // CHUNK, np.float32(least_light)
    rows = np.empty((2 * GROUP, COLUMNS), dtype=np.float32)
    unfinished = np.zeros((height + 1, width + 1), dtype=np.int32)
    waiting = 0
    for start in range(0, len(visible), step):
        group = visible[start : start + step]
        needed = waiting + len(group) * CHUNK
        if needed > len(rows):
            rows = np.concatenate([rows, np.empty((needed, COLUMNS), dtype=np.float32)])
        count_unfinished(state.light, state.alive.shape[1], unfinished)
        if not unfinished[-1, -1]:
            break
        count = project_chunks(group, data, bounds, lines, unfinished, rows, waiting)
        last = start + step >= len(visible)
        limit = np.inf if last else limits[start + step]
        near, waiting = split_by_depth(rows, waiting, count, limit, unfinished)
        if len(near):
            lists = list_tiles(near, state.alive)
            blend_tiles(near, lists, state.alive, (width, height, enough), image, TABLE)
    return state.image(width, height)


def _at_detail(scene: SplatScene, visible: I64, nearest_m: Array, slope: float) -> I64:
    """Return chunks at their coarsest levels whose Gaussians look narrower than `slope`.

    A merged Gaussian may lie before the chunk's nearest centre by no more than the bounds of that
    chunk, since it is a mean of centres: the order of chunks holds for all levels.
    """
    count = scene.width.shape[1]
    level = np.zeros(len(visible), dtype=np.int64)
    for k in range(1, len(scene.width)):
        level[scene.width[k, visible] < slope * nearest_m] = k
    return visible + count * level


@dataclass(frozen=True)
class _State:
    """The image while it is drawn, tile by tile; see `blend_tiles`."""

    alive: I32
    light: F32
    color: F32
    cover: F32
    depth: F32

    @staticmethod
    def of(width: int, height: int, cover_m: F32 | None, with_depth: bool) -> "_State":
        rows, columns = -(-height // TILE), -(-width // TILE)
        down = np.minimum(height - TILE * np.arange(rows), TILE)
        across = np.minimum(width - TILE * np.arange(columns), TILE)
        count = rows * columns
        cover = np.full((count, TILE * TILE), np.inf, dtype=np.float32)
        if cover_m is not None:
            padded = np.full((rows * TILE, columns * TILE), np.inf, dtype=np.float32)
            padded[:height, :width] = cover_m
            tiles = padded.reshape(rows, TILE, columns, TILE).swapaxes(1, 2)
            cover = np.ascontiguousarray(tiles).reshape(count, -1)
        return _State(
            np.outer(down, across).astype(np.int32),
            np.ones((count, TILE * TILE), dtype=np.float32),
            np.zeros((count, TILE * TILE, 3), dtype=np.float32),
            cover,
            np.zeros((count if with_depth else 0, TILE * TILE, 3), dtype=np.float32),
        )

    def image(self, width: int, height: int) -> SplatImage:
        rows, columns = self.alive.shape

        def whole(tiles: F32) -> F32:
            shape = (rows, columns, TILE, TILE, *tiles.shape[2:])
            image = tiles.reshape(shape).swapaxes(1, 2)
            image = image.reshape(rows * TILE, columns * TILE, *tiles.shape[2:])
            return np.ascontiguousarray(image[:height, :width])

        light = np.abs(whole(self.light))
        none = np.zeros((0, 0), dtype=np.float32)
        if not len(self.depth):
            return SplatImage(whole(self.color), light, none, none, none)
        sums = whole(self.depth)
        weight = np.maximum(1 - light, 1e-6)
        mean = (sums[..., 0] / weight).astype(np.float32)
        spread = np.sqrt(np.maximum(sums[..., 1] / weight - mean**2, 0))
        return SplatImage(whole(self.color), light, mean, spread, sums[..., 2].copy())
