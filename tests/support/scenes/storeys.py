"""A tiny building of two storeys, written straight through the public records.

Below, two rooms of 5 × 4 m (x 0…5 and 5…10, y 0…4) with a doorway at y 1.5…2.5 in the wall x = 5.
From the second one a straight flight leads up along y = 2 from x = 10 to x = 13 to the upper storey
at 2.8 m, again two rooms (x 13…18 and 18…23). Known by heart, so tests can state exact truths.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.support.scenes.rooms import write_two_rooms
from vlnpe.formats.core.arrays import Mask
from vlnpe.formats.scene.bundle import (
    Floor,
    LabeledObject,
    Obstacles,
    SceneBundle,
    load_bundle,
    save_bundle,
)
from vlnpe.formats.scene.freemap import Freemap
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.formats.scene.staircase import Staircase, Treads

TOP_M, RISERS, FOOT_X, HEAD_X = 2.8, 16, 10.4, 13.0
WIDTH_M, APRON_M = 1.2, 0.8
STAND_M = 0.4  # the line begins and ends so far before and behind the steps
LINE = np.array(
    [
        [FOOT_X - STAND_M, 2.0, 0.0],
        [FOOT_X, 2.0, 0.0],
        [HEAD_X, 2.0, TOP_M],
        [HEAD_X + STAND_M, 2.0, TOP_M],
    ]
)
LENGTH_M = float(np.linalg.norm(np.diff(LINE, axis=0), axis=1).sum())
SPIRAL = Staircase((0, 1), LINE + np.array([0.0, 9.0, 0.0]), 0.5, 0.2, 0.1, "is a spiral")


def write_two_storeys(
    root: Path, cell_m: float = 0.05, rise_m: float = TOP_M, risers: int = RISERS
) -> SceneBundle:
    """Write the bundle into `root` and open it; its first staircase is one that nobody climbs."""
    line = LINE * (1.0, 1.0, rise_m / TOP_M)
    low = _level((0.0, 0.0), (FOOT_X, 4.0), 5.0, 0.0, cell_m)
    high = _level((HEAD_X, 0.0), (HEAD_X + 10.0, 4.0), HEAD_X + 5.0, rise_m, cell_m)
    half_m = 0.5 * WIDTH_M
    lower = np.array([FOOT_X - APRON_M, 2.0 - half_m])
    upper = np.array([HEAD_X + APRON_M, 2.0 + half_m])
    grid, xy = _cells(lower, upper, cell_m)
    going_m = (HEAD_X - FOOT_X) / (risers - 1)
    step = np.clip(np.floor((xy[..., 0] - FOOT_X) / going_m) + 1, 0, risers)
    inside = np.all((xy > lower) & (xy < upper), axis=-1)
    stairs = _sheet(grid, step / risers * rise_m, inside, inside)
    middle_m = FOOT_X + going_m * (np.arange(risers - 1) + 0.5)
    top_m = np.linspace(0.0, rise_m, risers + 1)[1:-1]
    treads = Treads(
        np.column_stack([middle_m, np.full_like(middle_m, 2.0), top_m - 0.1]).astype(np.float64),
        np.tile([0.5 * going_m, half_m, 0.1], (risers - 1, 1)),
        np.zeros(risers - 1),
    )
    rooms = [("kitchen", 0.0, 0), ("hall", 5.0, 0), ("landing", HEAD_X, 1)]
    rooms.append(("bedroom", HEAD_X + 5.0, 1))
    bundle = write_two_rooms(root)
    bundle = replace(
        bundle,
        scene_id="two_storeys",
        level_floor_z_m=(0.0, rise_m),
        staircases=(SPIRAL, Staircase((0, 1), line, WIDTH_M, rise_m / risers, going_m)),
        objects=tuple(
            LabeledObject(
                f"Room_{kind}",
                f"room:{kind}",
                (x, 0.0, level * rise_m),
                (x + 5.4, 4.0, level * rise_m + 2.5),
                level,
            )
            for kind, x, level in rooms
        ),
    )
    save_bundle(bundle, bundle.visual(), [low, high], {1: (*stairs, treads)})
    return load_bundle(root)


def _level(
    lower: tuple[float, float],
    upper: tuple[float, float],
    wall_x: float,
    z_m: float,
    cell_m: float,
) -> tuple[Floor, Obstacles, Freemap]:
    grid, xy = _cells(lower, upper, cell_m)
    inside = np.all((xy > lower) & (xy < upper), axis=-1)
    wall = (np.abs(xy[..., 0] - wall_x) < 0.051) & (np.abs(xy[..., 1] - 2.0) > 0.5)
    return _sheet(grid, np.full(grid.shape, z_m), inside, inside & ~wall)


def _cells(lower, upper, cell_m: float) -> tuple[GridSpec, np.ndarray]:
    grid = GridSpec.covering(np.array(lower) - 0.5, np.array(upper) + 0.5, cell_m)
    return grid, grid.center_of(np.moveaxis(np.indices(grid.shape), 0, -1))


def _sheet(
    grid: GridSpec, height_m: np.ndarray, covered: Mask, free: Mask
) -> tuple[Floor, Obstacles, Freemap]:
    height = height_m.astype(np.float32)
    walls = np.argwhere(covered & ~free)
    center = np.column_stack([grid.center_of(walls), height_m[tuple(walls.T)] + 1.25])
    half = np.tile([grid.cell_m / 2, grid.cell_m / 2, 1.25], (len(walls), 1))
    return (
        Floor(grid, height, covered),
        Obstacles(center.reshape(-1, 3), half.reshape(-1, 3)),
        Freemap(
            grid,
            np.where(covered, height, np.nan).astype(np.float32),
            free,
            np.where(free, np.inf, 0.0).astype(np.float32),
        ),
    )
