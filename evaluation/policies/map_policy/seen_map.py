"""The map that a robot makes while it walks: floor, obstacles, walls and named things.

Everything is in the start frame (`observation.Start`), from depth images, camera poses and labels.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_dilation

from ....formats.core.frames import Array
from ....formats.scene.bundle import LabeledObject
from ....formats.scene.freemap import Freemap
from ....formats.scene.grid import GridSpec
from ...observation import Lens
from .heights import CELL_M, Heights, Mask

HALF_M = 25.0  # the map reaches so far from the start
FARTHEST_M = 7.0  # depth beyond is not trusted
_FLOOR_M = 0.12  # points lower than this are floor
_DROP_M = 0.25  # and what lies so far below it is a drop
_HIGHEST_M = 1.7  # and those above could not be hit
_OWN_BODY_M = 0.3  # points this close to the base are the robot itself
_HITS = 2  # points that make an obstacle
# What fills all of these heights is a wall (as in `wayfinding.regions`).
_SLICES_M = ((0.5, 0.9), (0.95, 1.3), (1.35, 1.65))
_STRIDE = 2  # pixels
_BLIND_STEPS = 12
_SMALLEST = 25  # points of a thing that is believed
# Quantiles of a thing's points that bound it: pixels on edges belong to what is behind, and the
# boxes of a model, whose things have no key, hold other things, too.
_KEYED_TRIM, _NAMED_TRIM = (0.01, 0.99), (0.1, 0.9)
_SIGHTS = 2  # images of a thing without a key that is believed
_SAME_M = 0.6  # such things of one noun this close to each other are one
_GAP_M = 0.5  # what lies this much farther away than the rest of a box is another thing


@dataclass(frozen=True)
class Detection:
    """One thing in an image.

    Attributes:
        noun: what it is called (`sofa`, `wall`).
        key: the same for the same thing in other images; None = unknown, the map finds it by name
            and place.
        pixels: (H, W) bool; of a thing without a key they are a box with the thing in it.
    """

    noun: str
    key: str | None
    pixels: Mask


@dataclass
class SeenThing:
    """A thing seen so far.

    Attributes:
        low_m, high_m: (3,) bounds in the start frame [m].
        points: number of points.
        sights: number of images with it.
        certain: its key is known, and its pixels are its own.
    """

    noun: str
    low_m: Array
    high_m: Array
    points: int
    sights: int = 1
    certain: bool = True


@dataclass
class SeenMap:
    """The map of all that has been seen so far.

    Attributes:
        floor_m: height of this level's floor in the start frame [m]; the map's own heights are
            above it.
        grid: cells of `CELL_M` about the start.
        floor: (R, C) bool floor was seen, or lies between the robot and the nearest floor seen.
        hits: (R, C) number of points between floor and head, or far below the floor.
        slices: (R, C) uint8, a bit for each height of `_SLICES_M` with a point.
        wall: (R, C) bool labelled wall.
        opening: (R, C) bool labelled door frame: never wall.
        things: by key.
        heights: of all points.
    """

    floor_m: float = 0.0
    grid: GridSpec = field(
        default_factory=lambda: GridSpec(
            (-HALF_M, -HALF_M), CELL_M, round(2 * HALF_M / CELL_M), round(2 * HALF_M / CELL_M)
        )
    )
    things: dict[str, SeenThing] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Begin with an empty map."""
        self.floor: Mask = np.zeros(self.grid.shape, bool)
        self.hits: NDArray[np.int32] = np.zeros(self.grid.shape, np.int32)
        self.slices: NDArray[np.uint8] = np.zeros(self.grid.shape, np.uint8)
        self.wall: Mask = np.zeros(self.grid.shape, bool)
        self.opening: Mask = np.zeros(self.grid.shape, bool)
        self.heights = Heights(self.grid)

    @property
    def obstacle(self) -> Mask:
        """(R, C) whether something stands in the cell."""
        return self.hits >= _HITS

    @property
    def explored(self) -> Mask:
        """(R, C) whether the cell has been seen, as floor or as obstacle."""
        return self.floor | self.obstacle

    @property
    def free(self) -> Mask:
        """(R, C) whether the cell is known to be free."""
        return self.floor & ~self.obstacle

    @property
    def walls(self) -> Mask:
        """(R, C) whether the cell is labelled wall, or filled at all heights of `_SLICES_M`."""
        return self.wall | (self.slices == 2 ** len(_SLICES_M) - 1)

    def add(
        self,
        depth_m: NDArray[np.float32],
        lens: Lens,
        base_xy_m: Array,
        detections: Iterable[Detection] = (),
    ) -> None:
        """Add one image.

        Args:
            depth_m: (H, W) planar z [m], 0 = nothing.
            base_xy_m: (2,) where the robot stands [m].
        """
        points = _points(depth_m, lens) - (0.0, 0.0, self.floor_m)
        z = points[..., 2]
        away = np.linalg.norm(points[..., :2] - base_xy_m, axis=-1)
        valid = np.isfinite(z) & (away > _OWN_BODY_M)
        floor = valid & (np.abs(z) < _FLOOR_M)
        self._mark(self.floor, points[floor])
        self._near_floor(points[floor], away[floor], base_xy_m)
        self.heights.add(points[valid & ~_seen_from_below(points)])
        # What lies lower is no floor to walk on either.
        solid = valid & (((z >= _FLOOR_M) & (z < _HIGHEST_M)) | (z < -_DROP_M))
        cells = self._cells(points[solid])
        np.add.at(self.hits, (cells[:, 0], cells[:, 1]), 1)
        for bit, (bottom, top) in enumerate(_SLICES_M):
            cells = self._cells(points[valid & (z >= bottom) & (z < top)])
            self.slices[cells[:, 0], cells[:, 1]] |= np.uint8(1 << bit)
        for detection in detections:
            mask = valid & detection.pixels[::_STRIDE, ::_STRIDE]
            if detection.noun == "wall":
                self._mark(self.wall, points[mask & solid])
            elif detection.noun in ("door frame", "door"):
                self._mark(self.opening, points[mask])
            elif detection.key is None:
                box = np.flatnonzero(mask & (z >= _FLOOR_M))
                surface = box[_connected(away.ravel()[box])]
                self._add_thing(detection, points.reshape(-1, 3)[surface])
            else:
                self._add_thing(detection, points[mask])

    def bump(self, xy_m: Array) -> None:
        """Put an obstacle at a point (2,) [m] where the robot hit something unseen."""
        cells = self._cells(np.asarray(xy_m)[None])
        self.hits[cells[:, 0], cells[:, 1]] += _HITS

    def objects(self) -> list[LabeledObject]:
        """Return the things seen, as a scene's objects in the start frame."""
        return [
            LabeledObject(
                key,
                thing.noun,
                (float(thing.low_m[0]), float(thing.low_m[1]), float(thing.low_m[2])),
                (float(thing.high_m[0]), float(thing.high_m[1]), float(thing.high_m[2])),
                0,
            )
            for key, thing in self.things.items()
            if thing.points >= _SMALLEST and (thing.certain or thing.sights >= _SIGHTS)
        ]

    def window(self, margin_m: float = 1.0) -> tuple[slice, slice]:
        """Return rows and columns of what has been explored, with a margin."""
        cells = np.argwhere(self.explored)
        margin = round(margin_m / CELL_M)
        low = np.maximum(cells.min(0) - margin, 0)
        high = np.minimum(cells.max(0) + margin + 1, self.grid.shape)
        return slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1]))

    def open_floor(self) -> Mask:
        """Return (R, C) the floor between the walls, furniture included; see `regions`."""
        wall = self.walls & ~self.opening
        return np.asarray(binary_closing(self.explored, iterations=2)) & ~wall

    def freemap(self, window: tuple[slice, slice]) -> Freemap:
        """Return the part of the map in a window, as a scene's map of free floor."""
        free = self.free[window]
        return Freemap(self.cut(window), np.where(free, 0.0, np.nan).astype(np.float32), free)

    def cut(self, window: tuple[slice, slice]) -> GridSpec:
        """Return the grid of a window."""
        rows, columns = window
        x, y = self.grid.origin_xy_m
        origin = (x + columns.start * CELL_M, y + rows.start * CELL_M)
        return GridSpec(origin, CELL_M, rows.stop - rows.start, columns.stop - columns.start)

    def _near_floor(self, points: Array, away: Array, base_xy_m: Array) -> None:
        """Take the floor between the robot and the nearest floor seen, below the image, as free."""
        if not len(points):
            return
        near = points[away < away.min() + 0.5][::4, :2]
        share = np.linspace(0.0, 1.0, _BLIND_STEPS)[:, None, None]
        self._mark(self.floor, (base_xy_m + share * (near - base_xy_m)).reshape(-1, 2))

    def _add_thing(self, detection: Detection, points: Array) -> None:
        if not len(points):
            return
        certain = detection.key is not None
        low, high = np.quantile(points, _KEYED_TRIM if certain else _NAMED_TRIM, axis=0)
        key = detection.key or self._same(detection.noun, 0.5 * (low + high))
        thing = self.things.get(key)
        if thing is None:
            self.things[key] = SeenThing(detection.noun, low, high, len(points), certain=certain)
            return
        thing.low_m = np.minimum(thing.low_m, low)
        thing.high_m = np.maximum(thing.high_m, high)
        thing.points += len(points)
        thing.sights += 1

    def _same(self, noun: str, middle_m: Array) -> str:
        """Return the key of the thing that has this name and place, or a new one."""
        for key, thing in self.things.items():
            gap = middle_m - np.clip(middle_m, thing.low_m, thing.high_m)
            if thing.noun == noun and not thing.certain and np.linalg.norm(gap) <= _SAME_M:
                return key
        return f"{noun}-{len(self.things)}"

    def _mark(self, mask: Mask, points: Array) -> None:
        cells = self._cells(points)
        mask[cells[:, 0], cells[:, 1]] = True

    def _cells(self, points: Array) -> NDArray[np.int64]:
        cells = self.grid.cell_of(points[:, :2])
        return cells[self.grid.inside(cells)]


def _connected(away_m: Array) -> NDArray[np.int64]:
    """Return the points of a box whose distances (N,) [m] have no gap to that of the middle one."""
    order = np.argsort(away_m)
    part = np.cumsum(np.diff(away_m[order], prepend=0.0) > _GAP_M)
    return order[part == part[len(part) // 2]] if len(part) else order


def _seen_from_below(points: Array) -> Mask:
    """Return (h, w) where points (h, w, 3) lie on a surface that faces down."""
    right, down = np.diff(points, axis=1)[:-1], np.diff(points, axis=0)[:, :-1]
    away = np.cross(right, down)  # from the camera
    steep = away[..., 2] > 0.7 * np.linalg.norm(away, axis=-1)
    return np.asarray(binary_dilation(np.pad(steep, ((0, 1), (0, 1))), np.ones((3, 3))))


def _points(depth_m: NDArray[np.float32], lens: Lens) -> Array:
    """Return points (h, w, 3) [m] of every `_STRIDE`-th pixel; NaN where depth is not trusted."""
    z = depth_m[::_STRIDE, ::_STRIDE].astype(np.float64)
    z[(z <= 0.0) | (z > FARTHEST_M)] = np.nan
    rows, columns = np.indices(z.shape) * _STRIDE
    k = lens.model.intrinsics
    x = (columns - k[0, 2]) / k[0, 0] * z
    y = (rows - k[1, 2]) / k[1, 1] * z
    return np.stack([x, y, z], axis=-1) @ lens.rotation.T + lens.position_m


def behind_walls(seen: SeenMap, from_m: Array, to_m: Array) -> Mask:
    """Return whether (N,) a wall stands between points (N, 2) and (N, 2) [m]."""
    share = np.linspace(0.0, 0.9, 10)[:, None, None]
    cells = seen.grid.cell_of(from_m + share * (to_m - from_m))
    cells = np.clip(cells, 0, np.array(seen.grid.shape) - 1)
    return np.asarray(seen.walls[cells[..., 0], cells[..., 1]].any(axis=0))
