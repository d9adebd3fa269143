"""Stages `lerobot`, `mcap` and `n1`: recorded episodes from one format to another."""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

from ....collectors.robots import get_robot
from ....formats.convert.episodes import joint_facts, unit_dataset
from ....formats.core.atomic import write_json
from ....formats.core.errors import InputError, UnknownNameError
from ....formats.internnav import layout
from ....formats.internnav.tokens import own_vocabulary, read_vocabulary
from ....formats.internnav.writer import SceneEpisode, share_instructions
from ....formats.lerobot import EpisodeUnit, read_episode_unit
from ....formats.trainers.registry import LAYOUTS
from ....rendering.scene.urdf import robot_urdf
from ...engine.ledger import Row
from ...engine.work import WorkItem, work_item
from ...execution.runner import Context, StageSummary, run_stage
from .jobs import (
    Kind,
    N1SceneJob,
    Options,
    UnitMcapJob,
    UnitsDatasetJob,
    source_note,
)
from .layout_items import Choice, check_source, group_name, layout_items
from .source import UNIT_STAGE, Source, unit_items

log = logging.getLogger(__name__)


def run(
    context: Context,
    sources: Sequence[Source],
    target: str,
    options: Options,
    choice: Choice,
) -> tuple[list[StageSummary], list[Path]]:
    """Convert all episodes; return the stages' summaries and what was written.

    Args:
        target: One of `Kind` or of `LAYOUTS`.

    Raises:
        InputError: a source is unusable, or holds several robots.
    """
    root = context.ledger.root
    summaries, written = [], []
    groups: dict[str, dict[str, Row]] = {}
    for source in sources:
        for name, items in unit_items(source, root / "units", options).items():
            units = run_stage(context, UNIT_STAGE, items, f"{name}/", required=True)
            summaries.append(units)
            rows = dict(sorted(units.good().items()))
            _check_alike(rows)
            first = next(iter(rows.values()))
            check_source(target, name, read_episode_unit(root / first.outputs[0]))
            _warn_of_doubts(rows)
            if source.kind == Kind.ROS2:
                _warn_of_texts(rows)
            if target in LAYOUTS:
                groups.setdefault(group_name(target, name), {}).update(rows)
                continue
            folder = root / target / name
            if target == Kind.LEROBOT:
                last = [_dataset_item(rows, root, folder, name, source, options)]
            elif target == Kind.MCAP:
                last = _mcap_items(rows, root, folder)
            elif target == Kind.ROS2:
                last = _bag_items(rows, root, folder, options)
            else:
                last = _scene_items(rows, root, folder, name, options)
                context.ledger.record([folder / layout.VOCABULARY_NAME])
            summaries.append(_finish(context, target, name, last))
            written.append(folder)
    for name, rows in groups.items():
        done = _finish(context, target, name, layout_items(target, rows, root, name, choice))
        summaries.append(done)
        written += sorted({root / o for row in done.good().values() for o in row.outputs})
    return summaries, written


def _finish(context: Context, target: str, name: str, items: Sequence[WorkItem]) -> StageSummary:
    """Write what a dataset, or a group of them, is converted to."""
    summary = run_stage(context, target, items, f"{name}/")
    context.ledger.discard(target, f"{name}/")
    return summary


def _check_alike(rows: Mapping[str, Row]) -> None:
    """Raise InputError unless all units have one robot, one camera and one frame rate."""
    first = next(iter(rows.values()))
    for row in rows.values():
        if row.facts["alike"] != first.facts["alike"]:
            what = "robot" if row.facts["robot"] != first.facts["robot"] else "view or frame rate"
            raise InputError(
                f"{row.facts['source']} ({row.facts['robot']}) has a different {what} from "
                f"{first.facts['source']} ({first.facts['robot']}); a dataset has only one: "
                "convert them from separate folders"
            )


def _warn_of_doubts(rows: Mapping[str, Row]) -> None:
    """Warn of frame rates that contradict the files' own timestamps."""
    doubted = [
        row
        for row in rows.values()
        if not row.facts.get("ours", True)
        and (row.facts["fps"], row.facts["timestamp_step_s"]) != (4, 0.25)
    ]
    if doubted:
        facts = doubted[0].facts
        log.warning(
            "%d episodes declare %s frames/s and timestamps %s s apart; using the requested rate",
            len(doubted),
            facts["fps"],
            facts["timestamp_step_s"],
        )


def _warn_of_texts(rows: Mapping[str, Row]) -> None:
    """Warn of walks of robots' logs without an instruction."""
    if silent := sum(not row.facts["has_text"] for row in rows.values()):
        log.warning(
            "%d of %d walks have no instruction: --instruction gives texts, which `vlnpe review` "
            "of the output folder writes",
            silent,
            len(rows),
        )


def _warn_of_size(unit: EpisodeUnit) -> None:
    size = (unit.columns["camera_width_px"], unit.columns["camera_height_px"])
    if size != (layout.IMAGE_SIZE_PX, layout.IMAGE_SIZE_PX):
        log.warning(
            "images are %d × %d px, but InternNav's depth encoder takes %d × %d: render that size",
            *size,
            layout.IMAGE_SIZE_PX,
            layout.IMAGE_SIZE_PX,
        )


def _dataset_item(
    rows: Mapping[str, Row],
    root: Path,
    out: Path,
    name: str,
    source: Source,
    options: Options,
) -> WorkItem:
    units = tuple(root / row.outputs[0] for row in rows.values())
    facts = joint_facts(units, name, options.licence, source_note(source.kind))
    keys = [row.key for row in rows.values()]
    job = UnitsDatasetJob(units, out, facts)
    return work_item(Kind.LEROBOT, f"{name}/dataset", job, (out,), keys, facts.to_json())


def _mcap_items(rows: Mapping[str, Row], root: Path, folder: Path) -> list[WorkItem]:
    result = []
    for item, row in rows.items():
        out = folder / f"{item.rsplit('/', 1)[1]}.mcap"
        job = UnitMcapJob(root / row.outputs[0], out)
        result.append(work_item(Kind.MCAP, item, job, (out,), row.key))
    return result


def _bag_items(
    rows: Mapping[str, Row], root: Path, folder: Path, options: Options
) -> list[WorkItem]:
    from .ros2_job import UnitRos2Job  # needs an extra

    name, urdf = options.assumptions.robot or next(iter(rows.values())).facts["robot"], None
    try:
        urdf = robot_urdf(get_robot(name))
    except UnknownNameError:
        if options.assumptions.robot:
            raise
        log.warning("no model of %s, so no /robot_description; --robot takes its folder", name)
    result = []
    for item, row in rows.items():
        out = folder / item.rsplit("/", 1)[1]
        job = UnitRos2Job(root / row.outputs[0], urdf, out)
        result.append(work_item(Kind.ROS2, item, job, (out,), row.key, urdf))
    return result


def _scene_items(
    rows: Mapping[str, Row], root: Path, folder: Path, name: str, options: Options
) -> list[WorkItem]:
    units = [read_episode_unit(root / row.outputs[0]) for row in rows.values()]
    _warn_of_size(units[0])
    tasks = share_instructions(units)
    texts = [text for own in tasks for text in own]
    vocabulary = read_vocabulary(options.vocabulary) if options.vocabulary else None
    vocabulary = vocabulary or own_vocabulary(texts)
    scenes: dict[tuple[str, str], list[tuple[EpisodeUnit, SceneEpisode, str]]] = {}
    for unit, own, row in zip(units, tasks, rows.values(), strict=True):
        place = (
            options.scan or layout.scan_name(unit.robot, unit.columns["controller"]),
            layout.scene_name(unit.columns["scene_id"]),
        )
        scenes.setdefault(place, []).append((unit, SceneEpisode(unit.folder, own), row.key))
    result = []
    for (scan, scene), members in scenes.items():
        ids = {unit.columns["scene_id"] for unit, _, _ in members}
        if len(ids) > 1:
            raise InputError(f"scenes {', '.join(sorted(ids))} would share the folder {scene}")
        facts = unit_dataset(members[0][0].folder)
        dataset = None if facts is None else facts.to_json()
        out = folder / scan / scene
        episodes = tuple(episode for _, episode, _ in members)
        every = options.every_frame
        job = N1SceneJob(episodes, vocabulary, dataset, every, out)
        inputs = ([k for *_, k in members], tasks, vocabulary.words, dataset, every)
        result.append(work_item(Kind.N1, f"{name}/{scan}/{scene}", job, (out,), *inputs))
    write_json(folder / layout.VOCABULARY_NAME, vocabulary.to_json())
    return result
