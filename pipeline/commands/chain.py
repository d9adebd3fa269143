"""Commands for the first stages: `scan`, `repair`, `align`, `filter`, `sample`, `instruct`."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from ...formats.core.errors import InputError
from ...formats.scene.bundle import INDEX_NAME
from ...scene_repair.config import RepairConfig
from ...trajectory_sampler.sampling import SampleConfig
from ..builtin import check_kind
from ..jobs.episodes import AlignJob, FilterJob, SampleJob
from ..jobs.repair import RepairJob
from ..jobs.scan import ScanJob
from ..stages import repair

SCAN_NAMES = frozenset({"scan.glb", "scan.labels.json", "truth.npz", "LICENSE.scan"})
SCENE_NAMES = frozenset(
    {"scene.json", "scene.usdc", "visual.npz", "textures", "levels"}
    | {"repair.json", "before.png", "after.png"}
)

Json = Annotated[bool, tyro.conf.arg(name="json")]


@dataclass(frozen=True)
class Scan:
    """Generate a furnished building and a virtual scan of it."""

    seed: tyro.conf.Positional[int] = 0
    """Random seed of the building; the same seed gives the same building."""
    kind: str = "apartment"
    """Kind of building: apartment, villa, house (two storeys) or office."""
    out: Path = Path("scan")
    """Output folder for scan.glb, its labels and the ground-truth floor."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


@dataclass(frozen=True)
class Repair:
    """Turn a scan into a simulation-ready scene: fill floor holes and build collision geometry."""

    scan: tyro.conf.Positional[Path]
    """Scan to repair: GLB, glTF, OBJ, PLY, STL, USD, or a point cloud (PLY, PCD). See docs/scans.md
    for details and for label files."""
    out: Path = Path("scene")
    """Output folder for the scene."""
    up: str = "auto"
    """Up axis of the scan: x, y, z, -x, -y, -z, or auto to detect it."""
    unit: str = "auto"
    """Length unit of the scan: m, cm, mm, in, ft, or auto to detect it."""
    allow_unsound: bool = False
    """Exit with code 0 even if the repaired scene fails its soundness checks."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


@dataclass(frozen=True)
class Align:
    """Transform VLN-CE episodes into the frame of repaired scenes, snapped to free floor."""

    episodes: tyro.conf.Positional[Path]
    """VLN-CE episode file to read."""
    scenes: Path
    """Folder of repaired scenes, with one subfolder per scene, named after its scan."""
    out: Path = Path("aligned.json.gz")
    """Episode file to write."""
    max_failed: int = 0
    """Maximum number of rejected episodes; exit with code 1 above it."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


@dataclass(frozen=True)
class Filter:
    """Drop episodes that climb stairs, detected by height steps in the reference path."""

    episodes: tyro.conf.Positional[Path]
    """VLN-CE episode file to read."""
    out: Path = Path("kept.json.gz")
    """Episode file to write, in the same schema."""
    max_step_m: float = 0.3
    """Maximum height difference between consecutive reference path points [m]."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


@dataclass(frozen=True)
class Sample:
    """Sample new trajectories in a repaired scene."""

    scene: tyro.conf.Positional[Path]
    """Folder of a repaired scene."""
    out: Path = Path("episodes.json.gz")
    """Episode file to write."""
    count: int = 6
    """Number of episodes to sample."""
    min_length_m: float = SampleConfig.min_length_m
    """Minimum geodesic distance from start to goal [m]; the reference path is never shorter."""
    max_length_m: float = SampleConfig.max_length_m
    """Maximum length of the reference path [m]; the geodesic distance is never longer."""
    min_crossings: int = SampleConfig.min_crossings
    """Minimum number of room-to-room transitions per path; use 0 for a single-room scan."""
    robot_radius_m: float = SampleConfig.robot_radius_m
    """Clearance kept at every point of a path [m]."""
    seed: int = 0
    """Random seed."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


def run_scan(options: Scan) -> int:
    """Generate one scan.

    Raises:
        InputError: If there is no such kind of building, or `out` contains unrelated files.
    """
    check_kind(options.kind)
    refuse_to_replace(options.out, SCAN_NAMES)
    facts = ScanJob(options.seed, options.out.resolve(), options.kind).run().facts
    return tell(options, facts, f"{options.out / 'scan.glb'}: {options.kind} {options.seed}")


def run_repair(options: Repair) -> int:
    """Repair one scan and print the decisions made; return 1 if the scene is not sound.

    Raises:
        InputError: If the scan cannot be used, or `out` contains unrelated files.
    """
    repair.source_digest(options.scan)
    refuse_to_replace(options.out, SCENE_NAMES)
    config = RepairConfig(up=options.up, unit=options.unit)
    facts = RepairJob(options.scan, options.out.resolve(), config).run().facts
    end = "repaired" if facts["sound"] else "repaired, but NOT SOUND (collect refuses it)"
    lines = [
        *repair.decisions(facts),
        f"{options.out}: {end}; see repair.json, before.png, after.png",
    ]
    tell(options, facts, "\n".join(lines))
    return int(not facts["sound"] and not options.allow_unsound)


def run_align(options: Align) -> int:
    """Align the episodes of one file; return 1 if too many are rejected."""
    scenes = scenes_in(options.scenes)
    result = AlignJob(options.episodes, scenes, options.out, all_scenes=True).run()
    rejected = result.facts["rejected"]
    if not options.json:
        sys.stdout.writelines(f"rejected {name}: {reason}\n" for name, reason in rejected)
    text = f"{options.out}: {result.facts['episodes']} aligned, {len(rejected)} rejected"
    tell(options, result.facts, text)
    return int(len(rejected) > options.max_failed)


def run_filter(options: Filter) -> int:
    """Filter the episodes of one file."""
    facts = FilterJob(options.episodes, options.out, options.max_step_m).run().facts
    return tell(options, facts, f"{options.out}: {facts['kept']} kept, {facts['dropped']} dropped")


def run_sample(options: Sample) -> int:
    """Sample episodes in one scene."""
    try:
        config = SampleConfig(
            count=options.count,
            min_length_m=options.min_length_m,
            max_length_m=options.max_length_m,
            min_crossings=options.min_crossings,
            robot_radius_m=options.robot_radius_m,
            end_clearance_m=max(SampleConfig.end_clearance_m, options.robot_radius_m),
        )
    except ValueError as error:
        raise InputError(str(error)) from error
    facts = SampleJob(options.scene, options.out, config, options.seed).run().facts
    return tell(options, facts, f"{options.out}: {facts['episodes']} episodes")


def scenes_in(folder: Path) -> dict[str, Path]:
    """Return the folder of every repaired scene in `folder`, by scene id.

    Raises:
        InputError: If `folder` contains no repaired scene.
    """
    indices = sorted(folder.glob(f"*/{INDEX_NAME}"))
    found = {p.parent.name: p.parent for p in indices if not p.parent.name.startswith(".")}
    if not found:
        raise InputError(f"{folder}: contains no repaired scene; run `vlnpe repair` first")
    return found


def refuse_to_replace(folder: Path, own: frozenset[str]) -> None:
    """Refuse an output folder that contains anything other than an earlier result.

    Results replace the whole folder, so unrelated files in it would be lost.

    Raises:
        InputError: If `folder` is a file, or contains an entry whose name is not in `own`.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; --out must be a folder")
    foreign = sorted({p.name for p in folder.iterdir()} - own) if folder.is_dir() else []
    if foreign:
        raise InputError(
            f"{folder}: not empty and not an earlier result (it contains {foreign[0]}); "
            "choose another --out"
        )


def tell(options: Any, facts: dict[str, Any], text: str) -> int:
    """Print `text` or, with `--json`, one JSON object; return 0."""
    value = {**{k: str(v) for k, v in asdict(options).items() if k == "out"}, **facts}
    sys.stdout.write((json.dumps(value) if options.json else text) + "\n")
    return 0
