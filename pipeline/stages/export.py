"""Stages `export`, `mcap` and `dataset`: episodes as LeRobot v3 and MCAP."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...formats.convert.dataset import DatasetFacts
from ...formats.core.digest import file_digest
from ...formats.core.errors import UnknownNameError, VlnpeError
from ...formats.core.licences import licence_id
from ...formats.core.rollout import EndReason, Rollout
from ...formats.lerobot import assemble_dataset, write_episode_unit
from ...formats.lerobot.features import DEPTH_STORAGES
from ...formats.lerobot.splits import held_out_scenes
from ...formats.mcap.episode import write_episode_mcap
from ...formats.mcap.rollout import read_rollout
from ...formats.rendered.folder import read_frame_folder
from ...formats.scene.bundle import INDEX_NAME, load_bundle
from ...instruction_gen.review.decisions import DecisionFile, apply_decisions
from ..engine.keys import code_version, digest
from ..engine.ledger import Row
from ..engine.runner import Context, ItemResult, StageSummary, WorkItem, run_stage
from ..provenance import encoding_facts, episode_facts, provenance, scene_provenance

STAGE = "export"
MCAP_STAGE = "mcap"
DATASET_STAGE = "dataset"
SCENE_MAP = "after.png"
REVIEW_NAME = "review.jsonl"  # in the run folder: what people decided about instructions
CODE = (
    "formats",
    "instruction_gen/review/decisions.py",
    "pipeline/stages/export.py",
    "pipeline/provenance.py",
)


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
    depth_storage: str = "video",
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
        depth_storage: see `check_depth_storage`.
    """
    out = context.ledger.root
    items = unit_items(frames, root, dataset, depth_storage)
    units = run_stage(context, STAGE, items, scope)
    items = mcap_items(frames, root, scenes, dataset, depth_storage)
    summaries = [units, run_stage(context, MCAP_STAGE, items, scope)]
    # The folder of MCAP files is handed on as it is.
    context.ledger.discard(MCAP_STAGE, scope)
    items = [dataset_item(units.good(), out, scenes, dataset, facts)] if units.good() else []
    summaries.append(run_stage(context, DATASET_STAGE, items, dataset.name))
    context.ledger.discard(DATASET_STAGE, dataset.name)
    return summaries


def check_depth_storage(name: str) -> None:
    """Raise UnknownNameError unless depth can be kept so: `video` or `image`."""
    if name not in DEPTH_STORAGES:
        raise UnknownNameError("depth storage", name, DEPTH_STORAGES)


def unit_items(
    frames: Mapping[str, Row], root: Path, dataset: Dataset, depth_storage: str
) -> list[WorkItem]:
    """One LeRobot unit per rendered episode; `frames` are rows of the render stage by item."""
    code = code_version(*CODE)
    reviewed = _review_digest(root)
    result = []
    for name, row in frames.items():
        out = dataset.units / name.rsplit("/", 1)[1]
        rollout = root / str(row.facts["rollout"])
        arguments = (rollout, root / row.outputs[0], out, depth_storage, root / REVIEW_NAME)
        key = digest(STAGE, row.key, depth_storage, reviewed, code)
        result.append(WorkItem(name, key, (out,), process_unit, arguments))
    return result


def process_unit(
    rollout: Path, frames: Path, out: Path, depth_storage: str, review: Path
) -> ItemResult:
    """Write one episode's LeRobot unit."""
    seen = read_frame_folder(frames)
    recorded = reviewed_rollout(rollout, review)
    write_episode_unit(
        out,
        recorded,
        seen.arrays,
        seen.frames_per_second,
        rgb_video=seen.rgb_video,
        depth_video=seen.depth_video,
        camera=seen.camera,
        depth_range=seen.depth_range,
        light=seen.light,
        rgb_codec=seen.rgb_codec,
        depth_storage=depth_storage,
    )
    facts = {
        "frames": seen.facts["frames"],
        "scene": seen.facts["scene_id"],
        "made": episode_facts(recorded),
        "encoding": encoding_facts(seen.facts, depth_storage),
    }
    return ItemResult(facts)


def _review_digest(root: Path) -> str:
    path = root / REVIEW_NAME
    return file_digest(path) if path.is_file() else ""


def reviewed_rollout(rollout: Path, review: Path) -> Rollout:
    """A rollout whose episode has the texts that people left of its instructions.

    Raises:
        VlnpeError: they rejected all of them.
    """
    recorded = read_rollout(rollout)
    if not review.is_file():
        return recorded
    kept, lost = apply_decisions([recorded.episode], DecisionFile(review))
    if lost:
        raise VlnpeError(f"rejected in review: {lost[recorded.episode.episode_id]}")
    return replace(recorded, episode=kept[0])


def mcap_items(
    frames: Mapping[str, Row], root: Path, scenes: Path, dataset: Dataset, depth_storage: str
) -> list[WorkItem]:
    """One MCAP with images per rendered episode."""
    code = code_version(*CODE)
    reviewed = _review_digest(root)
    held_out = tuple(sorted(held_out_scenes(_scene_names(scenes))))
    result = []
    for name, row in frames.items():
        out = dataset.mcap / f"{name.rsplit('/', 1)[1]}.mcap"
        scene, rollout = scenes / str(row.facts["scene"]), root / str(row.facts["rollout"])
        told = (dataset.name, held_out, depth_storage)
        arguments = (rollout, root / row.outputs[0], scene, *told, root / REVIEW_NAME, out)
        key = digest(MCAP_STAGE, row.key, told, reviewed, code)
        result.append(WorkItem(name, key, (out,), process_mcap, arguments))
    return result


def process_mcap(
    rollout: Path,
    frames: Path,
    scene: Path,
    name: str,
    held_out: Sequence[str],
    depth_storage: str,
    review: Path,
    out: Path,
) -> ItemResult:
    """Write one episode's MCAP, which knows the dataset it belongs to."""
    bundle = load_bundle(scene)
    encoding = encoding_facts(read_frame_folder(frames).facts, depth_storage)
    facts = DatasetFacts(
        name,
        licence_id(str(bundle.source.get("licence") or "")),
        scene_provenance(bundle, held_out, encoding),
        depth_storage=depth_storage,
    )
    write_episode_mcap(
        out,
        reviewed_rollout(rollout, review),
        frames,
        scene_map=(scene / SCENE_MAP).read_bytes(),
        dataset=facts.to_json(),
    )
    return ItemResult({"bytes": out.stat().st_size})


def dataset_item(
    units: Mapping[str, Row],
    root: Path,
    scenes: Path,
    dataset: Dataset,
    facts: Mapping[str, Any],
) -> WorkItem:
    """Join one robot's units into its dataset.

    Args:
        units: rows of the unit stage by item.
        root: the ledger's folder.
        scenes: folder of the run's repaired scenes; those that are held out do not depend on the
            robot, so that no mixture of robots trains where another validates.
        dataset: where it goes.
        facts: configuration and seeds for the provenance.
    """
    rows = list(units.values())
    all_scenes = _scene_names(scenes)
    used = tuple(scenes / name for name in sorted({str(row.facts["scene"]) for row in rows}))
    key = digest(
        DATASET_STAGE, [row.key for row in rows], all_scenes, dict(facts), code_version(*CODE)
    )
    arguments = (
        tuple(root / row.outputs[0] for row in rows),
        used,
        all_scenes,
        dataset.lerobot,
        tuple(row.facts["made"] for row in rows),
        rows[0].facts["encoding"],
        dict(facts),
    )
    return WorkItem(dataset.name, key, (dataset.lerobot,), process_dataset, arguments)


def _scene_names(scenes: Path) -> tuple[str, ...]:
    return tuple(sorted(path.parent.name for path in scenes.glob(f"*/{INDEX_NAME}")))


def process_dataset(
    units: Sequence[Path],
    scenes: Sequence[Path],
    all_scenes: Sequence[str],
    out: Path,
    made: Sequence[Mapping[str, Any]],
    encoding: Mapping[str, Any],
    facts: Mapping[str, Any],
) -> ItemResult:
    """Assemble one dataset."""
    bundles = [load_bundle(scene) for scene in scenes]
    licences = sorted({licence_id(str(b.source.get("licence") or "")) for b in bundles})
    summary = assemble_dataset(
        units,
        out,
        provenance=provenance(made, bundles, all_scenes, encoding, facts),
        licence="-and-".join(licences),
        title=out.name,
    )
    return ItemResult({"episodes": summary.episodes, "frames": summary.frames})
