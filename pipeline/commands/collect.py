"""`vlnpe collect`: run the whole pipeline, reusing finished work."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from ...collectors.controllers import SpeedConfig
from ...collectors.rendering.camera.extras import Extras
from ...collectors.rendering.camera.views import CameraOverrides
from ...collectors.robots import RobotSpec
from ...formats.core.atomic import sweep
from ...formats.core.errors import InputError
from ...formats.core.rollout import STATE_RATE_HZ
from ...formats.video.mp4 import check_rgb_codec
from ...formats.vlnce.files import read_vlnce
from ...instruction_gen.llm.settings import settings_from
from ...instruction_gen.records import (
    LLM,
    LOCAL,
    MIXED,
    InstructConfig,
    parse_languages,
    parse_styles,
)
from ...scene_repair.config import RepairConfig
from ...scene_repair.scan.files import SUFFIXES
from ...trajectory_sampler.config import SampleConfig
from ..builtin import BUILTIN, BuiltIn, parse_builtin
from ..chain import Chain, Product
from ..crews import AUTO, action_timing, chosen_robots, crews
from ..engine.executors import Workers, available_cores
from ..engine.ledger import JOURNAL_NAME, MANIFEST_NAME, QUARANTINE_NAME, Ledger
from ..engine.run_folder import RunFolder, open_run_folder, safe_name
from ..engine.runner import Context
from ..kept_robots import keep, kept
from ..scan_files import find_scans
from ..stages import repair, report, visibility
from ..stages.export import check_depth_storage
from ..summary import show_summary
from ..views import chosen_views

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Collect:
    """Collect a dataset: repair, sample, instruct, replay, render, export, report.

    All outputs go into one run folder. Finished work is reused, and changing an option redoes only
    the work that depends on it.
    """

    robot: str = "aliengo"
    """Robots to run: a name (see `vlnpe robots`), the folder of your own robot, a comma-separated
    list (h1,g1), or `all` for every built-in robot with a body. All robots get the same episodes,
    sampled with clearance for the widest one."""
    controller: str = AUTO
    """Controllers to run: path, speed or flash, a comma-separated list (path,speed), or `all`.
    `auto` selects path, or flash for an agent without a body."""
    action_steps: int = SpeedConfig.steps_per_action
    """Duration of a discrete action of the speed controller, in physics steps of 5 ms."""
    closed_loop: bool = False
    """Run each discrete action of the speed controller until its 0.25 m or 15° is reached, instead
    of for a fixed number of steps."""
    scene: str = BUILTIN
    """Scan to collect in (GLB, glTF, OBJ, PLY, STL, USD or a point cloud; see docs/scans.md), or
    `builtin` for a generated apartment; builtin:villa, builtin:house and builtin:office are larger
    buildings, and builtin:villa*10 is ten of them, of consecutive seeds."""
    scenes: Path | None = None
    """Folder of scans. All of them are used, or only those named by the scene ids of the VLN-CE
    file in --episodes."""
    episodes: str = "6"
    """Number of episodes to sample per scene, or a VLN-CE episode file (.json.gz)."""
    min_length_m: float = SampleConfig.min_length_m
    """Minimum geodesic distance from start to goal of sampled episodes [m]; lower it for a
    single-room scan."""
    min_crossings: int = SampleConfig.min_crossings
    """Minimum number of room-to-room transitions per sampled path; use 0 for a single-room scan."""
    camera: str = "ego"
    """Cameras to render: ego, chase, top, or a comma-separated list (ego,chase), each with an
    optional size and field of view (ego:640x480:79). Each camera becomes a separate dataset."""
    light: str = "baked"
    """Lighting: baked (as scanned), DL5000 (panel lights, day), DL300 (night), CL (a lamp on the
    robot), a comma-separated list (DL5000,CL), or `all`. Each becomes a separate dataset."""
    renderer: str = "auto"
    """Renderer: embree (ray tracing on the CPU), gl (MuJoCo through EGL), or auto, which selects gl
    if a GPU is available and embree otherwise."""
    writer: str = InstructConfig.writer
    """Writer of the instructions: composer (offline), llm (any OpenAI-compatible server, see
    docs/instructions.md), or local (a GGUF model on disk)."""
    style: str = MIXED
    """Styles of the instructions: natural, terse, rich, a comma-separated list (terse,rich), or
    mixed, which takes all in turn."""
    count: int = InstructConfig.count
    """Number of instructions per path and language."""
    language: str = "en"
    """Languages of the instructions: en, zh, hi, or a comma-separated list (en,zh). Languages other
    than en need a language model."""
    replace: bool = False
    """Also rewrite instructions that a VLN-CE file already has."""
    max_tokens: int = 0
    """Stop querying the language model after this many tokens; 0 means no limit."""
    max_cost: float = 0.0
    """Stop querying after this cost, at the prices set in the environment; 0 means no limit."""
    up: str = "auto"
    """Up axis of the scans: x, y, z, -x, -y, -z, or auto to detect it."""
    unit: str = "auto"
    """Length unit of the scans: m, cm, mm, in, ft, or auto to detect it."""
    allow_unsound: bool = False
    """Also collect in scenes whose repair is not sound, instead of quarantining them. The report
    and the dataset card list them."""
    out: Path | None = None
    """Run folder; defaults to `runs/<scene>`."""
    seed: int = 0
    """Random seed of the built-in scene (the first of several), the sampling and every other random
    choice."""
    semantic: bool = False
    """Also render semantic segmentation (semantic.mov, and in MCAP)."""
    instance: bool = False
    """Also render instance segmentation (instance.mov, and in MCAP)."""
    frames_per_second: int = 4
    """Rendered frames per second: 4, 5, 10, 20, 25 or 50."""
    only_success: bool = False
    """Export only successful episodes. By default all are exported, each with its end reason."""
    rgb_codec: str = "h264"
    """Codec of RGB videos: h264, or av1 (royalty-free)."""
    depth: str = "video"
    """Depth storage in LeRobot datasets: video (lossless, 12-bit codes) or image (16-bit, mm)."""
    workers: int = 0
    """Number of worker processes; 0 uses one per core."""
    max_failed: int = 0
    """Maximum number of quarantined items; exit with code 1 above it."""
    json: Annotated[bool, tyro.conf.arg(name="json")] = False
    """Print one JSON object with the summary as the last line."""


def run(options: Collect) -> int:
    """Run the pipeline and return the exit code.

    Raises:
        InputError: If an option is invalid; checked before anything is written.
    """
    robots = chosen_robots(options.robot)
    pairs = crews(robots, options.controller)
    actions = action_timing(options.action_steps, options.closed_loop)
    extras = Extras(options.semantic, options.instance)
    product = Product(
        options.frames_per_second, extras, options.only_success, options.rgb_codec, options.depth
    )
    looks = (options.camera, options.light, options.renderer)
    views = {r.name: chosen_views(*looks, r, CameraOverrides()) for r in robots}
    check_frame_rate(options.frames_per_second)
    check_rgb_codec(options.rgb_codec)
    check_depth_storage(options.depth)
    count, episode_file = _episodes(options.episodes)
    sampling = _sampling(options, count)
    instructing = instruct_config(options)
    sources = _sources(options, episode_file)
    repairing = RepairConfig(up=options.up, unit=options.unit)
    with opened(
        options.out or Path("runs") / _run_name(options, sources), options.workers
    ) as context:
        folder = RunFolder(context.ledger.root)
        for robot in robots:
            keep(robot, folder.root)
        widest = max(robots, key=lambda robot: robot.footprint_radius_m)
        eye = _eye(context.ledger) or kept(widest.name, folder.root)
        chain = Chain(folder, context, options.seed, actions, instructing, eye)
        scenes = chain.scenes(sources, repairing, options.allow_unsound)
        if episode_file:
            asked = chain.aligned(episode_file, scenes)
        else:
            sampling = _roomy(sampling, robots, context.ledger)
            asked = chain.sampled(sampling, scenes)
        chain.keep(asked, scenes, pairs)
        for robot, controller in pairs:
            chain.collected(
                asked,
                scenes,
                robot,
                controller,
                views[robot],
                product,
                {
                    "robot": robot,
                    "controller": controller,
                    **({"actions": asdict(actions)} if controller == "speed" else {}),
                    "seed": options.seed,
                    "instructions": asdict(instructing),
                    "scene": Path(options.scenes or options.scene).name,
                    "episodes": Path(options.episodes).name,
                    "sampling": asdict(sampling),
                    "frames_per_second": options.frames_per_second,
                    "only_success": options.only_success,
                    "rgb_codec": options.rgb_codec,
                    "depth": options.depth,
                },
            )
        page = report.write(folder, context, chain.summaries)
    return show_summary(folder, chain.summaries, page, options.max_failed, options.json)


def _eye(ledger: Ledger) -> str | None:
    """Return the robot whose camera an earlier run of this folder looked with, if any.

    Robots that join later walk the same episodes with the same instructions.
    """
    rows = (row for row in ledger.rows(visibility.STAGE) if row.status == "done")
    return next((row.facts["robot"] for row in rows if "robot" in row.facts), None)


def instruct_config(options: Any) -> InstructConfig:
    """How `collect` and `instruct` are asked to write.

    Raises:
        InputError: an unknown name or a bad number; the message lists the valid ones.
    """
    asked = None
    if options.writer in (LLM, LOCAL):
        asked = settings_from(
            local=options.writer == LOCAL,
            max_tokens=options.max_tokens,
            max_cost=options.max_cost,
        )
    return InstructConfig(
        writer=options.writer,
        styles=parse_styles(options.style),
        count=options.count,
        languages=parse_languages(options.language),
        replace=options.replace,
        llm=asked,
    )


def check_frame_rate(rate: int) -> None:
    """Raise InputError if `rate` does not divide the state rate."""
    if rate < 1 or STATE_RATE_HZ % rate:
        raise InputError(f"--frames-per-second {rate}: valid: 4, 5, 10, 20, 25, 50")


@contextmanager
def opened(root: Path, workers: int) -> Iterator[Context]:
    """Open an output folder with its ledger, and start worker processes.

    Raises:
        InputError: If the folder cannot be used, or `workers` is negative.
    """
    if workers < 0:
        raise InputError(f"WORKERS={workers}: valid: 0 (one per core) and above")
    new = not root.exists()
    ours = any((root / name).is_file() for name in (MANIFEST_NAME, JOURNAL_NAME))
    if root.is_dir() and any(root.iterdir()) and not ours:
        raise InputError(
            f"output folder {root}: not empty and not an earlier run; choose another OUT"
        )
    folder = open_run_folder(root)
    sweep(folder.root)
    ledger = Ledger(folder.root)
    ledger.save()
    try:
        with Workers(workers or available_cores()) as pool:
            yield Context(ledger, pool)
    except InputError:
        left = {p.name for p in folder.root.rglob("*") if p.is_file()}
        if new and left <= {MANIFEST_NAME, QUARANTINE_NAME}:
            shutil.rmtree(folder.root)
        raise


def _roomy(sampling: SampleConfig, robots: Sequence[RobotSpec], ledger: Ledger) -> SampleConfig:
    """Widen the sampling clearance to the widest robot of this run and of earlier runs.

    Episodes that fit a wide robot also fit the others, so the episodes of a run folder change only
    when a wider robot is added, and all robots of one folder walk the same episodes.
    """
    # Rows written by another version may lack this fact, and quarantined rows always do.
    before = [row.facts.get("robot_radius_m", 0.0) for row in ledger.rows("sample")]
    before_m = max(before, default=0.0)
    widest = max(robots, key=lambda robot: robot.footprint_radius_m)
    radius_m = max(sampling.robot_radius_m, before_m, widest.footprint_radius_m)
    if before_m and radius_m > before_m:
        log.warning(
            "%s needs %.2f m of clearance, but the existing episodes have %.2f m: sampling new "
            "episodes. Results of other robots on the old episodes are dropped from the report; "
            "add these robots to ROBOT to run them on the new episodes",
            widest.name,
            radius_m,
            before_m,
        )
    ends_m = max(sampling.end_clearance_m, radius_m)
    return replace(sampling, robot_radius_m=radius_m, end_clearance_m=ends_m)


def _sources(options: Collect, episode_file: Path | None) -> Mapping[str, Path | BuiltIn]:
    """Return the scan, or the building to generate, of each scene id."""
    if options.scenes is None:
        if built := parse_builtin(options.scene, options.seed):
            return {building.name: building for building in built}
        source = Path(options.scene)
        repair.source_digest(source)  # fails early if the file does not exist
        return {safe_name(source.stem): source}
    found = find_scans(options.scenes)
    if episode_file:
        named = {episode.scene_stem for episode in read_vlnce(episode_file).episodes}
        found = {name: path for name, path in found.items() if name in named}
    if not found:
        what = "none of the episodes' scans" if episode_file else "no scan"
        raise InputError(f"SCENES={options.scenes}: contains {what}; valid: {' '.join(SUFFIXES)}")
    return found


def _episodes(text: str) -> tuple[int, Path | None]:
    if text.isdigit() and int(text) > 0:
        return int(text), None
    path = Path(text)
    if path.is_file():
        return 0, path
    raise InputError(f"EPISODES={text}: valid: a number above 0, or an existing VLN-CE file")


def _sampling(options: Collect, count: int) -> SampleConfig:
    try:
        return SampleConfig(
            count=max(count, 1),
            min_length_m=options.min_length_m,
            min_crossings=options.min_crossings,
        )
    except ValueError as error:
        raise InputError(str(error)) from error


def _run_name(options: Collect, sources: Mapping[str, Path | BuiltIn]) -> str:
    if options.scenes is not None:
        return safe_name(options.scenes.resolve().name)
    first, *others = sources
    # All of several built-in scenes are of one kind: villa-0-to-9.
    return f"{first}-to-{others[-1].rsplit('-')[-1]}" if others else first
