"""Options of the repair."""

import math
from dataclasses import dataclass

from ..formats.core.errors import check_name
from ..formats.scene import FULL_HEIGHT_M

UP_AXES = ("x", "y", "z", "-x", "-y", "-z")
UNIT_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}


@dataclass(frozen=True)
class RepairConfig:
    """Options of the repair of a scan.

    Attributes:
        scene_id: name of the scene; empty = the source's stem.
        up: the source's up axis, or `auto`.
        unit: the source's unit of length, its length in metres, or `auto`.
        cell_m: side of floor and freemap cells and of collision voxels.
        fine_m: sampling distance in which holes and bumps are looked for.
        robot_height_m: nothing lower than this above a traversable cell; obstacles reach as high.
        floor_clearance_m: what rises no higher above the floor is floor (rugs, thresholds).
        blocked_above_m: an obstacle higher than this makes a freemap cell untraversable.
        bump_height_m, bump_width_m: bumps and dents up to this height and width are flattened.
        bump_tolerance_m: smaller deviations are left alone.
        min_floor_m2: smaller floor pieces do not make a level.
        level_tilt_deg, max_tilt_deg: a scan tilted by more than this, and less, is levelled.
        max_texture_px: larger textures are scaled down.
        patch_texel_m: texel size of the floor painted into holes; coarser over large levels.
        picture_px: width of the before and after pictures.
        allow_roof: also make levels of floors under the open sky that no stairs lead to.
        floor_m: world height at which a floor is laid inside the walls; None = none.
        ceiling_m: world height at which a ceiling is laid inside the walls; None = none.
        exclude: parts of the scan to leave out, by name or pattern.
        collision: path of a mesh to take as the surface of Gaussian splats; empty = fuse one.
    """

    scene_id: str = ""
    up: str = "auto"
    unit: str = "auto"
    cell_m: float = 0.05
    fine_m: float = 0.025
    robot_height_m: float = FULL_HEIGHT_M
    floor_clearance_m: float = 0.03
    blocked_above_m: float = 0.05
    bump_height_m: float = 0.06
    bump_width_m: float = 0.5
    bump_tolerance_m: float = 0.015
    min_floor_m2: float = 1.5
    level_tilt_deg: float = 0.3
    max_tilt_deg: float = 25.0
    max_texture_px: int = 4096
    patch_texel_m: float = 0.005
    picture_px: int = 1400
    allow_roof: bool = False
    floor_m: float | None = None
    ceiling_m: float | None = None
    exclude: tuple[str, ...] = ()
    collision: str = ""

    def __post_init__(self) -> None:
        check_name("up axis", self.up, ("auto", *UP_AXES))
        if self.unit != "auto":
            metres_per(self.unit)


def metres_per(unit: str) -> float:
    """Return the length [m] of a unit in `UNIT_M`, or of a number of metres, if it is above 0."""
    if unit in UNIT_M:
        return UNIT_M[unit]
    try:
        metres = float(unit)
    except ValueError:
        metres = 0.0
    if not 0 < metres < math.inf:
        check_name("unit", unit, ("auto", *UNIT_M, "a number of metres"))
    return metres
