"""Stages `scan`, `repair` and `soundness`: from a seed or a scan to a simulation-ready scene."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ....formats.core.atomic import file_digest
from ....formats.core.errors import FileFormatError, InputError
from ....formats.scene.bundle import INDEX_NAME
from ....formats.splats.kind import is_splats
from ....formats.untrusted.files import check_input
from ....formats.untrusted.limits import limits
from ....scene_repair.config import RepairConfig
from ....scene_repair.scan.files import SUFFIXES, USD_SUFFIXES, side_names, why_not
from ...engine.ledger import JOURNAL_NAME, MANIFEST_NAME, Row
from ...engine.lock import LOCK_NAME
from ...engine.work import Job, WorkItem, digest, work_item
from ...inputs.builtin import BuiltIn
from ...inputs.folders import scenes_in
from .repair import RepairJob
from .repair_splats import SplatRepairJob
from .scan import ScanJob
from .scan_splats import SplatScanJob
from .soundness import SoundnessJob

SCAN_STAGE = "scan"
STAGE = "repair"
CHECK_STAGE = "soundness"
# Formats that keep textures or geometry in further files beside them.
MULTI_FILE = {".gltf", ".obj", ".ply", ".glb", ".usd", ".usda", ".usdc"}
PICTURES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp"}
MAX_BESIDE = 100_000
LEDGER_FILES = (MANIFEST_NAME, JOURNAL_NAME, LOCK_NAME)
SIDE_FILES = {".mtl", ".mdl", ".bin", *PICTURES, *USD_SUFFIXES}
_IS_FOLDER = "is a folder; valid: one scan (`collect` takes a folder with --scenes)"


def scan_item(building: BuiltIn, folder: Path, splats: bool = False) -> WorkItem:
    """Generate a built-in scene into `folder`, and scan it virtually unless it is to be exact.

    Args:
        splats: capture it as Gaussian splats instead of a mesh.
    """
    job: Job = ScanJob(building.seed, folder, building.kind, building.scanned)
    if splats:
        job = SplatScanJob(building.seed, folder, building.kind)
    built = {"seed": building.seed, "kind": building.kind, "scanned": building.scanned}
    return work_item(SCAN_STAGE, building.name, job, (folder,), **built, splats=splats)


def items(sources: Mapping[str, Path], config: RepairConfig, scenes: Path) -> list[WorkItem]:
    """Return one item per scan; `sources` are files by scene id."""
    return [
        item(source, scenes / scene_id, replace(config, scene_id=scene_id))
        for scene_id, source in sources.items()
    ]


def item(source: Path, out: Path, config: RepairConfig) -> WorkItem:
    """Repair one scan into the scene folder `out`."""
    check_scan(source)
    job = (SplatRepairJob if is_splats(source) else RepairJob)(source, out, config)
    named: dict[str, object] = {"scan": source_digest(source)}
    if config.collision:
        given = Path(config.collision)
        beside = given.with_suffix(".json")  # of an occupancy map
        named["collision"] = (source_digest(given), beside.is_file() and file_digest(beside))
    return work_item(STAGE, out.name, job, (out,), config, **named)


def decisions(facts: Mapping[str, Any]) -> list[str]:
    """Return one line for each decision of a repair, and for each doubt about it."""
    heights = ", ".join(f"{round(z, 2) + 0.0:.2f}" for z in facts["floor_z_m"])
    left = ", ".join(f"{n} {cause}" for cause, n in sorted(facts["holes_left"].items()))
    lines = [
        f"up      {facts['up']}: {facts['up_reason']}",
        f"unit    {facts['unit']}: {facts['unit_reason']}",
        f"levels  {facts['levels']}, floor at {heights} m",
        f"floor   {facts['floor_before_m2']:.1f} m² scanned, {facts['floor_after_m2']:.1f} m² now; "
        f"{facts['holes_filled']} holes filled, left open: {left or 'none'}",
    ]
    lines += [f"stairs  {text}" for text in facts["stairs"]]
    lines += [f"warning {text}" for text in facts["warnings"]]
    lines += [f"doubt   {text}" for text in facts["doubts"]]
    return lines + [f"UNSOUND {text}" for text in facts["problems"]]


def check_items(repaired: Mapping[str, Row], scenes: Path, allow_unsound: bool) -> list[WorkItem]:
    """Return one item per repaired scene; items of unsound scenes are quarantined."""
    result = []
    for scene_id, row in repaired.items():
        job = SoundnessJob(scene_id, tuple(row.facts["problems"]), allow_unsound)
        allowed = {"allow_unsound": allow_unsound}
        result.append(
            work_item(CHECK_STAGE, scene_id, job, (scenes / scene_id,), row.key, **allowed)
        )
    return result


def rows_of(folder: Path) -> dict[str, Row]:
    """Return a ledger row for every scene in a folder; see `scene_rows`."""
    return scene_rows(scenes_in(folder.resolve()).values())


def scene_rows(scenes: Iterable[Path]) -> dict[str, Row]:
    """Return a ledger row for each repaired scene by name, as if this stage had written it.

    The key hashes the scene's index file, which the repair writes last and never changes.
    """
    rows: dict[str, Row] = {}
    for path in scenes:
        if path.name in rows:
            raise InputError(f"two scenes are named {path.name}; rename one")
        key = digest(path, (path / INDEX_NAME).read_text())
        rows[path.name] = Row(STAGE, path.name, key, "done")
    return rows


def demand(names: Iterable[str], scenes: Mapping[str, Row], folder: Path) -> None:
    """Raise InputError unless every scene of `names` is among those found in `folder`."""
    missing = sorted(set(names) - scenes.keys())
    if missing:
        raise InputError(f"{folder}: contains no repaired scene {', '.join(missing)}")


def check_scan(source: Path) -> None:
    """Raise FileFormatError if `source` is missing, or cannot be a scan by its name."""
    if not source.exists(follow_symlinks=False):
        raise FileFormatError(source, f"no such file; valid: {', '.join(SUFFIXES)}")
    if source.is_dir():
        raise FileFormatError(source, _IS_FOLDER)
    if source.suffix.lower() not in SUFFIXES:
        raise FileFormatError(source, why_not(source.name))


def source_digest(source: Path) -> str:
    """Return the digest of a scan and of the files beside it that it may refer to."""
    if source.is_dir():
        raise FileFormatError(source, _IS_FOLDER)
    check_input(source, max_bytes=limits().scan_bytes)
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
    """Return the files in and below the scan's folder that it may refer to, sorted by path."""
    paths: list[Path] = []
    count = 0
    for folder, folders, files in source.parent.walk():
        # What a run wrote beside its scan must not make the scan another one.
        folders[:] = [
            name
            for name in folders
            if not name.startswith(".")
            and name != "runs"
            and not any((folder / name / own).is_file() for own in LEDGER_FILES)
        ]
        count += len(folders) + len(files)
        if count > MAX_BESIDE:
            raise FileFormatError(
                source,
                f"its folder {source.parent} has more than {MAX_BESIDE:,} files, any of which it "
                "may reference; move the scan and its textures to a folder of their own",
            )
        paths += [
            folder / name
            for name in files
            if Path(name).suffix.lower() in SIDE_FILES
            and not name.startswith(".")
            and (folder / name).is_file()
        ]
    return sorted(paths)
