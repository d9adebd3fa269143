"""Stages `filter` and `align`: from a user's VLN-CE file to episodes in repaired scenes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ...formats.core.digest import file_digest
from ...formats.scene.bundle import load_bundle
from ...formats.vlnce.files import VlnceFile, read_vlnce, write_episodes, write_vlnce
from ...trajectory_sampler.alignment import align_episodes
from ...trajectory_sampler.stairs import filter_stairs
from ..engine.keys import code_version, digest
from ..engine.ledger import Ledger, Row
from ..engine.runner import ItemResult, StageSummary, WorkItem

STAGE = "align"
FILTER_STAGE = "filter"
MAX_STEP_M = 0.3  # the public rule of VLN-PE


def filter_item(source: Path, out: Path) -> WorkItem:
    """Filter the stair episodes out of a VLN-CE file.

    Raises:
        FileFormatError: not an episode file.
    """
    read_vlnce(source)  # say at once what is wrong with the user's file
    code = code_version("trajectory_sampler", "wayfinding", "formats", "pipeline/stages/align.py")
    key = digest(FILTER_STAGE, file_digest(source), MAX_STEP_M, code)
    return WorkItem(source.name, key, (out,), process_filter, (source, out, MAX_STEP_M))


def process_filter(source: Path, out: Path, max_step_m: float) -> ItemResult:
    """Write the episodes of `source` whose reference path climbs no stairs."""
    file = read_vlnce(source)
    result = filter_stairs(file, max_step_m)
    write_vlnce(out, result.kept)
    dropped = [[str(d.episode_id), d.reason] for d in result.dropped]
    facts = {"kept": len(result.kept.episodes), "dropped": len(dropped), "reasons": dropped}
    return ItemResult(facts)


def items(
    source: Path, filtered: Row, scenes: Mapping[str, Row], folder: Path, outs: Mapping[str, Path]
) -> list[WorkItem]:
    """One item per scene that the filtered file `source` names and that was repaired."""
    named = {episode.scene_stem for episode in read_vlnce(source).episodes}
    code = code_version("trajectory_sampler", "wayfinding", "formats", "pipeline/stages/align.py")
    result = []
    for scene in sorted(named & scenes.keys()):
        key = digest(STAGE, filtered.key, scenes[scene].key, code)
        arguments = (source, {scene: folder / scene}, outs[scene])
        result.append(WorkItem(scene, key, (outs[scene],), process, arguments))
    return result


def process(
    source: Path, scenes: Mapping[str, Path], out: Path, all_scenes: bool = False
) -> ItemResult:
    """Align the episodes of `source` that lie in `scenes`; with `all_scenes`, reject the others."""
    file = read_vlnce(source)
    if not all_scenes:
        wanted = tuple(e for e in file.episodes if e.scene_stem in scenes)
        file = replace(file, episodes=wanted)
    bundles = {name: load_bundle(path) for name, path in scenes.items()}
    result = align_episodes(file, bundles)
    write_episodes(out, result.episodes)
    facts = {
        "episodes": len(result.episodes),
        "rejected": [[str(name), reason] for name, reason in result.rejected],
        "moved": len(result.moved),
    }
    return ItemResult(facts)


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
