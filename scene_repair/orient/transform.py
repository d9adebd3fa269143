"""Determine up axis, unit and tilt of a scan: the transform into the world."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...formats.core.arrays import Array
from ...formats.core.errors import SceneError
from ..config import RepairConfig, metres_per
from ..scan.left_out import advice
from ..scan.record import Scan
from .bounds import robust_bounds
from .gravity import Surfaces
from .scale import Sizes, hall, infer_unit, measure, sizes_in
from .up import TO_Z_UP, find_up

# A building, or one room of it, measured along its longer side.
MIN_EXTENT_M, MAX_EXTENT_M = 1.0, 1000.0
# A file's word about its unit is doubted (never overruled) from this lead on.
DOUBT = 8.0


@dataclass(frozen=True)
class Orientation:
    """The transform from source coordinates to the world.

    Attributes:
        source_to_world: (4, 4) similarity from the scan's coordinates, less its offset.
        file_to_world: (4, 4) similarity from the file's coordinates.
        habitat_to_world: (4, 4) rigid, see `SceneBundle.habitat_to_world`.
        evidence: what was decided and why, as JSON values.
    """

    source_to_world: Array
    file_to_world: Array
    habitat_to_world: Array
    evidence: dict[str, Any]


def orient(scan: Scan, config: RepairConfig) -> Orientation:
    """Return the transform into the world; raise SceneError if its extent is not a building's."""
    surfaces = Surfaces.of(scan.vertices, scan.faces)
    up = find_up(scan, surfaces, config)
    to_z_up = TO_Z_UP[up.axis]
    level, tilt_deg = _levelling(to_z_up @ up.direction, config)
    turned = level @ to_z_up
    lower, upper = robust_bounds(scan.vertices @ turned.T, scan.faces)
    extent = upper - lower
    sizes = measure(scan, surfaces, turned)
    unit, unit_reason, unit_doubt = _unit(scan, sizes, config)
    scale = metres_per(unit)
    _check_extent(extent * scale, unit, scan)
    source_to_world = np.eye(4)
    source_to_world[:3, :3] = scale * turned
    habitat_to_world = np.eye(4)
    habitat_to_world[:3, :3] = level @ TO_Z_UP["y"]
    file_to_world = source_to_world.copy()
    file_to_world[:3, 3] = habitat_to_world[:3, 3] = -source_to_world[:3, :3] @ scan.offset
    return Orientation(
        source_to_world,
        file_to_world,
        habitat_to_world,
        {
            "up": up.axis,
            "up_reason": up.reason,
            "unit": unit,
            "unit_reason": unit_reason,
            "offset": scan.offset.tolist(),
            "extent_m": [round(float(v), 4) for v in extent * scale],
            "tilt_deg": round(tilt_deg, 4),
            "levelled": bool(not np.array_equal(level, np.eye(3))),
            "room_height_m": round(sizes.room * scale, 3),
            "doubts": [*up.doubts, *unit_doubt],
        },
    )


def _unit(scan: Scan, sizes: Sizes, config: RepairConfig) -> tuple[str, str, list[str]]:
    """Return the unit, the reason, and doubts about it."""
    if config.unit != "auto":
        return config.unit, "given by the user", []
    if scan.unit is None:
        return *infer_unit(sizes)[:2], []
    unit, reason = scan.unit
    scale = metres_per(unit)
    # The height of a hall says nothing about the unit: naves and warehouses are as high.
    judged = replace(sizes, room=0.0) if hall(scale * sizes.room, scale * sizes.narrow) else sizes
    inferred, _, lead = infer_unit(judged)
    if inferred == unit or lead <= DOUBT:
        return unit, reason, []
    doubt = (
        f"{sizes_in(sizes, unit)}; in {inferred} the sizes would be more usual "
        f"({sizes_in(sizes, inferred)}): set --unit {inferred} if that is right, or --unit to the "
        "length of the file's unit in metres"
    )
    return unit, f"{reason}, though {doubt}", [doubt]


def _check_extent(size_m: Array, unit: str, scan: Scan) -> None:
    longest = float(size_m[:2].max())
    if not MIN_EXTENT_M <= longest <= MAX_EXTENT_M:
        large = advice(scan) if longest > MAX_EXTENT_M else ""
        raise SceneError(
            f"the scene measures {_length(longest)} along its longer side (unit {unit}), which is "
            f"not a building; valid: {MIN_EXTENT_M:g} m … {MAX_EXTENT_M:g} m ({large}set --unit if "
            "the file's unit is wrong)"
        )


def _length(metres: float) -> str:
    if metres < 1.0:
        return f"{1000 * metres:.3g} mm"
    return f"{metres:.4g} m" if metres < 1000 else f"{metres / 1000:.4g} km"


def _levelling(up: Array, config: RepairConfig) -> tuple[Array, float]:
    """Return the rotation from `up` (3,) to z, and its angle [deg].

    None is made for a slight tilt, or for more than a scan may have whose up axis was given.
    """
    tilt_deg = float(np.rad2deg(np.arccos(np.clip(up[2], -1.0, 1.0))))
    named = config.up != "auto"
    if tilt_deg < config.level_tilt_deg or (named and tilt_deg > config.max_tilt_deg):
        return np.eye(3), tilt_deg
    # Shortest rotation from `up` to z (Rodrigues' formula).
    axis = np.cross(up, [0.0, 0.0, 1.0])
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + k + k @ k / (1.0 + up[2]), tilt_deg
