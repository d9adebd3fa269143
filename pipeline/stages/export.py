"""Stages `export`, `mcap` and `dataset`: episodes as LeRobot v3 and MCAP."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ...formats.digest import file_digest
from ...formats.frame_folder import read_frame_folder
from ...formats.lerobot import assemble_dataset, write_episode_unit
from ...formats.mcap.episode import write_episode_mcap
from ...formats.mcap.rollout import read_rollout
from ...formats.rollout import EndReason
from ...formats.scene_bundle import load_bundle
from ..keys import PACKAGE_ROOT, code_version, digest
from ..ledger import Row
from ..runner import Context, ItemResult, StageSummary, WorkItem, run_stage

STAGE = "export"
MCAP_STAGE = "mcap"
DATASET_STAGE = "dataset"
SCENE_MAP = "after.png"


@dataclass(frozen=True)
class Dataset:
    """Where one robot × controller × view goes.

    Attributes:
        name: `<robot>-<controller>-<view>`.
        units: folder of episode units.
        lerobot: the dataset's folder.
        mcap: folder of MCAP files.
    """

    name: str
    units: Path
    lerobot: Path
    mcap: Path

    @staticmethod
    def under(root: Path, robot: str, controller: str, view: str) -> Dataset:
        """Paths under an output folder."""
        name = f"{robot}-{controller}-{view}"
        return Dataset(name, root / "units" / name, root / "lerobot" / name, root / "mcap" / name)


def wanted(frames: Mapping[str, Row], only_success: bool) -> dict[str, Row]:
    """The rows of the render stage that are to be exported, by item."""
    if not only_success:
        return dict(frames)
    good = str(EndReason.SUCCESS)
    return {name: row for name, row in frames.items() if row.facts["end_reason"] == good}


def run(
    context: Context,
    frames: Mapping[str, Row],
    root: Path,
    scenes: Path,
    dataset: Dataset,
    scope: str,
    facts: Mapping[str, Any],
) -> list[StageSummary]:
    """Export one robot's rendered episodes: units, MCAP files, and the dataset of the units.

    Without a single episode there is no dataset, and none is left from before.

    Args:
        context: ledger of the folder that `dataset` lies in, and workers.
        frames: rows of the render stage by item; their outputs are relative to `root`.
        root: folder of the render stage's ledger.
        scenes: folder of the repaired scenes.
        dataset: where it goes.
        scope: what the items' names begin with.
        facts: configuration and seeds for the provenance.
    """
    out = context.ledger.root
    units = run_stage(context, STAGE, unit_items(frames, root, dataset), scope)
    items = mcap_items(frames, root, scenes, dataset)
    summaries = [units, run_stage(context, MCAP_STAGE, items, scope)]
    # The folder of MCAP files is handed on as it is.
    context.ledger.discard(MCAP_STAGE, scope)
    names = sorted({str(row.facts["scene"]) for row in units.good().values()})
    used = {name: scenes / name for name in names}
    items = [dataset_item(units.good(), out, used, dataset, facts)] if units.good() else []
    summaries.append(run_stage(context, DATASET_STAGE, items, dataset.name))
    context.ledger.discard(DATASET_STAGE, dataset.name)
    return summaries


def unit_items(frames: Mapping[str, Row], root: Path, dataset: Dataset) -> list[WorkItem]:
    """One LeRobot unit per rendered episode; `frames` are rows of the render stage by item."""
    code = code_version("formats", "pipeline/stages/export.py")
    result = []
    for name, row in frames.items():
        out = dataset.units / name.rsplit("/", 1)[1]
        arguments = (root / str(row.facts["rollout"]), root / row.outputs[0], out)
        key = digest(STAGE, row.key, code)
        result.append(WorkItem(name, key, (out,), process_unit, arguments))
    return result


def process_unit(rollout: Path, frames: Path, out: Path) -> ItemResult:
    """Write one episode's LeRobot unit."""
    seen = read_frame_folder(frames)
    write_episode_unit(
        out,
        read_rollout(rollout),
        seen.arrays,
        seen.frames_per_second,
        rgb_video=seen.rgb_video,
        depth_video=seen.depth_video,
        camera=seen.camera,
        depth_range=seen.depth_range,
        light=seen.light,
        rgb_codec=seen.rgb_codec,
    )
    return ItemResult({"frames": seen.facts["frames"], "scene": seen.facts["scene_id"]})


def mcap_items(
    frames: Mapping[str, Row], root: Path, scenes: Path, dataset: Dataset
) -> list[WorkItem]:
    """One MCAP with images per rendered episode."""
    code = code_version("formats", "pipeline/stages/export.py")
    result = []
    for name, row in frames.items():
        out = dataset.mcap / f"{name.rsplit('/', 1)[1]}.mcap"
        scene_map = scenes / str(row.facts["scene"]) / SCENE_MAP
        arguments = (root / str(row.facts["rollout"]), root / row.outputs[0], scene_map, out)
        key = digest(MCAP_STAGE, row.key, code)
        result.append(WorkItem(name, key, (out,), process_mcap, arguments))
    return result


def process_mcap(rollout: Path, frames: Path, scene_map: Path, out: Path) -> ItemResult:
    """Write one episode's MCAP."""
    write_episode_mcap(out, read_rollout(rollout), frames, scene_map=scene_map.read_bytes())
    return ItemResult({"bytes": out.stat().st_size})


def dataset_item(
    units: Mapping[str, Row],
    root: Path,
    scenes: Mapping[str, Path],
    dataset: Dataset,
    facts: Mapping[str, Any],
) -> WorkItem:
    """Join one robot's units into its dataset.

    Args:
        units: rows of the unit stage by item.
        root: the ledger's folder.
        scenes: folders of the repaired scenes the episodes lie in.
        dataset: where it goes.
        facts: configuration and seeds for the provenance.
    """
    folders = tuple(root / row.outputs[0] for row in units.values())
    keys = [row.key for row in units.values()]
    key = digest(
        DATASET_STAGE, keys, dict(facts), code_version("formats", "pipeline/stages/export.py")
    )
    arguments = (folders, tuple(scenes.values()), dataset.lerobot, dict(facts))
    return WorkItem(dataset.name, key, (dataset.lerobot,), process_dataset, arguments)


def process_dataset(
    units: Sequence[Path], scenes: Sequence[Path], out: Path, facts: dict[str, Any]
) -> ItemResult:
    """Assemble one dataset."""
    bundles = [load_bundle(scene) for scene in scenes]
    licences = sorted({_licence_id(str(b.source.get("licence") or "")) for b in bundles})
    lock = PACKAGE_ROOT / "uv.lock"
    provenance = {
        "vlnpe": version("vlnpe"),
        "code": code_version("collectors", "formats", "scene_repair", "trajectory_sampler"),
        "lock": file_digest(lock) if lock.is_file() else None,
        "scenes": {b.scene_id: b.source for b in bundles},
        **facts,
    }
    summary = assemble_dataset(
        units,
        out,
        provenance=provenance,
        licence=licences[0] if len(licences) == 1 else "other",
        title=out.name,
    )
    return ItemResult({"episodes": summary.episodes, "frames": summary.frames})


def _licence_id(text: str) -> str:
    """A scene's licence as the hub wants it: an identifier; a whole text stays in provenance."""
    text = text.strip()
    return text.lower() if text and len(text.split()) == 1 else "other" if text else "unknown"
