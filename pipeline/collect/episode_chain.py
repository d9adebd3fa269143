"""From scans to instructed episodes: `scan` to `repair`, then `sample` or `filter` and `align`."""

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ...collectors.robots import RobotSpec
from ...formats.core.episode import Episode
from ...formats.vlnce.records import split_name
from ...instruction_gen.llm.settings import CACHE_NAME, LlmSettings
from ...instruction_gen.records import InstructConfig
from ...scene_repair.config import RepairConfig
from ...trajectory_sampler.config import SampleConfig
from ...trajectory_sampler.vlnce.align_config import AlignConfig
from ...trajectory_sampler.vlnce.stairs import StairRules
from ..engine.ledger import Row
from ..execution.runner import StageSummary, WorkItem
from ..inputs.builtin import BuiltIn
from ..stages.episodes import align_items as align
from ..stages.episodes import sample_items as episodes
from ..stages.instructions import instruct_items as instruct
from ..stages.instructions import sight_items as sight
from ..stages.instructions.instruct_job import InstructJob
from ..stages.scenes import items as repair
from .run import Run


@dataclass(frozen=True)
class Wording:
    """Settings of the instructions of a run.

    Attributes:
        robot: the robot whose camera says what there is to see on the way.
        vision: the model that names things and rooms of scenes without labels, if any.
    """

    config: InstructConfig
    robot: RobotSpec
    vision: LlmSettings | None = None


def repaired(
    run: Run, sources: Mapping[str, Path | BuiltIn], config: RepairConfig, allow_unsound: bool
) -> dict[str, Row]:
    """Repair the scans, by scene id; generate and scan the built-in ones first.

    Scenes that are not sound are quarantined unless they are allowed.
    """
    folder = run.folder
    files = {name: source for name, source in sources.items() if isinstance(source, Path)}
    built = [source for source in sources.values() if isinstance(source, BuiltIn)]
    if built:
        items = [repair.scan_item(b, folder.scan(b.name)) for b in built]
        scanned = run.stage(repair.SCAN_STAGE, items, required=True).good()
        files |= {name: folder.scan(name) / "scan.glb" for name in scanned}
    items = repair.items(files, config, folder.scenes)
    rows = run.stage(repair.STAGE, items, required=True).good()
    checks = repair.check_items(rows, folder.scenes, allow_unsound)
    sound = run.stage(repair.CHECK_STAGE, checks, required=True).good()
    return {scene: rows[scene] for scene in sound}


def sampled(
    run: Run,
    wording: Wording,
    config: SampleConfig,
    scenes: Mapping[str, Row],
    quotas: Mapping[str, Mapping[str, int]] | None = None,
    *,
    exact: bool = True,
) -> list[Episode]:
    """Sample paths in every scene and instruct them.

    Args:
        quotas: paths by split, by scene. Without them, every scene gives the count of
            `config`.
        exact: the quotas must be filled.
    """
    folder = run.folder
    planned = {s: row for s, row in scenes.items() if quotas is None or s in quotas}
    before = [row for summary in run.summaries for row in summary.rows]
    parts = {s: folder.episodes(f"sampled/{s}") for s in planned}

    def item(scene: str, radius_m: float) -> WorkItem:
        wider = replace(config, robot_radius_m=radius_m)
        quota = (quotas or {}).get(scene)
        folders = (folder.scenes, parts[scene])
        return episodes.sample_item(planned[scene], *folders, wider, run.seed, quota)

    items = episodes.items(run.context.ledger, planned, config.robot_radius_m, item)
    run.unselect(align.FILTER_STAGE, align.STAGE)
    earlier = run.context.ledger.rows(episodes.STAGE)
    summary = run.stage(episodes.STAGE, items, required=True)
    episodes.warn_if_fewer(earlier, summary.rows)
    if quotas is not None:
        episodes.check_complete(summary.rows, quotas, exact=exact, before=before)
    return instructed(run, wording, summary, parts)


def aligned(
    run: Run,
    wording: Wording,
    sources: Sequence[Path],
    scenes: Mapping[str, Row],
    rules: StairRules,
    config: AlignConfig,
) -> list[Episode]:
    """Filter and align the episodes of VLN-CE files; instruct those that have no words."""
    folder, ledger = run.folder, run.context.ledger
    filtered_files = {s: folder.episodes(f"filtered/{s.name.split('.')[0]}") for s in sources}
    run.unselect(episodes.STAGE)
    items = [align.filter_item(s, filtered_files[s], rules, scenes, folder.scenes) for s in sources]
    filtered = run.stage(align.FILTER_STAGE, items, required=True)
    good = filtered.good()
    files = {filtered_files[s]: good[s.name].key for s in sources if s.name in good}
    parts: dict[str, Path] = {}
    for file in files:
        for scene in scenes:
            name = align.part_name(split_name(file), scene, len(files))
            parts[name] = folder.episodes(f"aligned/{name}")
    items = align.items(files, scenes, folder.scenes, parts, config)
    summary = run.stage(align.STAGE, items)
    align.record_rejected(ledger, filtered, summary, files, scenes)
    return instructed(run, wording, summary, parts)


def instructed(
    run: Run, wording: Wording, source: StageSummary, parts: Mapping[str, Path]
) -> list[Episode]:
    """Instruct the paths that have no instruction, and join them to one file for each split.

    Args:
        source: of the stage that made the paths.
        parts: its episode files, by item.
    """
    folder, ledger, config = run.folder, run.context.ledger, wording.config
    rows = source.good()
    observer = sight.Sight(folder.scenes, folder.sights, wording.robot, config.replace)
    items = [observer.look(row, parts[s]) for s, row in rows.items()]
    seen = run.stage(sight.STAGE, items).good()
    named: dict[str, Row] = {}  # by item, of the scenes that a model was asked about
    if wording.vision is None:
        _forget_named(run, map(align.scene_of_part, seen))
    else:
        model = sight.Model(wording.vision, folder.root / CACHE_NAME)
        sources = {s: rows[s] for s in seen}
        naming = sight.named_scenes(run.stage, observer, model, sources, parts).good()
        sys.stderr.writelines(sight.naming_report(naming.values()))
        seen = {s: row for s, row in seen.items() if align.scene_of_part(s) in naming}
        named = {s: row for s in seen if sight.used_model(row := naming[align.scene_of_part(s)])}
    outs = {s: folder.episodes(f"instructed/{s}") for s in seen}
    items = [
        instruct.item(
            s,
            InstructJob(
                scenes=folder.scenes,
                episodes=parts[s],
                seen=(folder.sights.seen(s),),
                out=outs[s],
                facts=folder.facts(s),
                cache=folder.root / CACHE_NAME,
                config=config,
                seed=run.seed,
                named=(folder.sights.named(align.scene_of_part(s)),) if s in named else (),
                vision_model=wording.vision.model if wording.vision else "",
            ),
            rows[s].key,
            seen[s].key,
            *([named[s].key] if s in named else []),
        )
        for s in seen
    ]
    done = run.stage(instruct.STAGE, items)
    instruct.record_failed(ledger, done)
    paths, files = episodes.merge(
        [outs[s] for s in done.good()], folder.episodes, run.per_instruction
    )
    ledger.record(files.values())
    ledger.record_new(folder.root / CACHE_NAME)
    return paths


def _forget_named(run: Run, scenes: Iterable[str]) -> None:
    """Delete what an earlier run had named: `vlnpe review` judges texts by what is there."""
    run.unselect(sight.NAME_STAGE)
    for scene in scenes:
        run.folder.sights.named(scene).unlink(missing_ok=True)
