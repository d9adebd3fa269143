"""Stages `filter` and `align`: from users' VLN-CE files to episodes in repaired scenes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ....formats.core.atomic import file_digest
from ....formats.vlnce.files import read_vlnce
from ....trajectory_sampler.vlnce.align_config import AlignConfig
from ....trajectory_sampler.vlnce.stairs import StairRules
from ...engine.ledger import Ledger, Row
from ...engine.work import WorkItem, work_item
from ...execution.runner import StageSummary
from .jobs import AlignJob, FilterJob

STAGE = "align"
FILTER_STAGE = "filter"


def filter_item(
    source: Path,
    out: Path,
    rules: StairRules,
    scenes: Mapping[str, Row] | None = None,
    scenes_folder: Path | None = None,
) -> WorkItem:
    """Filter the stair episodes out of a VLN-CE file.

    Args:
        scenes: rows of the repair stage by scene id, for rules that need them.
    """
    read_vlnce(source)  # say at once what is wrong with the user's file
    repaired = (scenes or {}) if rules.need_scenes else {}
    folders = {name: scenes_folder / name for name in repaired} if scenes_folder else {}
    job = FilterJob(source, out, rules, folders)
    made_of = {"file": file_digest(source), "scenes": {n: row.key for n, row in repaired.items()}}
    return work_item(FILTER_STAGE, source.name, job, (out,), rules, **made_of)


def items(
    sources: Mapping[Path, str],
    scenes: Mapping[str, Row],
    folder: Path,
    outs: Mapping[str, Path],
    config: AlignConfig,
) -> list[WorkItem]:
    """Return one item per file and scene that it names and that was repaired.

    Args:
        sources: what each file's content depends on, by file.
        outs: filled with the episode file of each item, by its name.
    """
    result = []
    for source, content_key in sources.items():
        file = read_vlnce(source)
        named = {episode.scene_stem for episode in file.episodes}
        for scene in sorted(named & scenes.keys()):
            name = part_name(file.split, scene, len(sources))
            job = AlignJob(source, {scene: folder / scene}, outs[name], config)
            inputs = (content_key, scenes[scene].key, config)
            result.append(work_item(STAGE, name, job, (outs[name],), *inputs))
    return result


def part_name(split: str, scene: str, files: int) -> str:
    """Return the name of one scene's share of a file.

    Of one among several files, with its split.
    """
    return scene if files == 1 else f"{split}@{scene}"


def scene_of_part(name: str) -> str:
    """Return the scene of a share that `part_name` named."""
    return name.rsplit("@", 1)[-1]


def record_rejected(
    ledger: Ledger,
    filtered: StageSummary,
    aligned: StageSummary,
    sources: Mapping[Path, str],
    scenes: Mapping[str, Row],
) -> None:
    """Quarantine, episode by episode, what could not be read or aligned, or has no scene."""
    count = len(sources)
    for row in filtered.good().values():
        for _, name, reason in row.facts.get("bad", ()):
            name = _episode_name(row.facts["split"], name, count)
            ledger.add(filtered.quarantined_episode(name, "FileFormatError", reason))
    for row in aligned.good().values():
        for name, reason in row.facts["rejected"]:
            name = _episode_name(row.facts["split"], name, count)
            ledger.add(aligned.quarantined_episode(name, "SceneError", reason))
    repaired = ", ".join(sorted(scenes)) or "none"
    for source in sources:
        file = read_vlnce(source)
        for episode in file.episodes:
            if episode.scene_stem not in scenes:
                reason = f"scene {episode.scene_id!r} is not among the repaired: {repaired}"
                name = _episode_name(file.split, str(episode.episode_id), count)
                ledger.add(aligned.quarantined_episode(name, "SceneError", reason))
    ledger.save()


def _episode_name(split: str, name: str, files: int) -> str:
    return name if files == 1 else f"{split}/{name}"


def filter_lines(facts: Mapping[str, Any]) -> list[str]:
    """Return what the stair filter did to one split, in words: episodes and paths, by reason."""
    counts, split = facts["counts"], facts["split"]

    def counted(pair: Sequence[int]) -> str:
        episodes, paths = ("" if count == 1 else "s" for count in pair)
        return f"{pair[0]} episode{episodes} ({pair[1]} path{paths})"

    lines = [f"{split}: kept {counted(counts['kept'])}, dropped {counted(counts['dropped'])}"]
    lines += [f"  by {rule}: {counted(pair)}" for rule, pair in counts["by_rule"].items()]
    if counts["climbable"][0]:
        lines.append(f"  kept although it climbs: {counted(counts['climbable'])}")
    lines += [
        f"  cannot be judged by {rule}: {counted(pair)} {cause}; kept"
        for rule, causes in counts["not_judged"].items()
        for cause, pair in causes.items()
    ]
    lines += [f"  unusable {name}: {reason}" for _, name, reason in facts["bad"]]
    return lines
