"""How open space is around each point of a scene: soft corners without tracing them per frame.

A coarse grid of ambient cubes (McTaggart, "Half-Life 2 / Valve Source shading", 2004): per cell and
per axis direction the share of the hemisphere that is free nearby. It is traced once per scene.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

f32 = np.float32

CELL_M = 0.2
MAX_CELLS = 300_000
RAYS = 40
REACH_M = 1.8  # farther surfaces do not darken


class OpennessGrid(NamedTuple):
    """Openness around the centres of cells.

    Attributes:
        cube: (Z, Y, X, 6) uint8, 255 = open; directions +x, −x, +y, −y, +z, −z. (1, 1, 1, 6) and
            open everywhere where nothing is lit by it.
        lower_m: (3,) float32 centre of cell (0, 0, 0).
        per_m: cells per metre.
    """

    cube: NDArray[np.uint8]
    lower_m: NDArray[np.float32]
    per_m: np.float32


def open_everywhere() -> OpennessGrid:
    """The grid that darkens nothing."""
    return OpennessGrid(
        np.full((1, 1, 1, 6), 255, dtype=np.uint8), np.zeros(3, dtype=f32), f32(1.0)
    )


def trace_openness(scene: EmbreeScene, vertices: NDArray[np.float32]) -> OpennessGrid:
    """Trace the grid over the bounds of `vertices` (V, 3) [m] in a committed or fresh scene."""
    lower, upper = vertices.min(0).astype(np.float64), vertices.max(0).astype(np.float64)
    cell = max(CELL_M, float((np.prod(upper - lower + CELL_M) / MAX_CELLS) ** (1 / 3)))
    counts = np.maximum(np.ceil((upper - lower) / cell).astype(int), 1)
    first = 0.5 * (lower + upper) - 0.5 * (counts - 1) * cell
    x, y, z = (first[k] + cell * np.arange(counts[k]) for k in range(3))
    grid = np.meshgrid(z, y, x, indexing="ij")
    origins = np.stack([grid[2], grid[1], grid[0]], axis=-1).reshape(-1, 3).astype(f32)

    directions = _sphere_directions(RAYS)
    axes = np.concatenate([np.eye(3), -np.eye(3)])[[0, 3, 1, 4, 2, 5]]
    weights = np.maximum(directions @ axes.T, 0.0).astype(f32)
    total = np.zeros((len(origins), 6), dtype=f32)
    outside = np.zeros(len(origins), dtype=f32)  # share of rays that see fronts or nothing
    for direction, weight in zip(directions.astype(f32), weights, strict=True):
        limits = np.full(len(origins), REACH_M, dtype=f32)
        hit = scene.run(origins, np.tile(direction, (len(origins), 1)), dists=limits, output=True)
        missed = hit["primID"] < 0
        free = np.where(missed, f32(1.0), hit["tfar"] / f32(REACH_M))
        total += free[:, None] * weight
        outside += missed | (hit["Ng"] @ direction < 0)
    cube = (total / weights.sum(0)).reshape(*counts[::-1], 6)
    trust = np.clip((outside / RAYS - 0.5) * 4.0, 0.02, 1.0).reshape(counts[::-1])
    return OpennessGrid(_filled(cube, trust), first.astype(f32), f32(1.0 / cell))


def _filled(cube: NDArray[np.floating], trust: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Replace cells inside of furniture and walls by what is around them."""
    spread = gaussian_filter(trust, 0.8, mode="nearest")
    mean = np.stack(
        [gaussian_filter(cube[..., k] * trust, 0.8, mode="nearest") / spread for k in range(6)],
        axis=-1,
    )
    mixed = trust[..., None] * cube + (1.0 - trust[..., None]) * mean
    return np.round(255.0 * np.clip(mixed, 0.0, 1.0)).astype(np.uint8)


def _sphere_directions(count: int) -> NDArray[np.float64]:
    """(count, 3) evenly spread unit vectors: a Fibonacci spiral."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * k
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)
