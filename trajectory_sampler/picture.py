"""Draw paths over the planning map they were sampled on."""

import colorsys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from ..formats.core.atomic import write_bytes
from ..formats.core.episode import Episode
from ..formats.core.geometry import resample
from ..formats.core.images import image_file
from ..formats.scene.bundle import SceneBundle
from ..formats.scene.freemap import Freemap

# Walkable, occupied though there is floor, no floor.
_FREE, _OCCUPIED, _NO_FLOOR = (248, 247, 243), (168, 163, 156), (58, 58, 62)
_START, _GOAL = (26, 152, 80), (43, 95, 184)
_LONGEST_SIDE_PX = 1600
_MOST_PX_PER_M = 80.0
_OVERSAMPLED = 2  # lines are drawn larger and scaled down, which smooths them
_GOLDEN = 0.618034  # steps of hue that keep any number of neighbours apart


def draw_paths(freemap: Freemap, episodes: Sequence[Episode], level: int) -> Image.Image:
    """Return the reference paths on one level over its planning map, north (+y) up.

    Every path has a colour of its own; starts are green and goals blue. Of a path over storeys, the
    part on the level is drawn, with half of the stairs.
    """
    grid = freemap.grid
    cells = np.full((*grid.shape, 3), _NO_FLOOR, dtype=np.uint8)
    cells[np.isfinite(freemap.floor_z_m)] = _OCCUPIED
    cells[freemap.traversable] = _FREE
    px_per_m = min(_MOST_PX_PER_M, _LONGEST_SIDE_PX / (max(grid.shape) * grid.cell_m))
    scale = px_per_m * _OVERSAMPLED
    height, width = (max(1, round(n * grid.cell_m * scale)) for n in grid.shape)
    size = width, height
    image = Image.fromarray(cells[::-1].copy()).resize(size, Image.Resampling.NEAREST)
    pen = ImageDraw.Draw(image)

    def pixels(points_m: NDArray[np.float64]) -> list[tuple[float, float]]:
        xy = (points_m[:, :2] - np.asarray(grid.origin_xy_m)) * scale
        return [(float(x), size[1] - float(y)) for x, y in xy]

    width, radius = max(1, round(0.04 * scale)), 0.07 * scale
    for number, episode in enumerate(episodes):
        path = episode.reference_path_world_m
        if episode.staircases:
            path = resample(path, 1.0 / px_per_m)
            path = path[episode.levels_along(path) == level]
        pen.line(pixels(path), fill=_hue(number), width=width, joint="curve")
    for episode in episodes:
        ends = pixels(episode.reference_path_world_m[[0, -1]])
        on = episode.levels[0], episode.levels[-1]
        for (x, y), color, own in zip(ends, (_START, _GOAL), on, strict=True):
            if own == level:
                pen.ellipse((x - radius, y - radius, x + radius, y + radius), fill=color)
    return image.resize([n // _OVERSAMPLED for n in size], Image.Resampling.LANCZOS)


def write_pictures(folder: Path, bundle: SceneBundle, episodes: Sequence[Episode]) -> list[Path]:
    """Write `<scene>-<level>.png` for every level that has episodes; return the files."""
    written = []
    for level in sorted({level for episode in episodes for level in episode.levels}):
        here = [episode for episode in episodes if level in episode.levels]
        freemap = bundle.freemap(level).for_height(here[0].free_height_m)
        path = folder / f"{bundle.scene_id}-{level}.png"
        write_bytes(path, image_file(draw_paths(freemap, here, level), "PNG"))
        written.append(path)
    return written


def _hue(number: int) -> tuple[int, int, int]:
    red, green, blue = colorsys.hsv_to_rgb(number * _GOLDEN % 1.0, 0.85, 0.8)
    return round(255 * red), round(255 * green), round(255 * blue)
