"""Stage `repair`: a scan in, a simulation-ready scene out."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ...formats.atomic import atomic_folder
from ...formats.digest import file_digest
from ...formats.errors import FileFormatError
from ...scene_repair.config import RepairConfig
from ...scene_repair.kinds import USD_SUFFIXES
from ..keys import code_version, digest
from ..runner import ItemResult, WorkItem

STAGE = "repair"
# Formats that keep textures or geometry in further files beside them.
MULTI_FILE = {".gltf", ".obj", ".ply", ".glb", ".usd", ".usda", ".usdc"}
PICTURES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp"}
SIDE_FILES = {".mtl", ".mdl", ".bin", *PICTURES, *USD_SUFFIXES}


def items(sources: Mapping[str, Path], config: RepairConfig, scenes: Path) -> list[WorkItem]:
    """One item per scan; scene ids map to their files.

    Raises:
        FileFormatError: a source does not exist or is no file.
    """
    code = code_version("scene_repair", "formats", "pipeline/stages/repair.py")
    result = []
    for scene_id, source in sources.items():
        named = replace(config, scene_id=scene_id)
        key = digest(STAGE, named, source_digest(source), code)
        out = scenes / scene_id
        result.append(WorkItem(scene_id, key, (out,), process, (source, out, named)))
    return result


def process(source: Path, out: Path, config: RepairConfig) -> ItemResult:
    """Repair one scan."""
    # Mesh and USD libraries take seconds to import: only where the work is done.
    from ...scene_repair.repair import repair_scene

    with atomic_folder(out) as temporary:
        repair_scene(source, temporary, config)
        log = json.loads((temporary / "repair.json").read_text())
    levels = log["levels"]
    holes = [hole for level in levels for hole in level["holes"]]
    filled = [hole for hole in holes if hole["action"] == "filled"]
    left = Counter(hole["cause"] for hole in holes if hole["action"] != "filled")
    facts = {
        "levels": len(levels),
        "holes_filled": len(filled),
        "holes_left": dict(left),
        "floor_before_m2": sum(level["floor_area_before_m2"] for level in levels),
        "floor_after_m2": sum(level["floor_area_after_m2"] for level in levels),
        "triangles": log["triangles_after"],
        "warnings": log["warnings"],
    }
    return ItemResult(facts)


def source_digest(source: Path) -> str:
    """Digest of a scan and of the files beside it that it may refer to.

    Raises:
        FileFormatError: missing, or not a file.
    """
    if not source.exists():
        raise FileFormatError(source, "no such file; SCENE takes a mesh file or `builtin`")
    if not source.is_file():
        raise FileFormatError(source, "is a folder; SCENE takes one mesh file, SCENES a folder")
    parts: list[object] = [source.name, file_digest(source)]
    for name in (
        f"{source.stem}.labels.json",
        f"{source.stem}.house",
        f"LICENSE.{source.stem}",
        "LICENSE",
    ):
        beside = source.with_name(name)
        parts.append(file_digest(beside) if beside.is_file() else None)
    if source.suffix.lower() in MULTI_FILE:
        # Hashing gigabytes of textures at every start would be slower than what it saves.
        for path in sorted(source.parent.rglob("*")):
            inside = path.relative_to(source.parent)
            hidden = any(part.startswith(".") or part == "runs" for part in inside.parts)
            if path.suffix.lower() in SIDE_FILES and not hidden and path.is_file():
                stat = path.stat()
                parts.append((inside.as_posix(), stat.st_size, stat.st_mtime_ns))
    return digest(parts)
