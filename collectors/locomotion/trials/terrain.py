"""Ground to train and to test gaits on."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.ndimage import gaussian_filter

from ....formats.core.arrays import Array, Mask


class Block(NamedTuple):
    """A box that stands on the plane: its sides and its height [m]."""

    x_m: tuple[float, float]
    y_m: tuple[float, float]
    z_m: float


class Lane(NamedTuple):
    """Flights up and down again in a strip along x.

    Attributes:
        y_m: its middle.
        riser_m, going_m: of all its flights.
        foot_m: (K,) where each flight begins that leads up in the direction of x.
        head_m: (K,) where those that lead down again end.
    """

    y_m: float
    riser_m: float
    going_m: float
    foot_m: Array
    head_m: Array


@dataclass(frozen=True)
class Terrain:
    """A square height field around the origin; None means an endless plane at z = 0.

    Attributes:
        height_m: (N, N) heights ≥ 0, row = y, column = x, or None.
        size_m: side of the square.
        blocks: boxes on a plane that have these heights, with sharp edges; a height field if none.
        lanes: stairs that these boxes are.
    """

    height_m: Array | None = None
    size_m: float = 0.0
    blocks: tuple[Block, ...] = ()
    lanes: tuple[Lane, ...] = ()

    def add_to(self, spec: mujoco.MjSpec) -> None:
        """Add the ground geom `floor`."""
        if self.height_m is None or self.blocks:
            plane = mujoco.mjtGeom.mjGEOM_PLANE
            spec.worldbody.add_geom(name="floor", type=plane, size=[0.0, 0.0, 1.0])
            for block in self.blocks:
                low, high = np.array([block.x_m, block.y_m, (0.0, block.z_m)]).T
                spec.worldbody.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_BOX, size=0.5 * (high - low), pos=0.5 * (low + high)
                )
            return
        top = float(self.height_m.max())
        rows, columns = self.height_m.shape
        spec.add_hfield(
            name="ground",
            size=[0.5 * self.size_m, 0.5 * self.size_m, top, 0.5],
            nrow=rows,
            ncol=columns,
            userdata=(self.height_m / top).ravel(),
        )
        spec.worldbody.add_geom(
            name="floor", type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="ground"
        )

    def at(self, xy_m: Array) -> Array:
        """Return the height under points (..., 2), nearest sample [m]."""
        if self.height_m is None:
            return np.zeros(xy_m.shape[:-1])
        last = len(self.height_m) - 1
        cell = np.clip(np.rint((xy_m / self.size_m + 0.5) * last), 0, last).astype(int)
        return self.height_m[cell[..., 1], cell[..., 0]]

    @property
    def half_m(self) -> float:
        """Half the side of the usable square; robots beyond it have left the terrain."""
        return np.inf if self.height_m is None else 0.5 * self.size_m - 1.0


def noise(rng: np.random.Generator, cells: int, cell_m: float, amplitude_m: float) -> Array:
    """Return smooth bumps of 0…amplitude, about 15 cm wide."""
    field = gaussian_filter(rng.normal(size=(cells, cells)), 0.06 / cell_m, mode="wrap")
    low, high = np.quantile(field, (0.02, 0.98))
    return amplitude_m * np.clip((field - low) / (high - low), 0.0, 1.0)


def steps(rng: np.random.Generator, cells: int, cell_m: float, height_m: float) -> Array:
    """Return the blocks of 0.5 m with random heights of 0…height."""
    block = round(0.5 / cell_m)
    count = -(-cells // block)
    heights = rng.uniform(0.0, height_m, (count, count))
    return heights.repeat(block, axis=0).repeat(block, axis=1)[:cells, :cells]


def pyramid(cells: int, cell_m: float, slope_deg: float) -> Array:
    """Return the ramps from all four sides up to the middle."""
    inward = cell_m * np.minimum(np.arange(cells), np.arange(cells)[::-1])
    return np.tan(np.deg2rad(slope_deg)) * np.minimum(inward[:, None], inward)


def rough_terrain(rng: np.random.Generator, size_m: float = 24.0, cell_m: float = 0.05) -> Terrain:
    """Return 4 m tiles in random order: flat, noise of 1–6 cm, steps of 2–5 cm, ramps of 3–10°."""
    tile = round(4.0 / cell_m)
    count = round(size_m / 4.0)
    height = np.zeros((count * tile, count * tile))
    for row in range(count):
        for column in range(count):
            kind = rng.choice(["flat", "noise", "steps", "ramps"], p=[0.35, 0.3, 0.15, 0.2])
            part = np.s_[row * tile : (row + 1) * tile, column * tile : (column + 1) * tile]
            if kind == "noise":
                height[part] = noise(rng, tile, cell_m, rng.uniform(0.01, 0.06))
            elif kind == "steps":
                height[part] = steps(rng, tile, cell_m, rng.uniform(0.02, 0.05))
            elif kind == "ramps":
                height[part] = pyramid(tile, cell_m, rng.uniform(3.0, 10.0))
    return Terrain(height, size_m)


def noise_terrain(
    rng: np.random.Generator, amplitude_m: float, size_m: float = 30.0, cell_m: float = 0.05
) -> Terrain:
    """Return one field of bumps of 0…amplitude everywhere, for evaluation."""
    return Terrain(noise(rng, round(size_m / cell_m), cell_m, amplitude_m), size_m)


def plate_terrain(
    rng: np.random.Generator, height_m: float, size_m: float = 30.0, cell_m: float = 0.05
) -> Terrain:
    """Return plates of 0.5 m, each 0…height high, for evaluation."""
    return Terrain(steps(rng, round(size_m / cell_m), cell_m, height_m), size_m)


def ramp_terrain(
    angle_deg: float, size_m: float = 30.0, cell_m: float = 0.05, run_m: float = 4.0
) -> Terrain:
    """Return the ridges and valleys along y: 4 m up, 4 m down, and so on, for evaluation."""
    x = cell_m * np.arange(round(size_m / cell_m))
    profile = np.tan(np.deg2rad(angle_deg)) * (run_m - np.abs(x % (2 * run_m) - run_m))
    return Terrain(np.tile(profile, (len(x), 1)), size_m)


LANE_M, FLAT_M, LANDING_M = 3.0, 2.0, 1.6
EDGE_M = 0.02  # cells of the heights over flights


def stairs_terrain(
    risers_m: Sequence[float],
    going_m: Sequence[float],
    steps: int,
    hills: int = 3,
) -> Terrain:
    """Return lanes of hills, each a flight of `steps` risers up and down again.

    Lanes are level at their ends and between hills for `FLAT_M`, on top for `LANDING_M`.
    """
    lengths = [hills * (2 * (steps - 1) * g + LANDING_M + FLAT_M) + 2 * FLAT_M for g in going_m]
    size_m = max(*lengths, LANE_M * len(risers_m)) + 2.0
    cells = round(size_m / EDGE_M) + 1
    height = np.zeros((cells, cells))
    at = (np.arange(cells) / (cells - 1) - 0.5) * size_m
    blocks, lanes = [], []
    for k, (riser, going) in enumerate(zip(risers_m, going_m, strict=True)):
        y = (k + 0.5 - 0.5 * len(risers_m)) * LANE_M
        sides = (y - 0.5 * LANE_M, y + 0.5 * LANE_M)
        run = 2 * (steps - 1) * going + LANDING_M
        nth = np.arange(hills, dtype=np.float64) - 0.5 * (hills - 1)
        foot = nth * (run + FLAT_M) - 0.5 * run
        for start in foot:
            for step in range(steps):
                ends = (start + step * going, start + run - step * going)
                blocks.append(Block(ends, sides, (step + 1) * riser))
                inside = np.ix_(_within(at, sides), _within(at, ends))
                height[inside] = (step + 1) * riser
        lanes.append(Lane(y, riser, going, foot, foot + run))
    return Terrain(height, size_m, tuple(blocks), tuple(lanes))


def _within(at: Array, ends: tuple[float, float]) -> Mask:
    return (at >= ends[0]) & (at <= ends[1])
