"""`vlnpe collect`: the whole chain, reusing what is done."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from ...collectors.controllers import SpeedConfig
from ...collectors.rendering.camera.extras import Extras
from ...collectors.rendering.camera.views import CameraWishes
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
from ...scene_repair.scan.kinds import SUFFIXES
from ...trajectory_sampler.config import SampleConfig
from ..chain import Chain, Product
from ..crews import AUTO, action_timing, chosen_robots, crews
from ..engine.executors import Workers, available_cores
from ..engine.ledger import JOURNAL_NAME, MANIFEST_NAME, QUARANTINE_NAME, Ledger
from ..engine.run_folder import RunFolder, open_run_folder, safe_name
from ..engine.runner import Context
from ..kept_robots import keep, kept
from ..scan_files import find_scans
from ..stages import repair, report
from ..stages.export import check_depth_storage
from ..summary import show_summary
from ..views import chosen_views

log = logging.getLogger(__name__)

BUILTIN = "builtin"


@dataclass(frozen=True)
class Collect:
    """Collect a dataset: repair, sample, instruct, replay, render, export, report.

    Everything lands in one run folder; what is done already is reused, and changing one option
    redoes only what depends on it.
    """

    robot: str = "aliengo"
    """Which robots walk: a name (see `vlnpe robots`), your own robot's folder, several (h1,g1), or
    `all` that have a body. All get the same episodes, with room for the widest of them."""
    controller: str = AUTO
    """How they are driven: path, speed or flash, several (path,speed), or `all`; `auto` is path,
    and flash for an agent without a body."""
    action_steps: int = SpeedConfig.steps_per_action
    """Physics steps of 5 ms that a discrete action of the controller speed lasts."""
    closed_loop: bool = False
    """Instead, a discrete action lasts until its 0.25 m or 15° are reached."""
    scene: str = BUILTIN
    """A scan to collect in (GLB, glTF, OBJ, PLY, STL, USD or a point cloud; see docs/scans.md), or
    `builtin` for a generated apartment."""
    scenes: Path | None = None
    """A folder of scans: all of them, or those that a VLN-CE file's scene ids name."""
    episodes: str = "6"
    """How many episodes to sample per scene, or a VLN-CE file (.json.gz)."""
    min_length_m: float = SampleConfig.min_length_m
    """Least geodesic distance from start to goal of sampled episodes [m]; lower it for a scan of a
    single room."""
    min_crossings: int = SampleConfig.min_crossings
    """How often a sampled path must pass from one room into another; 0 for a single room."""
    camera: str = "ego"
    """Which views to render: ego, chase, top; several (ego,chase), each with its own size and field
    of view if wished (ego:640x480:79). Each is a dataset of its own."""
    light: str = "baked"
    """Which lighting: baked (as scanned), DL5000 (panel lights, day), DL300 (night), CL (a lamp on
    the robot); several (DL5000,CL), or `all`. Each is a dataset of its own."""
    renderer: str = "auto"
    """Who draws: embree (processor), gl (MuJoCo through EGL), or auto: gl where a graphics card is,
    else embree."""
    writer: str = InstructConfig.writer
    """Who writes the instructions: composer (offline), llm (any OpenAI-compatible server, see
    docs/instructions.md), or local (a GGUF model on disk)."""
    style: str = MIXED
    """Of the instructions: natural, terse, rich, several (terse,rich), or mixed, all in turn."""
    count: int = InstructConfig.count
    """Instructions per path and language."""
    language: str = "en"
    """Of the instructions: en, zh, hi, several (en,zh); other than en needs a language model."""
    replace: bool = False
    """Also rewrite instructions that a VLN-CE file brings along."""
    max_tokens: int = 0
    """Stop asking a language model after so many tokens; 0 = any."""
    max_cost: float = 0.0
    """Stop asking after so much is spent, at the prices in the environment; 0 = any."""
    up: str = "auto"
    """The scans' up axis: x y z -x -y -z, or auto."""
    unit: str = "auto"
    """The scans' unit of length: m cm mm in ft, or auto."""
    allow_unsound: bool = False
    """Collect in scenes, too, whose repair is not sound; they are quarantined otherwise. Report and
    dataset card name them."""
    out: Path | None = None
    """The run folder; by default `runs/<scene>`."""
    seed: int = 0
    """Of the built-in apartment, the sampling and everything else that is random."""
    semantic: bool = False
    """Also render the label of every pixel (semantic.mov, and in MCAP)."""
    instance: bool = False
    """Also render the object of every pixel (instance.mov, and in MCAP)."""
    frames_per_second: int = 4
    """Rendered frames per second: 4, 5, 10, 20, 25 or 50."""
    only_success: bool = False
    """Export only episodes that end at the goal; otherwise all, each with its end reason."""
    rgb_codec: str = "h264"
    """Codec of colour videos: h264, or av1, which nobody claims fees for."""
    depth: str = "video"
    """How LeRobot datasets keep depth: video (lossless, 12-bit codes) or image (16-bit, mm)."""
    workers: int = 0
    """Worker processes; 0 takes one per core."""
    max_failed: int = 0
    """Exit with code 1 when more items than this are quarantined."""
    json: Annotated[bool, tyro.conf.arg(name="json")] = False
    """Print one JSON object with the summary as the last line."""


def run(options: Collect) -> int:
    """Run the chain; returns the exit code.

    Raises:
        InputError: any option is unusable; checked before anything is written.
    """
    robots = chosen_robots(options.robot)
    pairs = crews(robots, options.controller)
    actions = action_timing(options.action_steps, options.closed_loop)
    extras = Extras(options.semantic, options.instance)
    product = Product(
        options.frames_per_second, extras, options.only_success, options.rgb_codec, options.depth
    )
    looks = (options.camera, options.light, options.renderer)
    views = {r.name: chosen_views(*looks, r, CameraWishes()) for r in robots}
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
        eye = kept(widest.name, folder.root)
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
    """Raise InputError for a frame rate that does not divide the state rate."""
    if rate < 1 or STATE_RATE_HZ % rate:
        raise InputError(f"--frames-per-second {rate}: valid: 4, 5, 10, 20, 25, 50")


@contextmanager
def opened(root: Path, workers: int) -> Iterator[Context]:
    """Open an output folder with its ledger, and worker processes.

    Raises:
        InputError: the folder cannot be used, or `workers` is negative.
    """
    if workers < 0:
        raise InputError(f"WORKERS={workers}: valid: 0 (one per core) and above")
    new = not root.exists()
    ours = any((root / name).is_file() for name in (MANIFEST_NAME, JOURNAL_NAME))
    if root.is_dir() and any(root.iterdir()) and not ours:
        raise InputError(f"output folder {root}: not empty and no earlier run; choose another OUT")
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
    """Sample paths with room for the widest robot of this run, and of the runs before it.

    Episodes that fit a wide robot fit the others; so a run folder's episodes change only when a
    wider robot joins, and the robots of one folder walk the same ones.
    """
    # Rows of another version's code may lack it, and so do quarantined ones.
    before = [row.facts.get("robot_radius_m", 0.0) for row in ledger.rows("sample")]
    before_m = max(before, default=0.0)
    widest = max(robots, key=lambda robot: robot.footprint_radius_m)
    radius_m = max(sampling.robot_radius_m, before_m, widest.footprint_radius_m)
    if before_m and radius_m > before_m:
        log.warning(
            "%s needs %.2f m of clearance, and the episodes here had %.2f m: they are sampled "
            "anew. What other robots collected on the old ones leaves the report; name these "
            "robots, too, and they walk the new ones",
            widest.name,
            radius_m,
            before_m,
        )
    ends_m = max(sampling.end_clearance_m, radius_m)
    return replace(sampling, robot_radius_m=radius_m, end_clearance_m=ends_m)


def _sources(options: Collect, episode_file: Path | None) -> dict[str, Path]:
    """Scene id → scan; empty for the built-in apartment."""
    if options.scenes is None:
        if options.scene == BUILTIN:
            return {}
        source = Path(options.scene)
        repair.source_digest(source)  # says at once when the file is not there
        return {safe_name(source.stem): source}
    found = find_scans(options.scenes)
    if episode_file:
        named = {episode.scene_stem for episode in read_vlnce(episode_file).episodes}
        found = {name: path for name, path in found.items() if name in named}
    if not found:
        what = "none of the episodes' scans" if episode_file else "no scan"
        raise InputError(f"SCENES={options.scenes}: {what} in it; valid: {' '.join(SUFFIXES)}")
    return found


def _episodes(text: str) -> tuple[int, Path | None]:
    if text.isdigit() and int(text) > 0:
        return int(text), None
    path = Path(text)
    if path.is_file():
        return 0, path
    raise InputError(f"EPISODES={text}: neither a number above 0 nor an existing VLN-CE file")


def _sampling(options: Collect, count: int) -> SampleConfig:
    try:
        return SampleConfig(
            count=max(count, 1),
            min_length_m=options.min_length_m,
            min_crossings=options.min_crossings,
        )
    except ValueError as error:
        raise InputError(str(error)) from error


def _run_name(options: Collect, sources: dict[str, Path]) -> str:
    if options.scenes is not None:
        return safe_name(options.scenes.resolve().name)
    return next(iter(sources), f"apartment-{options.seed}")
