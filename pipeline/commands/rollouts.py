"""Commands for the later stages: `replay`, `render`, `export`."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ...collectors.controllers import SpeedConfig
from ...collectors.rendering.camera.extras import Extras
from ...collectors.rendering.camera.views import CameraOverrides
from ...collectors.rendering.registry import chosen_renderer
from ...formats.core.errors import FileFormatError, InputError
from ...formats.video.mp4 import check_rgb_codec
from ...formats.vlnce.files import read_episodes
from ..crews import AUTO, action_timing, chosen_robots, crews
from ..engine.keys import digest
from ..engine.ledger import Ledger, Row
from ..engine.runner import StageSummary, run_stage
from ..kept_robots import keep, kept
from ..report.gather import robot_rows
from ..stages import export, render, repair, replay
from ..summary import joined, robot_table, stage_table
from ..views import chosen_lights, chosen_views
from .chain import scenes_in
from .collect import check_frame_rate, opened

FRAME_RATE, VIDEO_RATE = 4, 25  # default frames per second

Json = Annotated[bool, tyro.conf.arg(name="json")]


@dataclass(frozen=True)
class Replay:
    """Execute episodes with a physically simulated robot; records states, no images."""

    episodes: tyro.conf.Positional[Path]
    """Episode file written by `instruct`, `sample` or `align`."""
    scenes: Path
    """Folder of repaired scenes."""
    out: Path = Path("rollouts")
    """Output folder; rollouts are written to <robot>/<controller>/<episode>.mcap in it."""
    robot: str = "aliengo"
    """Robots to run: a name (see `vlnpe robots`), the folder of your own robot, a comma-separated
    list (h1,g1), or `all` for every built-in robot with a body."""
    controller: str = AUTO
    """Controllers to run: path, speed or flash, a comma-separated list (path,speed), or `all`.
    `auto` selects path, or flash for an agent without a body."""
    action_steps: int = SpeedConfig.steps_per_action
    """Duration of a discrete action of the speed controller, in physics steps of 5 ms."""
    closed_loop: bool = False
    """Run each discrete action of the speed controller until its 0.25 m or 15° is reached, instead
    of for a fixed number of steps."""
    seed: int = 0
    """Random seed."""
    workers: int = 0
    """Number of worker processes; 0 uses one per core."""
    max_failed: int = 0
    """Maximum number of quarantined episodes; exit with code 1 above it."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


@dataclass(frozen=True)
class Render:
    """Render rollouts: RGB and depth from any camera, or preview videos."""

    rollouts: tyro.conf.Positional[Path]
    """Folder written by `replay`."""
    scenes: Path
    """Folder of repaired scenes."""
    out: Path = Path("frames")
    """Output folder; frames are written to <robot>/<controller>/<view>/<episode>/ in it."""
    camera: str = "ego"
    """Cameras: ego (the robot's own camera), chase, top, or a comma-separated list (ego,chase),
    each with an optional size and field of view (ego:640x480:79)."""
    width_px: int | None = None
    """Image width [px]; defaults to the camera's own."""
    height_px: int | None = None
    """Image height [px]; defaults to the camera's own."""
    hfov_deg: float | None = None
    """Horizontal field of view [deg]; defaults to the camera's own."""
    light: str = "baked"
    """Lighting: baked (as scanned), DL5000 (panel lights, day), DL300 (night), CL (a lamp on the
    robot), a comma-separated list (DL5000,CL), or `all`."""
    renderer: str = "auto"
    """Renderer: embree (ray tracing on the CPU), gl (MuJoCo through EGL), or auto, which selects gl
    if a GPU is available and embree otherwise."""
    frames_per_second: int | None = None
    """Rendered frames per second: 4, 5, 10, 20, 25 or 50. Defaults to 4, or to 25 with --video."""
    semantic: bool = False
    """Also render semantic segmentation: semantic.mov, and labels.json with the class names."""
    instance: bool = False
    """Also render instance segmentation: instance.mov, and labels.json with the object names."""
    depth_mm: bool = False
    """Also write depth in whole millimetres: depth_mm.mov (16-bit PNG frames)."""
    video: bool = False
    """Write one preview video (.mp4) per episode instead of data."""
    rgb_codec: str = "h264"
    """Codec of RGB videos: h264, or av1 (royalty-free)."""
    workers: int = 0
    """Number of worker processes; 0 uses one per core."""
    max_failed: int = 0
    """Maximum number of quarantined episodes; exit with code 1 above it."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


@dataclass(frozen=True)
class Export:
    """Export rendered rollouts as LeRobot v3 datasets and as MCAP files."""

    frames: tyro.conf.Positional[Path]
    """Folder written by `render`."""
    scenes: Path
    """Folder of repaired scenes."""
    out: Path = Path("data")
    """Output folder; datasets are written to lerobot/<dataset>/ and mcap/<dataset>/ in it."""
    only_success: bool = False
    """Export only successful episodes. By default all are exported, each with its end reason."""
    depth: str = "video"
    """Depth storage in LeRobot datasets: video (lossless, 12-bit codes) or image (16-bit, mm)."""
    workers: int = 0
    """Number of worker processes; 0 uses one per core."""
    max_failed: int = 0
    """Maximum number of quarantined episodes; exit with code 1 above it."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


def run_replay(options: Replay) -> int:
    """Replay the episodes of one file.

    Raises:
        InputError: If a robot or controller is unknown, or a file or folder cannot be used.
    """
    robots = chosen_robots(options.robot)
    pairs = crews(robots, options.controller)
    actions = action_timing(options.action_steps, options.closed_loop)
    asked = read_episodes(options.episodes)
    scenes = _scene_rows(options.scenes)
    _demand_scenes({e.scene_id for e in asked}, scenes, options.scenes)
    summaries = []
    with opened(options.out, options.workers) as context:
        root = context.ledger.root
        found_by = {robot.name: keep(robot, root) for robot in robots}
        for robot, controller in pairs:
            config = replay.config(found_by[robot], controller, options.seed, actions)
            items = replay.items(
                asked, scenes, options.scenes.resolve(), root, root / "models", config
            )
            summaries.append(run_stage(context, replay.STAGE, items, f"{robot}/{controller}/"))
    return _tell(options, summaries)


def run_render(options: Render) -> int:
    """Render all rollouts in a folder.

    Raises:
        InputError: If a camera, light, renderer or codec is unknown, or a folder cannot be used.
    """
    chosen_lights(options.light)
    rate = options.frames_per_second or (VIDEO_RATE if options.video else FRAME_RATE)
    check_frame_rate(rate)
    check_rgb_codec(options.rgb_codec)
    chosen_renderer(options.renderer)
    source = Ledger.existing(options.rollouts)
    scenes = _scene_rows(options.scenes)
    groups: dict[tuple[str, str], dict[str, Row]] = {}
    for row in source.rows(replay.STAGE):
        if row.status == "done":
            robot, controller, _ = row.item.split("/", 2)
            groups.setdefault((robot, controller), {})[row.item] = row
    wishes = CameraOverrides(
        width_px=options.width_px, height_px=options.height_px, hfov_deg=options.hfov_deg
    )
    views = {
        robot: chosen_views(
            options.camera, options.light, options.renderer, kept(robot, source.root), wishes
        )
        for robot, _ in groups
    }
    if not groups:
        raise FileFormatError(options.rollouts, "contains no rollout")
    walked = {str(row.facts["scene"]) for rows in groups.values() for row in rows.values()}
    _demand_scenes(walked, scenes, options.scenes)
    extras = Extras(options.semantic, options.instance, options.depth_mm)
    root, folder = source.root.resolve(), options.scenes.resolve()
    summaries = []
    with opened(options.out, options.workers) as context:
        out = context.ledger.root
        for (robot, controller), rows in groups.items():
            for view in views[robot]:
                scope = f"{robot}/{controller}/{view.name}/"
                if options.video:
                    items = render.video_items(rows, scenes, root, folder, out, view, rate)
                    summaries.append(run_stage(context, render.VIDEO_STAGE, items, scope))
                    continue
                how = (view, rate, options.rgb_codec, extras)
                items = render.items(rows, scenes, root, folder, out, out, *how)
                summaries.append(run_stage(context, render.STAGE, items, scope))
    return _tell(options, summaries)


def run_export(options: Export) -> int:
    """Export all rendered rollouts in a folder.

    Raises:
        InputError: If a folder cannot be used, or the depth storage is unknown.
    """
    export.check_depth_storage(options.depth)
    source = Ledger.existing(options.frames)
    root, folder = source.root.resolve(), options.scenes.resolve()
    groups: dict[tuple[str, ...], dict[str, Row]] = {}
    for row in source.rows(render.STAGE):
        if row.status == "done":
            groups.setdefault(tuple(row.item.split("/")[:3]), {})[row.item] = row
    if not groups:
        raise FileFormatError(options.frames, "contains no rendered episode")
    groups = {group: export.wanted(rows, options.only_success) for group, rows in groups.items()}
    if not any(groups.values()):
        raise FileFormatError(options.frames, "contains no successful rendered episode")
    summaries = []
    with opened(options.out, options.workers) as context:
        for (robot, controller, view), rows in groups.items():
            dataset = export.Dataset.under(context.ledger.root, robot, controller, view)
            scope = f"{robot}/{controller}/{view}/"
            summaries += export.run(context, rows, root, folder, dataset, scope, {}, options.depth)
    return _tell(options, summaries)


def _demand_scenes(names: Iterable[str], scenes: Mapping[str, Row], folder: Path) -> None:
    missing = sorted(set(names) - scenes.keys())
    if missing:
        raise InputError(f"{folder}: contains no repaired scene {', '.join(missing)}")


def _scene_rows(folder: Path) -> dict[str, Row]:
    """Return a ledger row for every scene in a folder, as if the repair stage had written it.

    The key hashes the scene's index file, which the repair writes last and never modifies.
    """
    return {
        name: Row(repair.STAGE, name, digest(path, (path / "scene.json").read_text()), "done")
        for name, path in scenes_in(folder.resolve()).items()
    }


def _tell(options: Replay | Render | Export, summaries: Sequence[StageSummary]) -> int:
    quarantined = sum(s.quarantined for s in summaries)
    if options.json:
        value = {
            "out": str(options.out),
            "stages": {s.stage: s.counts() for s in joined(summaries)},
            "exit_code": int(quarantined > options.max_failed),
        }
        sys.stdout.write(json.dumps(value) + "\n")
    else:
        sys.stdout.write(f"\n{stage_table(summaries)}\n\n")
        if isinstance(options, Replay):
            rows = robot_rows(Ledger.existing(options.out))
            sys.stdout.write(f"{robot_table(rows)}\n\n")
        sys.stdout.write(f"written to {options.out}\n")
    return int(quarantined > options.max_failed)
