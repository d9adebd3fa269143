"""A picture of the map seen so far, for people."""

import numpy as np
from numpy.typing import NDArray

from .seen_map import CELL_M, SeenMap

_UNSEEN, _FREE, _OBSTACLE, _WALL = (70, 70, 70), (225, 225, 225), (150, 110, 80), (20, 20, 20)
_TRACK, _TARGET, _START = (40, 90, 220), (220, 40, 40), (30, 160, 60)


def draw_map(
    seen: SeenMap,
    track_m: NDArray[np.float64],
    target_m: NDArray[np.float64] | None = None,
    pixels_per_cell: int = 4,
) -> NDArray[np.uint8]:
    """Return a picture (H, W, 3) uint8 of the map: x to the right, y up.

    Dark grey is unseen, light grey free, brown an obstacle, black a wall. The way walked is blue,
    its start green, the target red.

    Args:
        track_m: (T, 2) where the robot has been [m].
        target_m: (2,) where it is going [m].
    """
    rows, columns = seen.window()
    image = np.empty((*seen.grid.shape, 3), np.uint8)
    image[:] = _UNSEEN
    image[seen.floor] = _FREE
    image[seen.obstacle] = _OBSTACLE
    image[seen.obstacle & seen.walls] = _WALL
    marks = [(track_m, _TRACK), (track_m[:1], _START)]
    if target_m is not None:
        marks.append((np.asarray(target_m)[None], _TARGET))
    for points, colour in marks:
        reach = 0 if colour is _TRACK else 1
        for dr in range(-reach, reach + 1):
            for dc in range(-reach, reach + 1):
                cells = seen.grid.cell_of(points + np.array([dc, dr]) * CELL_M)
                cells = cells[seen.grid.inside(cells)]
                image[cells[:, 0], cells[:, 1]] = colour
    cut = image[rows, columns][::-1]
    return cut.repeat(pixels_per_cell, axis=0).repeat(pixels_per_cell, axis=1)
