"""What looks implausible about a repaired scene, with the option that may mend it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..collide.level_collision import LevelCollision
from ..orient.scale import ROOM_M

# Rooms are rarely lower or higher than this, and a scene is rarely made for less floor.
LOW_ROOM_M, HIGH_ROOM_M, LEAST_FLOOR_M2 = 2.0, 6.0, 4.0


def doubts(evidence: dict[str, Any], levels: Sequence[LevelCollision]) -> list[str]:
    """One line for each doubt about up, unit and floor.

    Args:
        evidence: of the orientation.
        levels: the collision of all levels.
    """
    found = list(evidence["doubts"])
    room = evidence["room_height_m"]
    area = sum(float(level.floor.covered.sum()) * level.floor.grid.cell_m**2 for level in levels)
    strange = []
    if room and not LOW_ROOM_M <= room <= HIGH_ROOM_M:
        strange.append(f"rooms of {room:.2f} m height (usual: {ROOM_M:g} m)")
    if area < LEAST_FLOOR_M2:
        strange.append(f"{area:.1f} m² of floor")
    if strange:
        up, unit = evidence["up"], evidence["unit"]
        found.append(
            f"{' and '.join(strange)} are implausible with {up} up in {unit}: look at after.png, "
            "and set --up (x y z -x -y -z) or --unit if the scan is turned or scaled wrongly"
        )
    return found
