"""Which way is up, how long is a unit, and is the floor level: the transform into the world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..formats.errors import SceneError
from .bounds import robust_bounds
from .config import UNIT_M, RepairConfig
from .scan import Scan

# Rows give world x, y, z in source coordinates; each is a rotation. y up is Habitat's convention.
_TO_Z_UP = {
    "z": np.eye(3),
    "-z": np.diag([1.0, -1.0, -1.0]),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "-y": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "x": np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    "-x": np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]]),
}
# A building, or one room of it, measured along its longer side.
MIN_EXTENT_M, MAX_EXTENT_M = 1.0, 1000.0
MIN_HEIGHT_M, MAX_HEIGHT_M = 1.5, 60.0
USUAL_STOREY_M = 2.7


@dataclass(frozen=True)
class Orientation:
    """The way from source coordinates to the world.

    Attributes:
        source_to_world: (4, 4) similarity.
        habitat_to_world: (4, 4) rigid, see `SceneBundle.habitat_to_world`.
        evidence: what was decided and why, as JSON values.
    """

    source_to_world: NDArray[np.float64]
    habitat_to_world: NDArray[np.float64]
    evidence: dict[str, Any]


def orient(scan: Scan, config: RepairConfig) -> Orientation:
    """Decide up axis and unit from settings, file or shape, and the levelling rotation.

    Raises:
        SceneError: no unit makes the extent that of a building.
    """
    normals, area = _normals(scan.vertices, scan.faces)
    if config.up != "auto":
        up, up_reason = config.up, "given by the user"
    elif scan.up is not None:
        up, up_reason = scan.up
    else:
        up, up_reason = _infer_up(scan, normals, area)
    to_z_up = _TO_Z_UP[up]
    lower, upper = robust_bounds(scan.vertices @ to_z_up.T, scan.faces)
    extent = upper - lower
    if config.unit != "auto":
        unit, unit_reason = config.unit, "given by the user"
    elif scan.unit is not None:
        unit, unit_reason = scan.unit
    else:
        unit, unit_reason = _infer_unit(extent)
    scale = UNIT_M[unit]
    _check_extent(extent * scale, unit)
    level, tilt_deg = _levelling(normals @ to_z_up.T, area, config)
    source_to_world = np.eye(4)
    source_to_world[:3, :3] = scale * level @ to_z_up
    habitat_to_world = np.eye(4)
    habitat_to_world[:3, :3] = level @ _TO_Z_UP["y"]
    return Orientation(
        source_to_world,
        habitat_to_world,
        {
            "up": up,
            "up_reason": up_reason,
            "unit": unit,
            "unit_reason": unit_reason,
            "extent_m": [round(float(v), 4) for v in extent * scale],
            "tilt_deg": round(tilt_deg, 4),
            "levelled": bool(not np.array_equal(level, np.eye(3))),
        },
    )


def _normals(
    vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    cross = np.cross(b - a, c - a)
    doubled = np.linalg.norm(cross, axis=1)
    return cross / doubled[:, None], 0.5 * doubled


def _infer_up(
    scan: Scan, normals: NDArray[np.float64], area: NDArray[np.float64]
) -> tuple[str, str]:
    """The axis that most area faces along, and its side that carries the things.

    Floors, ceilings and table tops share one direction, while walls divide their area between two;
    and storeys are lower than buildings are wide. The floor is at the end near which more surface
    lies: furniture stands, it does not hang.
    """
    along = np.array([area[np.abs(normals[:, axis]) > 0.9].sum() for axis in range(3)])
    lower, upper = robust_bounds(scan.vertices, scan.faces)
    extent = upper - lower
    axis = int(np.argmax(along / np.maximum(extent, 1e-9)))
    centers = scan.vertices[scan.faces].mean(axis=1)[:, axis]
    height = (centers - lower[axis]) / max(float(extent[axis]), 1e-12)
    things = (height > 0.05) & (height < 0.95)
    weight = area[things].sum()
    mean = float((height[things] * area[things]).sum() / weight) if weight > 0 else 0.0
    sign = "" if mean <= 0.5 else "-"
    share = along[axis] / max(area.sum(), 1e-300)
    return sign + "xyz"[axis], (
        f"{100 * share:.0f} % of the area faces along {'xyz'[axis]}, over {extent[axis]:.4g} units "
        f"of height; what lies between floor and ceiling is at {100 * mean:.0f} % on average"
    )


def _infer_unit(extent: NDArray[np.float64]) -> tuple[str, str]:
    best, best_cost = None, np.inf
    for unit in ("m", "cm", "mm"):
        size = extent * UNIT_M[unit]
        if not MIN_EXTENT_M <= size[:2].max() <= MAX_EXTENT_M or size[2] > MAX_HEIGHT_M:
            continue
        # Whole storeys of a usual height; scans are mostly of one storey, seldom of many.
        cost = abs(np.log(max(size[2], 0.3) / USUAL_STOREY_M))
        if cost < best_cost:
            best, best_cost = unit, cost
    if best is None:
        return "m", "no unit makes this a building; taken as metres"
    size = extent * UNIT_M[best]
    return best, (
        f"as {best} it measures {size[0]:.2f} × {size[1]:.2f} × {size[2]:.2f} m, "
        f"nearest to a storey of {USUAL_STOREY_M} m"
    )


def _check_extent(size_m: NDArray[np.float64], unit: str) -> None:
    longest = float(size_m[:2].max())
    if not MIN_EXTENT_M <= longest <= MAX_EXTENT_M:
        raise SceneError(
            f"the scene measures {_length(longest)} along its longer side (unit {unit}), which is "
            f"no building; valid: {MIN_EXTENT_M:g} m … {MAX_EXTENT_M:g} m (set --unit if the "
            "file's unit is wrong)"
        )


def _length(metres: float) -> str:
    if metres < 1.0:
        return f"{1000 * metres:.3g} mm"
    return f"{metres:.4g} m" if metres < 1000 else f"{metres / 1000:.4g} km"


def _levelling(
    normals: NDArray[np.float64], area: NDArray[np.float64], config: RepairConfig
) -> tuple[NDArray[np.float64], float]:
    """Rotation that turns the mean normal of nearly horizontal faces upright, and the tilt [deg].

    Iterated re-weighting around the current estimate settles on the dominant plane.
    """
    up = np.array([0.0, 0.0, 1.0])
    limit = np.cos(np.deg2rad(config.max_tilt_deg + 5.0))
    for _ in range(20):
        cosine = normals @ up
        near = np.abs(cosine) > limit
        if not near.any():
            return np.eye(3), 0.0
        mean = (normals[near] * (np.sign(cosine[near]) * area[near])[:, None]).sum(axis=0)
        up = mean / np.linalg.norm(mean)
        limit = max(limit, np.cos(np.deg2rad(3.0))) if _ > 4 else limit
    tilt_deg = float(np.rad2deg(np.arccos(np.clip(up[2], -1.0, 1.0))))
    if not config.level_tilt_deg < tilt_deg <= config.max_tilt_deg:
        return np.eye(3), tilt_deg
    # Shortest rotation from `up` to z (Rodrigues' formula).
    axis = np.cross(up, [0.0, 0.0, 1.0])
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + k + k @ k / (1.0 + up[2]), tilt_deg
