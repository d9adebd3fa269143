"""The chain's first stages, each alone on files the user names: scans, scenes, episodes."""

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
    """Generate a furnished apartment and scan it virtually."""

    seed: tyro.conf.Positional[int] = 0
    """Which apartment: the same seed gives the same home."""
    out: Path = Path("scan")
    """Folder to write scan.glb, its labels and the true floor into."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


@dataclass(frozen=True)
class Repair:
    """Turn a scan into a simulation-ready scene: fill the floor's holes, build collision."""

    scan: tyro.conf.Positional[Path]
    """The scan: GLB, glTF, OBJ, PLY, STL, USD, or a point cloud (PLY, PCD); docs/scans.md tells
    more, also about labels beside it."""
    out: Path = Path("scene")
    """Folder to write the scene into."""
    up: str = "auto"
    """The scan's up axis: x y z -x -y -z, or auto."""
    unit: str = "auto"
    """The scan's unit of length: m cm mm in ft, or auto."""
    allow_unsound: bool = False
    """Exit with code 0 even if the scene is not sound."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


@dataclass(frozen=True)
class Align:
    """Bring VLN-CE episodes into the frame of repaired scenes, onto the floor, out of walls."""

    episodes: tyro.conf.Positional[Path]
    """VLN-CE episode file."""
    scenes: Path
    """Folder of repaired scenes, one folder each, named as the scan."""
    out: Path = Path("aligned.json.gz")
    """Episode file to write."""
    max_failed: int = 0
    """Exit with code 1 when more episodes than this are rejected."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


@dataclass(frozen=True)
class Filter:
    """Drop episodes that climb stairs: a height step of the reference path above a threshold."""

    episodes: tyro.conf.Positional[Path]
    """VLN-CE episode file."""
    out: Path = Path("kept.json.gz")
    """Episode file to write, in the same schema."""
    max_step_m: float = 0.3
    """Largest height difference of consecutive reference points [m]."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


@dataclass(frozen=True)
class Sample:
    """Sample new trajectories in a repaired scene."""

    scene: tyro.conf.Positional[Path]
    """A repaired scene's folder."""
    out: Path = Path("episodes.json.gz")
    """Episode file to write."""
    count: int = 6
    """How many episodes."""
    min_length_m: float = SampleConfig.min_length_m
    """Least geodesic distance from start to goal [m]; the reference path is no shorter."""
    max_length_m: float = SampleConfig.max_length_m
    """Longest reference path [m]; the geodesic distance is no longer."""
    min_crossings: int = SampleConfig.min_crossings
    """How often a path must pass from one room into another; 0 for a single room."""
    robot_radius_m: float = SampleConfig.robot_radius_m
    """Clearance that every point of a path keeps [m]."""
    seed: int = 0
    """Of everything random."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


def run_scan(options: Scan) -> int:
    """Generate one scan."""
    refuse_to_replace(options.out, SCAN_NAMES)
    facts = ScanJob(options.seed, options.out.resolve()).run().facts
    return tell(options, facts, f"{options.out / 'scan.glb'}: apartment {options.seed}")


def run_repair(options: Repair) -> int:
    """Repair one scan and tell what was decided; exit code 1 if the scene is not sound.

    Raises:
        InputError: the scan cannot be used, or `out` holds something else.
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
    """Align one file's episodes; exit code 1 when too many are rejected."""
    scenes = scenes_in(options.scenes)
    result = AlignJob(options.episodes, scenes, options.out, all_scenes=True).run()
    rejected = result.facts["rejected"]
    if not options.json:
        sys.stdout.writelines(f"rejected {name}: {reason}\n" for name, reason in rejected)
    text = f"{options.out}: {result.facts['episodes']} aligned, {len(rejected)} rejected"
    tell(options, result.facts, text)
    return int(len(rejected) > options.max_failed)


def run_filter(options: Filter) -> int:
    """Filter one file's episodes."""
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
    """Scene id → folder of every repaired scene in `folder`.

    Raises:
        InputError: not a single one.
    """
    indices = sorted(folder.glob(f"*/{INDEX_NAME}"))
    found = {p.parent.name: p.parent for p in indices if not p.parent.name.startswith(".")}
    if not found:
        raise InputError(f"{folder}: no repaired scene in it (run `vlnpe repair` first)")
    return found


def refuse_to_replace(folder: Path, own: frozenset[str]) -> None:
    """Results replace a folder whole, so never one that holds anything but such a result.

    Raises:
        InputError: `folder` is a file, or holds anything that is not named in `own`.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; --out takes a folder")
    strange = sorted({p.name for p in folder.iterdir()} - own) if folder.is_dir() else []
    if strange:
        raise InputError(
            f"{folder}: not empty and no earlier result (it holds {strange[0]}); "
            "choose another --out"
        )


def tell(options: Any, facts: dict[str, Any], text: str) -> int:
    """Print one line for people or, with `--json`, one object for programs; returns 0."""
    value = {**{k: str(v) for k, v in asdict(options).items() if k == "out"}, **facts}
    sys.stdout.write((json.dumps(value) if options.json else text) + "\n")
    return 0
