"""Stage `repair`: a scan in, a simulation-ready scene out."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ...formats.core.atomic import atomic_folder
from ...formats.core.digest import file_digest
from ...formats.core.errors import FileFormatError
from ...scene_repair.config import RepairConfig
from ...scene_repair.scan.kinds import USD_SUFFIXES
from ...scene_repair.scan.side_files import side_names
from ..engine.keys import code_version, digest
from ..engine.runner import ItemResult, WorkItem

STAGE = "repair"
# Formats that keep textures or geometry in further files beside them.
MULTI_FILE = {".gltf", ".obj", ".ply", ".glb", ".usd", ".usda", ".usdc"}
PICTURES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp"}
MAX_BESIDE = 100_000
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
        FileFormatError: missing, not a file, or among very many others.
    """
    if not source.exists():
        raise FileFormatError(source, "no such file")
    if not source.is_file():
        raise FileFormatError(source, "is a folder; valid: one scan, or SCENES=<folder>")
    parts: list[object] = [source.name, file_digest(source)]
    for name in side_names(source):
        beside = source.with_name(name)
        parts.append(file_digest(beside) if beside.is_file() else None)
    if source.suffix.lower() in MULTI_FILE:
        # Hashing gigabytes of textures at every start would be slower than what it saves.
        for path in _beside(source):
            stat = path.stat()
            inside = path.relative_to(source.parent).as_posix()
            parts.append((inside, stat.st_size, stat.st_mtime_ns))
    return digest(parts)


def _beside(source: Path) -> list[Path]:
    """Files in and below the scan's folder that it may refer to, in order of their paths."""
    found: list[Path] = []
    looked = 0
    for folder, folders, files in source.parent.walk():
        folders[:] = [name for name in folders if not name.startswith(".") and name != "runs"]
        looked += len(folders) + len(files)
        if looked > MAX_BESIDE:
            raise FileFormatError(
                source,
                f"its folder {source.parent} holds more than {MAX_BESIDE:,} files, all of which it "
                "may refer to; valid: a folder for the scan and its textures alone",
            )
        found += [
            folder / name
            for name in files
            if Path(name).suffix.lower() in SIDE_FILES
            and not name.startswith(".")
            and (folder / name).is_file()
        ]
    return sorted(found)
