"""Stages `export`, `mcap` and `dataset`: episodes as LeRobot v3 and MCAP."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ....collectors.robots import RobotSpec
from ....formats.core.errors import check_name
from ....formats.core.rollout import EndReason
from ....formats.lerobot.features import DEPTH_STORAGES
from ....formats.lerobot.splits import held_out_scenes, is_published_holdout
from ....formats.process.source import code_digest
from ....formats.scene.bundle import INDEX_NAME
from ....formats.vlnce.files import read_episodes
from ....formats.vlnce.groups import group_by_path
from ....instruction_gen.review.decisions import DecisionFile
from ...engine.ledger import Row
from ...engine.work import WorkItem, digest, work_item
from ...execution.runner import Context, StageSummary, run_stage
from ..episodes.jobs import SampleJob
from ..instructions.instruct_job import InstructJob
from ..instructions.visibility import LookJob
from ..rollouts.render_job import RenderJob
from ..rollouts.replay_items import item_names
from ..rollouts.replay_job import ReplayJob
from ..scenes.repair import RepairJob
from ..scenes.scan import ScanJob
from .export_job import DatasetJob, UnitJob
from .mcap_job import McapJob
from .reviewed import REVIEW_NAME

STAGE = "export"
MCAP_STAGE = "mcap"
DATASET_STAGE = "dataset"
# What makes episodes and writes their pixels.
CODE = tuple(
    job.__module__
    for job in (ScanJob, RepairJob, SampleJob, LookJob, InstructJob, ReplayJob, RenderJob)
)


@dataclass(frozen=True)
class Dataset:
    """Output folders of one robot × controller × view.

    Attributes:
        name: `<robot>-<controller>-<view>`.
        scope: What the names of its items begin with, `<robot>/<controller>/<view>/`.
    """

    name: str
    scope: str
    units: Path
    lerobot: Path
    mcap: Path

    @staticmethod
    def under(root: Path, robot: str, controller: str, view: str) -> "Dataset":
        """Return the folders below an output folder."""
        name = f"{robot}-{controller}-{view}"
        folders = (root / kind / name for kind in ("units", "lerobot", "mcap"))
        return Dataset(name, f"{robot}/{controller}/{view}/", *folders)


def rows_to_export(
    frames: Mapping[str, Row], only_success: bool, flagged: Collection[str] = ()
) -> dict[str, Row]:
    """Return the rows of the render stage that are to be exported, by item.

    Args:
        flagged: walks to leave out, as `FlagFile` names them.
    """
    good = str(EndReason.SUCCESS)
    result = {}
    for name, row in frames.items():
        robot, controller, _, episode = name.split("/", 3)
        if f"{robot}/{controller}/{episode}" in flagged:
            continue
        if row.facts["end_reason"] == good or not only_success:
            result[name] = row
    return result


def run(
    context: Context,
    items: Mapping[str, Sequence[WorkItem]],
    scenes: Path,
    dataset: Dataset,
    facts: Mapping[str, Any],
    language: bool = False,
) -> list[StageSummary]:
    """Export one robot's rendered episodes: units, MCAP files, and the dataset of the units.

    Without a single episode there is no dataset, and none is left from before.

    Args:
        facts: configuration and seeds for the provenance.
        language: give the dataset LeRobot's language column.
    """
    out = context.ledger.root
    summaries = [run_stage(context, stage, items[stage], dataset.scope) for stage in items]
    # The folder of MCAP files is handed on as it is.
    context.ledger.discard(MCAP_STAGE, dataset.scope)
    units = summaries[0].good()
    joined = [dataset_item(units, out, scenes, dataset, facts, language)] if units else []
    summaries.append(run_stage(context, DATASET_STAGE, joined, dataset.name))
    context.ledger.discard(DATASET_STAGE, dataset.name)
    return summaries


def check_depth_storage(name: str) -> None:
    """Raise UnknownNameError unless `name` is a depth storage: `video` or `image`."""
    check_name("depth storage", name, DEPTH_STORAGES)


def items(
    frames: Mapping[str, Row],
    root: Path,
    scenes: Path,
    dataset: Dataset,
    robot: RobotSpec,
    *,
    depth_storage: str = "video",
    per_instruction: bool = False,
    mcap: bool = True,
) -> dict[str, list[WorkItem]]:
    """Return the items of the stages `export` and `mcap`: LeRobot units, and MCAP files.

    Args:
        frames: rows of the render stage by item; their outputs are relative to `root`.
        root: folder of the render stage's ledger.
        per_instruction: make one unit of each instruction, with the same frames.
        mcap: write MCAP files; otherwise that stage has no items.
    """
    reviewed = review_digests(root)
    units = _unit_items(frames, root, dataset, depth_storage, reviewed, per_instruction)
    files = (
        _mcap_items(frames, root, scenes, dataset, robot, depth_storage, reviewed) if mcap else []
    )
    return {STAGE: units, MCAP_STAGE: files}


def _unit_items(
    frames: Mapping[str, Row],
    root: Path,
    dataset: Dataset,
    depth_storage: str,
    reviewed: Callable[[str], str],
    per_instruction: bool,
) -> list[WorkItem]:
    """Return one item per LeRobot unit: of an episode, or of each of its instructions."""
    review = root / REVIEW_NAME
    result = []
    for name, row in frames.items():
        rollout = root / str(row.facts["rollout"])
        for number in range(row.facts["texts"]) if per_instruction else (None,):
            item = f"{name}.{number + 1}" if number else name
            if number and item in frames:  # another episode is called so
                item = f"{name}%.{number + 1}"
            out = dataset.units / item.rsplit("/", 1)[1]
            job = UnitJob(rollout, root / row.outputs[0], out, depth_storage, review, number)
            how = {
                "depth": depth_storage,
                "review": reviewed(name.rsplit("/", 1)[1]),
                "instruction": number,
            }
            result.append(work_item(STAGE, item, job, (out,), row.key, **how))
    return result


def review_digests(root: Path) -> Callable[[str], str]:
    """Return what people's decisions change about an episode, by the file name of its episode.

    A decision is about a path, so it exports the episodes of that path again and no others. Where
    an episode's path is not known, any decision does.
    """
    decisions = DecisionFile(root / REVIEW_NAME)
    by_path: dict[str, list[dict[str, Any]]] = {}
    for (path, _), decided in sorted(decisions.current().items()):
        by_path.setdefault(path, []).extend(
            asdict(decision) for _, decision in sorted(decided.items())
        )
    files = sorted((root / "episodes").glob("*.json.gz")) if by_path else []
    episodes = [e for f in files for e in read_episodes(f)]
    walked = group_by_path(episodes)
    paths = {n: e.trajectory_id for n, e in zip(item_names(walked), walked, strict=True)}

    def of(episode: str) -> str:
        if not by_path:
            return ""
        if episode not in paths:
            return digest(by_path)
        decided = by_path.get(paths[episode], [])
        return digest(decided) if decided else ""

    return of


def _mcap_items(
    frames: Mapping[str, Row],
    root: Path,
    scenes: Path,
    dataset: Dataset,
    robot: RobotSpec,
    depth_storage: str,
    reviewed: Callable[[str], str],
) -> list[WorkItem]:
    """Return one item per MCAP file with images."""
    held_out = tuple(sorted(held_out_scenes(_divided(frames, scenes))))
    result = []
    for name, row in frames.items():
        out = dataset.mcap / f"{name.rsplit('/', 1)[1]}.mcap"
        scene, rollout = scenes / str(row.facts["scene"]), root / str(row.facts["rollout"])
        labels = (dataset.name, held_out, depth_storage)
        review = root / REVIEW_NAME
        job = McapJob(
            rollout, root / row.outputs[0], scene, robot, *labels, review, code_digest(*CODE), out
        )
        how = {"labels": labels, "review": reviewed(out.stem)}
        result.append(work_item(MCAP_STAGE, name, job, (out,), row.key, **how))
    return result


def dataset_item(
    units: Mapping[str, Row],
    root: Path,
    scenes: Path,
    dataset: Dataset,
    facts: Mapping[str, Any],
    language: bool = False,
) -> WorkItem:
    """Join one robot's units into its dataset.

    Args:
        units: rows of the unit stage by item.
        scenes: folder of the run's repaired scenes; those that are held out do not depend on the
            robot, so that no mixture of robots trains where another validates.
        facts: configuration and seeds for the provenance.
        language: give it LeRobot's language column.
    """
    rows = list(units.values())
    all_scenes = _divided(units, scenes)
    used = tuple(scenes / name for name in sorted({str(row.facts["scene"]) for row in rows}))
    job = DatasetJob(
        tuple(root / row.outputs[0] for row in rows),
        used,
        all_scenes,
        dataset.lerobot,
        tuple(row.facts["made"] for row in rows),
        rows[0].facts["encoding"],
        dict(facts),
        code_digest(*CODE),
        language,
    )
    inputs = {
        "units": [row.key for row in rows],
        "scenes": all_scenes,
        "options": dict(facts),
        **({"language": True} if language else {}),
    }
    return work_item(DATASET_STAGE, dataset.name, job, (dataset.lerobot,), **inputs)


def _divided(rows: Mapping[str, Row], scenes: Path) -> tuple[str, ...]:
    """Return the scenes to hold some out from; none where the episodes' source has a split."""
    own = any(is_published_holdout(str(row.facts.get("split", ""))) for row in rows.values())
    return () if own else _scene_names(scenes)


def _scene_names(scenes: Path) -> tuple[str, ...]:
    return tuple(sorted(path.parent.name for path in scenes.glob(f"*/{INDEX_NAME}")))
