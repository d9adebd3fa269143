"""InteriorGS' occupancy map as a surface: floor where it is free, walls around everything else.

Layout: the dataset's README (grey values; the JSON file relates pixels to the splats' coordinates)
and SAGE-3D's public code (`scale` is metres per pixel, `min` the lower corner; rows run along +y,
columns along −x). That code is the only source for the direction of the axes, so the map is checked
against the splats.
"""

from pathlib import Path

import cv2
import numpy as np

from ...formats.core.arrays import I64, Array, Mask
from ...formats.core.errors import FileFormatError
from ...formats.splats.record import GaussianCloud
from ...formats.untrusted.documents import parse_json
from ...formats.untrusted.files import read_input
from ..scan.record import Scan, ScanMaterial
from ..scan.soup import Part, merge_parts

FREE = 255
FLOOR_Z_M, WALL_M = 0.0, 2.5
MAX_BYTES, MAX_META_BYTES, MAX_SIDE_PX = 64 << 20, 1 << 20, 8192
SCALES_M = (0.001, 0.5)
# Heights above the floor at which Gaussians stand for obstacles.
OBSTACLE_M = (0.3, 1.2)
GREY = (0.75, 0.74, 0.72)


def read_occupancy(path: Path, cloud: GaussianCloud) -> Scan:
    """Read `occupancy.png` and the JSON file beside it; `cloud` are the splats in its coordinates.

    Raises:
        FileFormatError: damaged, without JSON file or free space, or not laid out as documented.
    """
    image = cv2.imdecode(
        np.frombuffer(read_input(path, max_bytes=MAX_BYTES), np.uint8), cv2.IMREAD_GRAYSCALE
    )
    if image is None or max(image.shape) > MAX_SIDE_PX:
        raise FileFormatError(path, f"not an image of up to {MAX_SIDE_PX} × {MAX_SIDE_PX} pixels")
    scale, origin = _metadata(path.with_suffix(".json"))
    # Rows along +y, columns along +x.
    free = image[:, ::-1] == FREE
    if not free.any():
        raise FileFormatError(path, f"has no free pixel; valid: {FREE} where the floor is free")
    _check_directions(path, free, scale, origin, cloud)
    quads = np.concatenate([_floor(free), *_walls(free)]).astype(np.float64)
    quads[..., :2] = quads[..., :2] * scale + origin
    faces = 4 * np.arange(len(quads))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
    faces = faces.reshape(-1, 3)
    uv = np.zeros((len(faces), 3, 2), dtype=np.float32)
    part = Part(
        "occupancy", "", quads.reshape(-1, 3), faces, uv, ScanMaterial("occupancy", GREY), None
    )
    note = f"surface from {path.name}: {int(free.sum()) * scale**2:.1f} m² of free floor, walls "
    note += f"of {WALL_M} m around all else, whose true heights the map does not tell"
    up = ("z", "InteriorGS is z up by its documentation")
    return merge_parts([part], [note], up, ("m", "InteriorGS is in metres by its documentation"))


def _metadata(path: Path) -> tuple[float, Array]:
    """Return metres per pixel and the lower corner (2,) [m]."""
    if not path.is_file():
        raise FileFormatError(path, "missing; it holds the position of the map")
    data = parse_json(path, read_input(path, max_bytes=MAX_META_BYTES))
    try:
        scale, origin = float(data["scale"]), np.array(data["min"][:2], dtype=np.float64)
        valid = SCALES_M[0] <= scale <= SCALES_M[1] and origin.shape == (2,)
        if not valid or not (np.abs(origin) < 1e5).all():
            raise ValueError(f"scale {scale}, min {origin.tolist()}")
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise FileFormatError(
            path,
            f"not an occupancy map's metadata ({error!r}); valid: scale within "
            f"{SCALES_M[0]}–{SCALES_M[1]} m per pixel, min as a list of coordinates",
        ) from error
    return scale, origin


def _check_directions(
    path: Path, free: Mask, scale: float, origin: Array, cloud: GaussianCloud
) -> None:
    """Raise FileFormatError if obstacles among the splats fit a mirrored map better."""
    position = cloud.position.astype(np.float64) + cloud.offset
    height = position[:, 2] - FLOOR_Z_M
    solid = (height > OBSTACLE_M[0]) & (height < OBSTACLE_M[1]) & (cloud.opacity > 0.3)
    cell = np.floor((position[solid, :2] - origin) / scale).astype(np.int64)
    cell = cell[((cell >= 0) & (cell < free.shape[::-1])).all(1)]
    if not len(cell):
        raise FileFormatError(path, "no splat lies on it; use the map of the same scene")

    def wrong(picture: Mask) -> float:
        return float(picture[cell[:, 1], cell[:, 0]].mean())

    share = wrong(free)
    others = min(wrong(free[::-1]), wrong(free[:, ::-1]), wrong(free[::-1, ::-1]))
    if share > others + 0.02:
        raise FileFormatError(
            path,
            f"{share:.0%} of the splats at the height of furniture lie where it is free, but "
            f"{others:.0%} if it is mirrored: its axes are not as documented",
        )


def _floor(free: Mask) -> Array:
    """Return quads (N, 4, 3) over runs of free pixels, xy in pixels, seen from above."""
    row, start, end = _runs(free)
    low, high = np.c_[start, row], np.c_[end, row + 1]
    corners = [low, np.c_[high[:, 0], low[:, 1]], high, np.c_[low[:, 0], high[:, 1]]]
    return np.stack([np.c_[c, np.full(len(c), FLOOR_Z_M)] for c in corners], axis=1)


def _walls(free: Mask) -> list[Array]:
    """Return upright quads (N, 4, 3) along the border of the free pixels, facing them."""
    padded = np.pad(free, 1)
    quads = []
    for axis in (0, 1):
        for behind in (False, True):
            lower, upper = (padded[:-1], padded[1:]) if axis == 0 else (padded.T[:-1], padded.T[1:])
            border = (upper & ~lower) if behind else (lower & ~upper)
            line, start, end = _runs(border)
            # Padding moved everything by one pixel; the border lies between two lines.
            ends = [np.c_[start - 1, line], np.c_[end - 1, line]]
            if behind == (axis == 0):
                ends.reverse()
            ends = [e if axis == 0 else e[:, ::-1] for e in ends]
            low = [np.c_[e, np.full(len(e), FLOOR_Z_M)] for e in ends]
            high = [np.c_[e, np.full(len(e), FLOOR_Z_M + WALL_M)] for e in ends]
            quads.append(np.stack([low[0], low[1], high[1], high[0]], axis=1))
    return quads


def _runs(mask: Mask) -> tuple[I64, I64, I64]:
    """Return row, first column and end (exclusive) of each run of true pixels."""
    change = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, start = np.nonzero(change == 1)
    return row, start, np.nonzero(change == -1)[1]
