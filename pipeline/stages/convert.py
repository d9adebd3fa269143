"""Stages `lerobot`, `mcap` and `n1`: recorded episodes from one format to another."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...formats.convert.dataset import DatasetFacts
from ...formats.convert.episodes import (
    dataset_from_units,
    joint_facts,
    mcap_from_unit,
    unit_dataset,
)
from ...formats.core.atomic import write_json
from ...formats.core.errors import InputError
from ...formats.internnav import layout
from ...formats.internnav.tokens import own_vocabulary, read_vocabulary
from ...formats.internnav.writer import SceneEpisode, share_instructions, write_scene
from ...formats.lerobot import EpisodeUnit, read_episode_unit
from ..engine.keys import code_version, digest
from ..engine.ledger import Row
from ..engine.runner import Context, ItemResult, StageSummary, WorkItem, run_stage
from .convert_source import CODE, UNIT_STAGE, Kind, Options, Source, source_note, unit_items

log = logging.getLogger(__name__)


def run(
    context: Context, source: Source, target: Kind, options: Options
) -> tuple[list[StageSummary], list[Path]]:
    """Convert all episodes; return the stages' summaries and what was written.

    Raises:
        InputError: the source is already of that kind or unusable, or holds several robots.
    """
    if source.kind is target:
        raise InputError(f"{source.path}: is {target} already")
    root = context.ledger.root
    summaries, written = [], []
    for name, items in unit_items(source, root / "units", options).items():
        units = run_stage(context, UNIT_STAGE, items, f"{name}/", required=True)
        summaries.append(units)
        rows = dict(sorted(units.good().items()))
        _check_alike(rows)
        _tell_doubts(rows)
        folder = root / target / name
        if target is Kind.LEROBOT:
            last = [_dataset_item(rows, root, folder, name, source, options)]
        elif target is Kind.MCAP:
            last = _mcap_items(rows, root, folder)
        else:
            last = _scene_items(rows, root, folder, name, options)
        summaries.append(run_stage(context, str(target), last, f"{name}/"))
        context.ledger.discard(str(target), f"{name}/")
        written.append(folder)
    return summaries, written


def process_dataset(units: Sequence[Path], out: Path, facts: DatasetFacts) -> ItemResult:
    """Assemble a LeRobot dataset."""
    summary = dataset_from_units(units, out, facts)
    return ItemResult({"episodes": summary.episodes, "frames": summary.frames})


def process_to_mcap(unit: Path, out: Path) -> ItemResult:
    """Write a unit's MCAP file."""
    mcap_from_unit(unit, out)
    return ItemResult({"bytes": out.stat().st_size})


def process_scene(
    episodes: Sequence[SceneEpisode], vocabulary: Any, dataset: dict[str, Any] | None, out: Path
) -> ItemResult:
    """Write one scene in InternData-N1's layout."""
    frames = write_scene(out, episodes, vocabulary, dataset)
    return ItemResult({"episodes": len(episodes), "frames": frames})


def _check_alike(rows: Mapping[str, Row]) -> None:
    """One dataset holds one robot, one camera and one frame rate."""
    first = next(iter(rows.values()))
    for row in rows.values():
        if row.facts["alike"] != first.facts["alike"]:
            what = "robot" if row.facts["robot"] != first.facts["robot"] else "view or frame rate"
            raise InputError(
                f"{row.facts['source']}: {row.facts['robot']}, another {what} than "
                f"{first.facts['source']} ({first.facts['robot']}); one dataset holds one: "
                "convert them from folders of their own"
            )


def _tell_doubts(rows: Mapping[str, Row]) -> None:
    """Warn of others' frame rates that are not believed."""
    doubted = [
        row
        for row in rows.values()
        if not row.facts.get("ours", True)
        and (row.facts["fps"], row.facts["timestamp_step_s"]) != (4, 0.25)
    ]
    if doubted:
        facts = doubted[0].facts
        log.warning(
            "%d episodes say %s frames/s and rows %s s apart; taken as asked for instead",
            len(doubted),
            facts["fps"],
            facts["timestamp_step_s"],
        )


def _tell_size(unit: EpisodeUnit) -> None:
    size = (unit.columns["camera_width_px"], unit.columns["camera_height_px"])
    if size != (layout.IMAGE_SIZE_PX, layout.IMAGE_SIZE_PX):
        log.warning(
            "images of %d × %d; InternNav's depth encoder takes %d × %d: render that size for it",
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
    key = digest(Kind.LEROBOT, keys, facts.to_json(), code_version(*CODE))
    return WorkItem(f"{name}/dataset", key, (out,), process_dataset, (units, out, facts))


def _mcap_items(rows: Mapping[str, Row], root: Path, folder: Path) -> list[WorkItem]:
    code = code_version(*CODE)
    result = []
    for item, row in rows.items():
        out = folder / f"{item.rsplit('/', 1)[1]}.mcap"
        key = digest(Kind.MCAP, row.key, code)
        result.append(WorkItem(item, key, (out,), process_to_mcap, (root / row.outputs[0], out)))
    return result


def _scene_items(
    rows: Mapping[str, Row], root: Path, folder: Path, name: str, options: Options
) -> list[WorkItem]:
    units = [read_episode_unit(root / row.outputs[0]) for row in rows.values()]
    _tell_size(units[0])
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
    code = code_version(*CODE)
    for (scan, scene), members in scenes.items():
        ids = {unit.columns["scene_id"] for unit, _, _ in members}
        if len(ids) > 1:
            raise InputError(f"scenes {', '.join(sorted(ids))} would share the folder {scene}")
        facts = unit_dataset(members[0][0].folder)
        dataset = None if facts is None else facts.to_json()
        out = folder / scan / scene
        episodes = tuple(episode for _, episode, _ in members)
        key = digest(Kind.N1, [k for *_, k in members], tasks, vocabulary.words, dataset, code)
        arguments = (episodes, vocabulary, dataset, out)
        result.append(WorkItem(f"{name}/{scan}/{scene}", key, (out,), process_scene, arguments))
    write_json(folder / layout.VOCABULARY_NAME, vocabulary.to_json())
    return result
