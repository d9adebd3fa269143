"""Commands for the later stages: `replay`, `render`, `export`."""

import logging
from collections.abc import Sequence

from ...collectors.replay.suits import check_suits
from ...formats.core.errors import FileFormatError, check_name
from ...formats.core.flags import FlagFile
from ...formats.video.codecs import check_rgb_codec
from ...formats.vlnce.groups import group_by_path
from ...rendering.camera.extras import Extras
from ...rendering.camera.views import CameraOverrides
from ...rendering.registry import chosen_renderer
from ..context import open_context
from ..engine.ledger import Ledger, Row
from ..execution.runner import StageSummary, run_stage
from ..inputs.crews import action_timing, chosen_robots, crews, keep_crews
from ..inputs.episode_file import episodes_of, scenes_of
from ..inputs.robot_copies import robot_of_run
from ..inputs.views import check_frame_rate, chosen_lights, chosen_views
from ..options.rollouts import Export, Render, Replay
from ..report.gather import robot_rows
from ..stages.datasets import export_items as export
from ..stages.rollouts import render_items as render
from ..stages.rollouts import replay_items as replay
from ..stages.scenes import items as repair
from ..summary import print_stages, robot_table

log = logging.getLogger(__name__)
FRAME_RATE, VIDEO_RATE = 4, 25  # default frames per second


def run_replay(options: Replay) -> int:
    """Replay the episodes of one file."""
    pairs = crews(chosen_robots(options.robot), options.controller)
    actions = action_timing(options.action_steps, options.closed_loop)
    episodes, scenes_folder = episodes_of(options.episodes, options.scenes, None)
    paths = group_by_path(episodes)
    for robot, _ in pairs:
        check_suits(robot, paths)
    scenes = repair.rows_of(scenes_folder)
    repair.demand({e.scene_id for e in paths}, scenes, scenes_folder)
    summaries = []
    with open_context(options.out, options) as context:
        root = context.ledger.root
        for crew in keep_crews(pairs, context.ledger):
            walker = replay.walker(*crew, options.seed, actions, options.state)
            label = replay.label_of(context.ledger, walker.config)
            items = replay.items(
                paths, scenes, scenes_folder.resolve(), root, root / "models", walker, label
            )
            summaries.append(run_stage(context, replay.STAGE, items, f"{crew[0].name}/{label}/"))
        context.ledger.record_new(root / "models")
    return _print_summary(options, summaries)


def run_render(options: Render) -> int:
    """Render all rollouts in a folder."""
    chosen_lights(options.light)
    rate = options.frames_per_second or (VIDEO_RATE if options.video else FRAME_RATE)
    check_frame_rate(rate)
    check_rgb_codec(options.rgb_codec)
    chosen_renderer(options.renderer)
    source = Ledger.existing(options.rollouts)
    scenes_folder = scenes_of(options.rollouts, options.scenes)
    scenes = repair.rows_of(scenes_folder)
    groups: dict[tuple[str, str], dict[str, Row]] = {}
    walks = source.done(replay.STAGE)
    if options.episode is not None and walks:
        check_name("episode", options.episode, sorted({_episode_of(row) for row in walks}))
        walks = [row for row in walks if _episode_of(row) == options.episode]
    for row in walks:
        robot, controller, _ = row.item.split("/", 2)
        groups.setdefault((robot, controller), {})[row.item] = row
    overrides = CameraOverrides(
        width_px=options.width_px,
        height_px=options.height_px,
        hfov_deg=options.hfov_deg,
        height_m=options.camera_height,
        pitch_down_deg=options.camera_pitch,
    )
    robots = {robot: robot_of_run(robot, source.root) for robot, _ in groups}
    views = {
        name: chosen_views(options.camera, options.light, options.renderer, robot, overrides)
        for name, robot in robots.items()
    }
    if not groups:
        raise FileFormatError(options.rollouts, "contains no rollout")
    walked = {str(row.facts["scene"]) for rows in groups.values() for row in rows.values()}
    repair.demand(walked, scenes, scenes_folder)
    extras = Extras(options.semantic, options.instance, options.depth_mm)
    root, folder = source.root.resolve(), scenes_folder.resolve()
    summaries = []
    with open_context(options.out, options) as context:
        out = context.ledger.root
        for (robot, controller), rows in groups.items():
            recorded = render.Recorded(robots[robot], rows, root, scenes, folder)
            for view in views[robot]:
                scope = f"{robot}/{controller}/{view.name}/"
                if options.video:
                    items = render.video_items(recorded, view, rate, out)
                    summaries.append(run_stage(context, render.VIDEO_STAGE, items, scope))
                    continue
                items = render.items(
                    recorded, view, rate, out, out, rgb_codec=options.rgb_codec, extras=extras
                )
                summaries.append(run_stage(context, render.STAGE, items, scope))
    return _print_summary(options, summaries)


def _episode_of(row: Row) -> str:
    return row.item.split("/", 2)[2]


def run_export(options: Export) -> int:
    """Export all rendered rollouts in a folder."""
    export.check_depth_storage(options.depth)
    source = Ledger.existing(options.frames)
    root, folder = source.root.resolve(), scenes_of(options.frames, options.scenes).resolve()
    groups: dict[tuple[str, ...], dict[str, Row]] = {}
    for row in source.done(render.STAGE):
        groups.setdefault(tuple(row.item.split("/")[:3]), {})[row.item] = row
    if not groups:
        raise FileFormatError(options.frames, "contains no rendered episode")
    flagged = FlagFile(root).flagged() if options.without_flagged else {}
    if options.without_flagged and not flagged:
        log.warning("%s: no walk of it is flagged; flags of another folder do not count", root)
    groups = {
        group: export.rows_to_export(rows, options.only_success, flagged)
        for group, rows in groups.items()
    }
    if not any(groups.values()):
        which = "rendered episode that is not flagged" if flagged else "successful rendered episode"
        raise FileFormatError(options.frames, f"contains no {which}")
    summaries = []
    with open_context(options.out, options) as context:
        for (robot, controller, view), rows in groups.items():
            dataset = export.Dataset.under(context.ledger.root, robot, controller, view)
            items = export.items(
                rows,
                root,
                folder,
                dataset,
                robot_of_run(robot, root),
                depth_storage=options.depth,
                per_instruction=options.per_instruction,
            )
            summaries += export.run(context, items, folder, dataset, {}, options.language_columns)
    return _print_summary(options, summaries)


def _print_summary(options: Replay | Render | Export, summaries: Sequence[StageSummary]) -> int:
    text = f"written to {options.out}"
    if isinstance(options, Replay) and not options.json:
        text = f"{robot_table(robot_rows(Ledger.existing(options.out)))}\n\n{text}"
    return print_stages(options, summaries, text)
