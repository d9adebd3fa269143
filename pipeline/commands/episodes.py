"""Commands that make episodes: `align`, `filter`, `sample`."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ...formats.core.atomic import file_digest
from ...formats.core.checkout import program
from ...formats.core.episode import Episode
from ...formats.core.errors import InputError
from ...formats.vlnce.files import read_vlnce, write_episodes
from ...formats.vlnce.groups import instruction_count
from ...trajectory_sampler.vlnce.align_config import AlignConfig
from ...trajectory_sampler.vlnce.stairs import StairRules
from ..context import open_single
from ..engine.ledger import Row
from ..engine.work import digest
from ..execution.runner import Context, StageSummary, run_stage
from ..inputs.folders import scenes_in, scenes_root
from ..inputs.sampling_plan import (
    SamplingPlan,
    chosen_free_height,
    climber_height,
    climber_radius,
    sample_config,
)
from ..options.episodes import Align, Filter, Sample
from ..options.shared import settings_of
from ..stages.episodes import align_items as align
from ..stages.episodes import sample_items as episodes
from ..stages.episodes.jobs import bad_episodes
from ..stages.scenes import items as repair
from ..summary import print_result

if TYPE_CHECKING:
    from ...collectors.robots import RobotSpec

PARTS = "parts"  # of results, beside the ledger


def run_align(options: Align) -> int:
    """Align the episodes of files; return 1 if too many are rejected."""
    out = _out(options.out, "aligned", len(options.episodes) > 1)
    robots = _robots(options.robot)
    climb_m = AlignConfig.climb_height_m
    if options.keep_climbable:
        climber_radius(robots)
        climb_m = climber_height(robots)
    config = settings_of(
        AlignConfig,
        options,
        robot_radius_m=_radius(robots, options.robot_radius_m),
        free_height_m=chosen_free_height(robots, options.free_height_m),
        climb_height_m=climb_m,
    )
    scenes = repair.rows_of(options.scenes)
    files = {read_vlnce(path).path: "" for path in options.episodes}
    files = {path: digest(path, file_digest(path)) for path in files}
    with open_single(out, options.workers) as context:
        parts = _parts(context, [
            align.part_name(read_vlnce(f).split, s, len(files)) for f in files for s in scenes
        ])  # fmt: skip
        items = align.items(files, scenes, scenes_root(options.scenes), parts, config)
        summary = run_stage(context, align.STAGE, items)
        _raise_if_nothing(summary)
        none = StageSummary(align.FILTER_STAGE)
        align.record_rejected(context.ledger, none, summary, files, scenes)
        part_files = [parts[name] for name in summary.good() if name in parts]
        paths, written = episodes.merge(part_files, _file_of(out, len(files) > 1))
    if not paths and len(files) == 1:
        write_episodes(out, [])
    bad = [[name, why] for f in files for _, name, why in bad_episodes(read_vlnce(f))]
    rejected = [
        [row.item.removeprefix("episode "), row.error["reason"]]
        for row in summary.rows
        if row.status == "quarantined"
    ]
    changed = _totals(summary, "changed")
    count = instruction_count(paths)
    if not options.json:
        sys.stdout.writelines(f"unusable {name}: {reason}\n" for name, reason in bad)
        sys.stdout.writelines(f"rejected {name}: {reason}\n" for name, reason in rejected)
        for kind, number in sorted(changed.items()):
            sys.stdout.write(f"{kind}: {number} of {len(paths)} paths\n")
    facts = {
        "out": str(out),
        "files": [str(path) for path in written.values()],
        "episodes": sum(row.facts["episodes"] for row in summary.good().values()),
        "paths": len(paths),
        "instructions": count,
        "rejected": [*bad, *rejected],
        "changed": changed,
        "robot_radius_m": config.robot_radius_m,
    }
    text = (
        f"{out}: {facts['episodes']} episodes of {len(paths)} paths aligned for a robot of radius "
        f"{config.robot_radius_m:g} m, {len(bad) + len(rejected)} rejected"
    )
    print_result(options, facts, text)
    return int(len(bad) + len(rejected) > options.max_failed)


def run_filter(options: Filter) -> int:
    """Filter the episodes of files."""
    several = len(options.episodes) > 1
    out = _out(options.out, "kept", several)
    names = tuple(name.strip() for name in options.rules.split(",") if name.strip())
    robots = _robots(options.robot)
    climber_m = climber_radius(robots) if options.keep_climbable else None
    if climber_m is None and (robots or options.free_height_m != Filter.free_height_m):
        option = "--robot names" if robots else "--free-height-m is for"
        raise InputError(f"{option} who climbs the stairs that --keep-climbable keeps")
    height_m = chosen_free_height(robots, options.free_height_m)
    rules = StairRules(names, options.combine, options.max_step_m, climber_m, height_m)
    if climber_m is not None:
        rules = replace(rules, climb_height_m=climber_height(robots))
    scenes: dict[str, Row] = {}
    if options.scenes is not None:
        scenes = repair.rows_of(options.scenes)
    with open_single(out, options.workers) as context:
        items = []
        for path in options.episodes:
            target = out / path.name if several else out.resolve()
            folder = scenes_root(options.scenes) if options.scenes else None
            items.append(align.filter_item(path, target, rules, scenes, folder))
        summary = run_stage(context, align.FILTER_STAGE, items, required=True)
    lines = []
    files = {}
    for row in summary.good().values():
        lines += align.filter_lines(row.facts)
        files[row.facts["split"]] = {k: row.facts[k] for k in ("kept", "dropped", "counts", "bad")}
    total = {key: sum(counts[key] for counts in files.values()) for key in ("kept", "dropped")}
    text = "\n".join([*lines, f"{out}: {total['kept']} kept, {total['dropped']} dropped"])
    reasons = [r for row in summary.good().values() for r in row.facts["reasons"]]
    return print_result(
        options, {"out": str(out), **total, "splits": files, "reasons": reasons}, text
    )


def run_sample(options: Sample) -> int:
    """Sample paths in one or several scenes."""
    folders = _scene_folders(options.scenes)
    scenes = repair.scene_rows(folder.resolve() for folder in folders)
    robots = _robots(options.robot)
    radius_m = _radius(robots, options.robot_radius_m)
    plan = SamplingPlan.of(options, options.preset, list(scenes))
    height_m = chosen_free_height(robots, options.free_height_m)
    strict = plan is not None
    config = sample_config(options, options.count, robots, radius_m, height_m, strict=strict)
    out = _out(options.out, "episodes", plan is not None)
    with open_single(out, options.workers) as context:
        parts = _parts(context, list(scenes))
        items = [
            episodes.sample_item(
                row,
                folder.parent.resolve(),
                parts[row.item],
                config,
                options.seed,
                plan.quotas.get(row.item) if plan else None,
            )
            for row, folder in zip(scenes.values(), folders, strict=True)
            if plan is None or row.item in plan.quotas
        ]
        summary = run_stage(context, episodes.STAGE, items, required=True)
        if plan:
            episodes.check_complete(summary.rows, plan.quotas, exact=plan.exact)
        part_files = [parts[name] for name in summary.good()]
        paths, written = episodes.merge(part_files, _file_of(out, plan is not None))
    pictures = _pictures(options.pictures, folders, paths)
    by_split = {s: sum(p.split == s for p in paths) for s in written}
    dropped = _totals(summary, "dropped")
    per_split = ", ".join(f"{count} {split}" for split, count in by_split.items())
    text = f"{out}: {len(paths)} paths in {len(part_files)} scene{'s' * (len(part_files) > 1)}"
    text += f" ({per_split})" if plan else ""
    if dropped:
        text += "; dropped candidates: "
        text += ", ".join(f"{count} {reason}" for reason, count in sorted(dropped.items()))
    if plan and plan.instructions:
        flags = f"--count {plan.instructions} --per-instruction"
        text += f"\nfor the published number of episodes: {program()} instruct … {flags}"
    facts = {
        "out": str(out),
        "files": [str(path) for path in written.values()],
        "episodes": len(paths),
        "splits": by_split,
        "scenes": {row.item: row.facts for row in summary.good().values()},
        "dropped": dropped,
        "pictures": [str(path) for path in pictures],
    }
    print_result(options, facts, text)
    return int(summary.quarantined > options.max_failed)


def _pictures(out: Path | None, scenes: Sequence[Path], paths: Sequence[Episode]) -> list[Path]:
    if out is None:
        return []
    from ...formats.scene.bundle import load_bundle
    from ...trajectory_sampler.picture import write_pictures

    out.mkdir(parents=True, exist_ok=True)
    written = []
    for scene in scenes:
        bundle = replace(load_bundle(scene), scene_id=scene.resolve().name)
        here = [path for path in paths if path.scene_id == bundle.scene_id]
        written += write_pictures(out, bundle, here)
    return written


def _scene_folders(given: Sequence[Path]) -> list[Path]:
    if not given:
        raise InputError("no scene; valid: folders of repaired scenes")
    return [scene for folder in given for scene in scenes_in(folder).values()]


def _robots(names: str) -> list[RobotSpec]:
    if not names:
        return []
    from ..inputs.crews import chosen_robots

    return chosen_robots(names)


def _radius(robots: Sequence[RobotSpec], radius_m: float) -> float:
    return max((robot.footprint_radius_m for robot in robots), default=radius_m)


def _out(given: Path | None, name: str, folder: bool) -> Path:
    """Return the output: a folder for several files, else one file."""
    out = given or Path(name if folder else f"{name}.json.gz")
    is_file = out.name.endswith((".json", ".json.gz"))
    if folder and is_file:
        raise InputError(f"--out {out}: several files are written; valid: a folder")
    if not folder and out.is_dir():
        raise InputError(f"--out {out}: is a folder; valid: a file (.json or .json.gz)")
    if folder:
        out.mkdir(parents=True, exist_ok=True)
    return out.resolve()


def _file_of(out: Path, folder: bool):
    """Return the function from a split to its file: in the folder `out`, or `out` itself."""
    return (lambda split: out / f"{split}.json.gz") if folder else (lambda split: out)


def _parts(context: Context, names: Sequence[str]) -> dict[str, Path]:
    folder = context.ledger.root / PARTS
    return {name: folder / f"{name}.json.gz" for name in names}


def _totals(summary: StageSummary, fact: str) -> dict[str, int]:
    """Return the sums of a fact that counts by name, over all items."""
    totals: Counter[str] = Counter()
    for row in summary.good().values():
        totals.update(row.facts[fact])
    return dict(totals)


def _raise_if_nothing(summary: StageSummary) -> None:
    errors = [row.error["reason"] for row in summary.rows if row.status == "quarantined"]
    if errors and not summary.good():
        raise InputError(errors[0])
