"""Infer the unit of length from room heights, door heights and the overall size."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ...formats.core.arrays import Array
from ...formats.core.geometry import distinct_rows
from ..config import UNIT_M, metres_per
from ..scan.record import Scan
from .gravity import Surfaces, height_range

# What is usual [m], and how far (standard deviation of the logarithm) buildings differ from it.
ROOM_M, ROOM_SPREAD = 2.65, 0.20
DOOR_M, DOOR_SPREAD, OPENING_SPREAD = 2.04, 0.08, 0.15
WIDTH_M, WIDTH_SPREAD = 8.0, 0.9
# Rooms are rarely lower or higher than this, but halls are as high as they are wide, up to a limit.
LOW_ROOM_M, HIGH_ROOM_M, HALL_M = 2.0, 6.0, 40.0
# No single measure outweighs all others.
WORST = -20.0
# Few scans are in these units; they must fit better than the others.
PRIOR = {"m": 0.0, "cm": -0.7, "mm": -0.7, "ft": -1.5, "in": -1.5}
PEAK_SHARE = 0.25
# Level area at one height of less than this share of the ground plan is neither floor nor ceiling.
PLAN_SHARE = 0.25
LEVEL, UPRIGHT = 0.95, 0.2
# With fewer upright faces than this, points spread over them stand for them instead of centres.
FEW_FACES = 5000
# Doors: samples of walls in columns, in parts of the room's height.
WALL_SAMPLES, COLUMN = 200_000, 1 / 40
DOOR_SHARE, DOOR_COLUMNS = (0.5, 0.87), 6
OPENINGS = "openings in walls"


@dataclass(frozen=True)
class Sizes:
    """Measures in source units; 0 = not measured.

    `room` reaches from floor to ceiling or the walls' top; `door_source` says where `door`, the
    height of openings, was read; `width` and `narrow` are the longer and shorter side.
    """

    room: float
    door: float
    door_source: str
    width: float
    narrow: float = 0.0


def measure(scan: Scan, surfaces: Surfaces, to_z_up: Array) -> Sizes:
    """Measure a scan whose up direction is the last row of the rotation `to_z_up` (3, 3)."""
    up = to_z_up[2]
    floor, room = room_height(surfaces, up)
    narrow, width = sorted(float(np.ptp(height_range(surfaces, row))) for row in to_z_up[:2])
    doors = [
        float(np.ptp(scan.vertices[scan.faces[selected].ravel()] @ up))
        for thing, selected in zip(scan.objects, scan.object_faces(), strict=True)
        if thing.category.split()[-1:] == ["door"] and len(selected)
    ]
    if doors:
        door, source = float(np.median(doors)), f"{len(doors)} labelled"
    else:
        door, source = _door_height(surfaces, to_z_up, floor, room)
    return Sizes(room, door, source, width, narrow)


def room_height(surfaces: Surfaces, up: Array) -> tuple[float, float]:
    """Return a floor's height along `up` (3,), and the largest gap to the next level surface."""
    height = surfaces.centers @ up
    low, high = height_range(surfaces, up)
    tall = max(high - low, 1e-12)
    level = np.abs(surfaces.normals @ up) > LEVEL
    histogram, edges = np.histogram(
        height[level], 200, (low - 0.02 * tall, high + 0.02 * tall), weights=surfaces.area[level]
    )
    smooth = np.convolve(histogram, np.ones(3), mode="same")
    if not smooth.max() > PLAN_SHARE * _ground_plan(surfaces, up):
        return low, tall
    middle = 0.5 * (edges[1:] + edges[:-1])
    strong = middle[smooth > PEAK_SHARE * smooth.max()]
    gaps = np.diff(strong)
    if len(gaps) and gaps.max() > 0.25 * tall:
        return float(strong[np.argmax(gaps)]), float(gaps.max())
    # No ceiling: as high as the walls are.
    floor = float(strong[0])
    return floor, max(high - floor, 0.0)


def _ground_plan(surfaces: Surfaces, up: Array) -> float:
    """Return the area of the convex hull seen along `up` (3,); 0 if it is a line."""
    across = np.linalg.svd(up[None])[2][1:]
    try:
        return float(ConvexHull(surfaces.points @ across.T).volume)
    except QhullError:
        return 0.0


def hall(room_m: float, narrow_m: float) -> bool:
    """Return whether a high room is a hall: no higher than the building's shorter side."""
    return HIGH_ROOM_M < room_m <= min(narrow_m, HALL_M)


def _door_height(
    surfaces: Surfaces, to_z_up: Array, floor: float, room: float
) -> tuple[float, str]:
    """Return the typical lower edge of lintels: walls that start high and reach the ceiling.

    Walls under windows reach down, so that only openings from the floor up count.
    """
    if not room > 0:
        return 0.0, ""
    upright = np.abs(surfaces.normals @ to_z_up[2]) < UPRIGHT
    many = np.count_nonzero(upright) >= FEW_FACES
    places = surfaces.centers[upright] if many else surfaces.points[upright[surfaces.point_face]]
    height = places @ to_z_up[2]
    inside = (height > floor) & (height < floor + 1.05 * room)
    places, height = places[inside], height[inside]
    if len(places) < DOOR_COLUMNS:
        return 0.0, ""
    step = max(1, len(places) // WALL_SAMPLES)
    places, height = places[::step], height[::step]
    column = np.floor(places @ to_z_up[:2].T / (2 * COLUMN * room)).astype(int)
    cell = distinct_rows(column)[1]
    share = (height - floor) / room
    lowest = np.full(int(cell.max()) + 1, np.inf)
    highest = np.full(len(lowest), -np.inf)
    np.minimum.at(lowest, cell, share)
    np.maximum.at(highest, cell, share)
    lintel = (lowest > DOOR_SHARE[0]) & (lowest < DOOR_SHARE[1]) & (highest > 0.9)
    if not many:
        # Columns that a wall barely enters have few points, anywhere.
        count = np.bincount(cell)
        lintel &= count >= 0.5 * np.median(count) * (1.0 - lowest)
    if lintel.sum() < DOOR_COLUMNS:
        return 0.0, ""
    histogram, edges = np.histogram(lowest[lintel], 14, DOOR_SHARE)
    best = int(np.argmax(histogram))
    selected = lowest[lintel & (lowest >= edges[best]) & (lowest <= edges[best + 1])]
    return float(np.median(selected)) * room, OPENINGS


def infer_unit(sizes: Sizes) -> tuple[str, str, float]:
    """Return the unit in which the sizes are most likely, the evidence, and its lead."""
    scores = {name: PRIOR[name] + _fit(sizes, length) for name, length in UNIT_M.items()}
    ranked = sorted(scores, key=lambda name: -scores[name])
    best, second = ranked[0], ranked[1]
    lead = scores[best] - scores[second]
    doubt = f"; {second} is nearly as likely, see --unit" if lead < 2.0 else ""
    return best, f"{sizes_in(sizes, best)}{doubt}", lead


def sizes_in(sizes: Sizes, unit: str) -> str:
    """Return the sizes in words, if the source is in `unit`."""
    length = metres_per(unit)
    facts = [f"in {unit} rooms are {sizes.room * length:.2f} m high"]
    if sizes.door:
        facts.append(f"doors {sizes.door * length:.2f} m ({sizes.door_source})")
    return ", ".join([*facts, f"the whole is {sizes.width * length:.2f} m long"])


def _fit(sizes: Sizes, length: float) -> float:
    """Return the log-likelihood of the sizes in a unit of `length` metres."""
    total = 0.0
    for value, usual, spread in (
        (sizes.room, ROOM_M, ROOM_SPREAD),
        (sizes.door, DOOR_M, OPENING_SPREAD if sizes.door_source == OPENINGS else DOOR_SPREAD),
        (sizes.width, WIDTH_M, WIDTH_SPREAD),
    ):
        if value > 0:
            total += max(-0.5 * (np.log(value * length / usual) / spread) ** 2, WORST)
    return total
