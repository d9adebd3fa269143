"""`vlnpe collect`: run the whole pipeline, reusing finished work."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from ...collectors.robots import RobotSpec
from ...formats.core.errors import InputError, check_name, did_you_mean
from ...formats.trainers.registry import LAYOUTS
from ...formats.video.codecs import check_rgb_codec
from ...formats.vlnce.files import read_vlnce
from ...rendering.camera.extras import Extras
from ...rendering.camera.views import CameraOverrides
from ...scene_repair.scan.files import SUFFIXES
from ...trajectory_sampler.config import CROSS_SHARE, NO, SampleConfig
from ...trajectory_sampler.presets import PRESETS, get_preset
from ...trajectory_sampler.vlnce.align_config import AlignConfig
from ...trajectory_sampler.vlnce.stairs import StairRules
from ..context import open_context
from ..engine.ledger import Ledger
from ..engine.run_folder import RunFolder, safe_name
from ..inputs.builtin import BuiltIn, no_scene, parse_builtin
from ..inputs.crews import action_timing, chosen_robots, crews, keep_crews
from ..inputs.folders import find_scans
from ..inputs.robot_copies import robot_of_run
from ..inputs.sampling_plan import (
    SamplingPlan,
    chosen_free_height,
    climber_height,
    climber_radius,
    sample_config,
)
from ..inputs.views import check_frame_rate, chosen_views
from ..inputs.wording import instruct_config, vision_settings
from ..options.collect import Collect
from ..report import items as report
from ..stages.datasets.export_items import check_depth_storage
from ..stages.episodes import align_items as align
from ..stages.instructions import sight_items as sight
from ..stages.scenes import items as repair
from ..summary import print_stages, show_summary
from . import episode_chain as episodes
from . import rollout_chain as rollouts
from .rollout_chain import Product, collect, select_current
from .run import Run


def run(options: Collect) -> int:
    """Run the pipeline and return the exit code."""
    robots = chosen_robots(options.robot)
    pairs = crews(robots, options.controller)
    actions = action_timing(options.action_steps, options.closed_loop)
    extras = Extras(options.semantic, options.instance)
    product = Product(
        options.frames_per_second,
        extras,
        options.only_success,
        options.rgb_codec,
        options.depth,
        options.mcap,
        _also(options.also),
        options.language_columns,
    )
    drawing = (options.camera, options.light, options.renderer)
    overrides = CameraOverrides(height_m=options.camera_height, pitch_down_deg=options.camera_pitch)
    views = {r.name: chosen_views(*drawing, r, overrides) for r in robots}
    check_frame_rate(options.frames_per_second)
    check_rgb_codec(options.rgb_codec)
    check_depth_storage(options.depth)
    episode_files, preset, count = _episodes(options.episodes)
    instructing, vision = instruct_config(options), vision_settings(options)
    sources = sources_of(options, episode_files, preset)
    if episode_files and options.storeys != NO:
        raise InputError(
            f"--storeys {options.storeys} samples paths, and --episodes {options.episodes} has "
            "its own; valid with files: no"
        )
    plan = None if episode_files else SamplingPlan.of(options, preset, list(sources))
    height_m = chosen_free_height(robots, options.free_height_m)
    sampling = sample_config(
        options, count, robots, options.robot_radius_m, height_m, strict=plan is not None
    )
    if plan and plan.instructions and options.count == Collect.count:
        instructing = replace(instructing, count=plan.instructions)
    if options.keep_climbable and not episode_files:
        raise InputError("--keep-climbable keeps episodes of a file; to sample some: --storeys")
    climber_m = climber_radius(robots) if options.keep_climbable else None
    names = tuple(name.strip() for name in options.stair_rules.split(","))
    rules = StairRules(names, climber_radius_m=climber_m, free_height_m=height_m)
    collision = str(options.collision.resolve()) if options.collision else ""
    repairing = options.repair_config(collision=collision)
    with open_context(
        options.out or Path("runs") / _run_name(options, sources), options
    ) as context:
        if not (episode_files or options.only_episodes):
            context.workers.expect(count * len(sources), rollouts.MODULES)
        folder = RunFolder(context.ledger.root)
        pairs = keep_crews(pairs, context.ledger)
        widest, _ = max(pairs, key=lambda crew: crew[0].footprint_radius_m)
        eye = _eye(context.ledger) or widest
        current = Run(
            folder, context, options.seed, options.state, actions, options.per_instruction
        )
        wording = episodes.Wording(instructing, eye, vision)
        scenes = episodes.repaired(current, sources, repairing, options.allow_unsound)
        sampling = _widened(sampling, robots, context.ledger)
        if options.keep_climbable:
            climb_m = _tallest(climber_height(robots), context.ledger, align.STAGE)
            rules = replace(rules, climb_height_m=climb_m)
        else:
            climb_m = AlignConfig.climb_height_m
        fitting = AlignConfig(
            robot_radius_m=_fitting_radius(robots, context.ledger),
            free_height_m=height_m,
            climb_height_m=climb_m,
            goal_beyond_start=options.goal_beyond_start,
            keep_climbable=options.keep_climbable,
        )
        if episode_files:
            paths = episodes.aligned(current, wording, episode_files, scenes, rules, fitting)
        else:
            quotas, exact = (plan.quotas, plan.exact) if plan else (None, True)
            paths = episodes.sampled(current, wording, sampling, scenes, quotas, exact=exact)
        if options.only_episodes:
            text = f"episodes: {folder.root / 'episodes'}"
            return print_stages(options, current.summaries, text, out=str(folder.root))
        select_current(current, paths, scenes, pairs)
        for robot, controller in pairs:
            collect(
                current,
                paths,
                scenes,
                (robot, controller),
                views[robot.name],
                product,
                {
                    "robot": robot.name,
                    "controller": controller,
                    **({"actions": asdict(actions)} if controller == "speed" else {}),
                    "seed": options.seed,
                    "instructions": asdict(instructing),
                    "scene": Path(options.scenes or options.scene).name,
                    "episodes": ",".join(Path(part).name for part in options.episodes.split(",")),
                    "sampling": asdict(sampling),
                    **({"splits": asdict(plan)} if plan else {}),
                    **(
                        {"stair_rules": asdict(rules), "alignment": asdict(fitting)}
                        if episode_files
                        else {}
                    ),
                    "per_instruction": options.per_instruction,
                    "frames_per_second": options.frames_per_second,
                    "only_success": options.only_success,
                    "rgb_codec": options.rgb_codec,
                    "depth": options.depth,
                },
            )
        page = report.write(folder, context, current.summaries)
    return show_summary(folder, current.summaries, page, options)


def _also(text: str) -> tuple[str, ...]:
    """Return the layouts of `--also navila,streamvln`; raise UnknownNameError for another name."""
    names = tuple(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))
    for name in names:
        check_name("layout", name, LAYOUTS)
    return names


def _eye(ledger: Ledger) -> RobotSpec | None:
    """Return the robot whose camera an earlier run of this folder looked with, if any.

    Robots that join later walk the same episodes with the same instructions.
    """
    names = (str(row.facts["robot"]) for row in ledger.done(sight.STAGE) if "robot" in row.facts)
    return next((robot_of_run(Path(name).name, ledger.root) for name in names), None)


def _widened(sampling: SampleConfig, robots: Sequence[RobotSpec], ledger: Ledger) -> SampleConfig:
    """Return what suits the widest robot, and the tallest climber, of this and of earlier runs.

    Episodes that fit a wide robot also fit the others, so the episodes of a run folder change only
    when a wider robot, or over stairs a taller one, is added, and all robots of one folder walk the
    same episodes.
    """
    # Rows written by another version may lack this fact, and quarantined rows always do.
    before = [row.facts.get("robot_radius_m", 0.0) for row in ledger.rows("sample")]
    widest_m = max(robot.footprint_radius_m for robot in robots)
    if CROSS_SHARE[sampling.storeys]:
        climb_m = _tallest(sampling.climb_height_m, ledger, "sample")
        sampling = replace(sampling, climb_height_m=climb_m)
    return replace(sampling, robot_radius_m=max(sampling.robot_radius_m, widest_m, *before))


def _tallest(climb_height_m: float, ledger: Ledger, stage: str) -> float:
    """Return the free height above treads [m] for this run's climbers and earlier runs' ones."""
    before = [row.facts.get("climb_height_m", 0.0) for row in ledger.rows(stage)]
    return max([climb_height_m, *before])


def _fitting_radius(robots: Sequence[RobotSpec], ledger: Ledger) -> float:
    """Return the footprint of the widest robot of this run and of earlier runs of the folder."""
    before = [row.facts.get("robot_radius_m", 0.0) for row in ledger.rows(align.STAGE)]
    return max([*before, *(robot.footprint_radius_m for robot in robots)])


def sources_of(
    options: Collect, episode_files: Sequence[Path], preset: str
) -> Mapping[str, Path | BuiltIn]:
    """Return the scan, or the building to generate, of each scene id."""
    if options.scenes is None:
        if built := parse_builtin(options.scene, options.seed):
            if preset and len(built) == 1 and "*" not in options.scene:
                built = built[0].and_next(get_preset(preset).scenes)
            return {building.name: building for building in built}
        source = Path(options.scene)
        if not source.exists():
            raise no_scene(options.scene, SUFFIXES)
        repair.check_scan(source)
        return {safe_name(source.stem): source}
    scans = find_scans(options.scenes)
    if episode_files:
        named = {e.scene_stem for file in episode_files for e in read_vlnce(file).episodes}
        scans = {name: path for name, path in scans.items() if name in named}
    if not scans:
        what = "none of the episodes' scans" if episode_files else "no scan"
        raise InputError(f"--scenes {options.scenes}: contains {what}; valid: {' '.join(SUFFIXES)}")
    return scans


def _episodes(text: str) -> tuple[list[Path], str, int]:
    """Return what `--episodes <text>` means: VLN-CE files, a preset, or a number per scene."""
    if text.isdecimal() and int(text) > 0:
        return [], "", int(text)
    if text in PRESETS:
        return [], text, 1
    files = [Path(part.strip()) for part in text.split(",")]
    if all(file.is_file() for file in files):
        splits = [read_vlnce(file).split for file in files]
        if len(set(splits)) < len(splits):
            raise InputError(
                f"--episodes {text}: two files have the same split; valid: one per split"
            )
        return files, "", 1
    missing = [str(file) for file in files if ".json" in file.suffixes and not file.is_file()]
    what = f"no such file: {', '.join(missing)}; " if missing else ""
    raise InputError(
        f"--episodes {text}{did_you_mean(text, PRESETS)}: {what}valid: a number above 0, "
        f"{', '.join(PRESETS)}, or existing VLN-CE files, one per split"
    )


def _run_name(options: Collect, sources: Mapping[str, Path | BuiltIn]) -> str:
    if options.scenes is not None:
        return safe_name(options.scenes.resolve().name)
    first, *others = sources
    if not others:
        return first
    kind, last = others[-1].rsplit("-", 1)
    # villa-0-to-9, or apartment-0-to-villa-9.
    return f"{first}-to-{last if first.startswith(f'{kind}-') else others[-1]}"
