"""Write the folders of scans and scenes, and say what they hold."""

import json
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ....formats.core.atomic import atomic_folder
from ...engine.work import ItemResult


def write_scan(folder: Path, write: Callable[[Path], Path], facts: dict[str, Any]) -> ItemResult:
    """Write the scan of a generated building with its licence.

    Args:
        write: Writes the scan into a folder and returns its path.
    """
    with atomic_folder(folder) as temporary:
        scan = write(temporary)
        size = scan.stat().st_size
        # The scan is made by this project, so that the data made from it may be used as freely.
        (temporary / "LICENSE.scan").write_text("Apache-2.0\n")
    return ItemResult({**facts, "scan": scan.name, "bytes": size})


def write_scene(out: Path, repair: Callable[[Path], object]) -> ItemResult:
    """Write a scene into `out` by a function that repairs a scan into a folder."""
    with atomic_folder(out) as temporary:
        repair(temporary)
        log = json.loads((temporary / "repair.json").read_text())
    return ItemResult(facts_of(log))


def facts_of(log: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts of a repair for ledger, terminal and report; `log` is its repair.json."""
    levels = log["levels"]
    holes = [hole for level in levels for hole in level["holes"]]
    filled = [hole for hole in holes if hole["action"] == "filled"]
    left = Counter(hole["cause"] for hole in holes if hole["action"] != "filled")
    source, proof = log["source"], log["verification"]
    return {
        **{key: source[key] for key in ("up", "up_reason", "unit", "unit_reason")},
        "sound": proof["sound"],
        "problems": proof["problems"],
        "doubts": log["doubts"] + proof["doubts"],
        "levels": len(levels),
        "floor_z_m": [level["floor_z_m"] for level in levels],
        "holes_filled": len(filled),
        "holes_left": dict(left),
        "floor_before_m2": sum(level["floor_area_before_m2"] for level in levels),
        "floor_after_m2": sum(level["floor_area_after_m2"] for level in levels),
        "triangles": log["triangles_after"],
        "stairs": [_staircase(staircase) for staircase in log["staircases"]],
        "warnings": log["warnings"],
    }


def _staircase(staircase: Mapping[str, Any]) -> str:
    """Return a staircase in words."""
    lower, upper = staircase["levels"]
    flights = staircase["flights"]
    text = (
        f"level {lower} to {upper}: {flights} flight{'s' * (flights != 1)}, "
        f"{staircase['risers']} risers "
        f"up to {100 * staircase['riser_m']:.1f} cm, treads {100 * staircase['going_m']:.0f} cm, "
        f"{staircase['width_m']:.2f} m wide"
    )
    return f"{text}; {staircase['problem']}" if staircase["problem"] else text
