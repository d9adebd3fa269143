"""Stages `export`, `mcap` and `dataset`: episodes as LeRobot v3 and MCAP."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ...formats.core.errors import UnknownNameError
from ...formats.core.rollout import EndReason
from ...formats.lerobot.features import DEPTH_STORAGES
from ...formats.lerobot.splits import held_out_scenes
from ...formats.scene.bundle import INDEX_NAME
from ...formats.vlnce.files import read_episodes
from ...instruction_gen.review.decisions import DecisionFile
from ..engine.keys import digest
from ..engine.ledger import Row
from ..engine.run_folder import safe_name
from ..engine.runner import Context, StageSummary, run_stage
from ..engine.work import WorkItem, work_item
from ..jobs.export import DatasetJob, UnitJob
from ..jobs.mcap import McapJob
from ..jobs.reviewed import REVIEW_NAME
from ..kept_robots import kept

STAGE = "export"
MCAP_STAGE = "mcap"
DATASET_STAGE = "dataset"


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
    reviewed = review_digests(root)
    result = []
    for name, row in frames.items():
        out = dataset.units / name.rsplit("/", 1)[1]
        rollout = root / str(row.facts["rollout"])
        job = UnitJob(rollout, root / row.outputs[0], out, depth_storage, root / REVIEW_NAME)
        inputs = (row.key, depth_storage, reviewed(out.name))
        result.append(work_item(STAGE, name, job, (out,), *inputs))
    return result


def review_digests(root: Path) -> Callable[[str], str]:
    """Return what people's decisions change about an episode, by the file name of its episode.

    A decision is about a path, so it exports the episodes of that path again and no others. Where
    an episode's path is not known, any decision does.
    """
    decisions = DecisionFile(root / REVIEW_NAME)
    by_path: dict[str, list[dict[str, Any]]] = {}
    for (path, _), decided in sorted(decisions.current().items()):
        by_path.setdefault(path, []).extend(asdict(one) for _, one in sorted(decided.items()))
    files = sorted((root / "episodes").glob("*.json.gz")) if by_path else []
    paths = {safe_name(e.episode_id): e.trajectory_id for f in files for e in read_episodes(f)}

    def of(episode: str) -> str:
        if not by_path:
            return ""
        if episode not in paths:
            return digest(by_path)
        decided = by_path.get(paths[episode], [])
        return digest(decided) if decided else ""

    return of


def mcap_items(
    frames: Mapping[str, Row], root: Path, scenes: Path, dataset: Dataset, depth_storage: str
) -> list[WorkItem]:
    """One MCAP with images per rendered episode."""
    reviewed = review_digests(root)
    held_out = tuple(sorted(held_out_scenes(_scene_names(scenes))))
    result = []
    for name, row in frames.items():
        out = dataset.mcap / f"{name.rsplit('/', 1)[1]}.mcap"
        scene, rollout = scenes / str(row.facts["scene"]), root / str(row.facts["rollout"])
        told = (dataset.name, held_out, depth_storage)
        robot = kept(name.split("/")[0], root)
        review = root / REVIEW_NAME
        job = McapJob(rollout, root / row.outputs[0], scene, robot, *told, review, out)
        result.append(work_item(MCAP_STAGE, name, job, (out,), row.key, told, reviewed(out.stem)))
    return result


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
    job = DatasetJob(
        tuple(root / row.outputs[0] for row in rows),
        used,
        all_scenes,
        dataset.lerobot,
        tuple(row.facts["made"] for row in rows),
        rows[0].facts["encoding"],
        dict(facts),
    )
    inputs = ([row.key for row in rows], all_scenes, dict(facts))
    return work_item(DATASET_STAGE, dataset.name, job, (dataset.lerobot,), *inputs)


def _scene_names(scenes: Path) -> tuple[str, ...]:
    return tuple(sorted(path.parent.name for path in scenes.glob(f"*/{INDEX_NAME}")))
