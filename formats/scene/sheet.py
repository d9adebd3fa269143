"""Sheets of a scene: floor, collision boxes and planning map of a level or a staircase."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from ..core.arrays import F32, I32, Array, Mask
from .arrays import grid_arrays, grid_of, known_fields, record_of, save_npz
from .freemap import Freemap
from .grid import GridSpec


@dataclass(frozen=True)
class Floor:
    """Floor of one level as heights at the cell centres of a grid.

    Attributes:
        height_m: (rows, columns) float32 world z [m]; defined everywhere (extended outside).
        covered: (rows, columns) bool: there is floor (scanned or filled) in this cell.
    """

    grid: GridSpec
    height_m: F32
    covered: Mask


@dataclass(frozen=True)
class Obstacles:
    """Axis-aligned collision boxes of one level.

    Attributes:
        center_m: (N, 3) float64 world [m].
        half_m: (N, 3) float64 half sides [m].
        box_object: (N,) int32 index into the bundle's objects of what most of the box covers, −1 =
            no named thing; left out, all are −1.
    """

    center_m: Array
    half_m: Array
    box_object: I32 = field(default_factory=lambda: np.empty(0, dtype=np.int32))

    def __post_init__(self) -> None:
        if not len(self.box_object) and len(self.center_m):
            object.__setattr__(self, "box_object", np.full(len(self.center_m), -1, dtype=np.int32))


def read_floor(folder: Path) -> Floor:
    """Load the floor of the sheet in a folder."""
    path = folder / "floor.npz"
    return record_of(path, lambda data: Floor(grid_of(data), data["height_m"], data["covered"]))


def read_obstacles(folder: Path) -> Obstacles:
    """Load the collision boxes of the sheet in a folder."""
    path = folder / "obstacles.npz"
    return record_of(path, lambda data: Obstacles(**known_fields(Obstacles, data)))


def read_freemap(folder: Path) -> Freemap:
    """Load the planning map of the sheet in a folder."""
    path = folder / "freemap.npz"
    return record_of(path, lambda data: Freemap(grid_of(data), **known_fields(Freemap, data)))


def save_sheet(folder: Path, floor: Floor, obstacles: Obstacles, freemap: Freemap) -> None:
    """Write a sheet into a folder."""
    save_npz(folder / "floor.npz", **grid_arrays(floor.grid), **_without_grid(floor))
    save_npz(folder / "obstacles.npz", **vars(obstacles))
    save_npz(folder / "freemap.npz", **grid_arrays(freemap.grid), **_without_grid(freemap))


def _without_grid(record: Floor | Freemap) -> dict[str, Any]:
    return {f.name: getattr(record, f.name) for f in fields(record) if f.name != "grid"}
