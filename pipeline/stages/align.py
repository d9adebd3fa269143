"""Stages `filter` and `align`: from a user's VLN-CE file to episodes in repaired scenes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ...formats.core.atomic import file_digest
from ...formats.vlnce.files import VlnceFile, read_vlnce
from ..engine.ledger import Ledger, Row
from ..engine.runner import StageSummary
from ..engine.work import WorkItem, work_item
from ..jobs.episodes import AlignJob, FilterJob

STAGE = "align"
FILTER_STAGE = "filter"
MAX_STEP_M = 0.3  # the public rule of VLN-PE


def filter_item(source: Path, out: Path) -> WorkItem:
    """Filter the stair episodes out of a VLN-CE file.

    Raises:
        FileFormatError: not an episode file.
    """
    read_vlnce(source)  # say at once what is wrong with the user's file
    job = FilterJob(source, out, MAX_STEP_M)
    inputs = (file_digest(source), MAX_STEP_M)
    return work_item(FILTER_STAGE, source.name, job, (out,), *inputs)


def items(
    source: Path, filtered: Row, scenes: Mapping[str, Row], folder: Path, outs: Mapping[str, Path]
) -> list[WorkItem]:
    """One item per scene that the filtered file `source` names and that was repaired."""
    named = {episode.scene_stem for episode in read_vlnce(source).episodes}
    result = []
    for scene in sorted(named & scenes.keys()):
        job = AlignJob(source, {scene: folder / scene}, outs[scene])
        inputs = (filtered.key, scenes[scene].key)
        result.append(work_item(STAGE, scene, job, (outs[scene],), *inputs))
    return result


def record_rejected(
    ledger: Ledger, summary: StageSummary, source: Path, scenes: Mapping[str, Row]
) -> None:
    """Quarantine, episode by episode, what could not be aligned or has no scene."""
    reasons = {
        name: reason for row in summary.good().values() for name, reason in row.facts["rejected"]
    }
    file: VlnceFile = read_vlnce(source)
    for episode in file.episodes:
        if episode.scene_stem not in scenes:
            known = ", ".join(sorted(scenes)) or "none"
            reasons[str(episode.episode_id)] = (
                f"scene {episode.scene_id!r} was not given or not repaired; repaired: {known}"
            )
    for name, reason in sorted(reasons.items()):
        error = {"type": "SceneError", "reason": reason}
        row = Row(STAGE, f"episode {name}", "", "quarantined", error=error)
        ledger.add(row)
        summary.rows.append(row)
        summary.quarantined += 1
    ledger.save()
