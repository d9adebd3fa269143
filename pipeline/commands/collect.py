"""`vlnpe collect`: the whole chain, reusing what is done."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ...collectors.controllers import CONTROLLERS
from ...collectors.rendering import VIEWS
from ...collectors.replay import ReplayConfig
from ...collectors.robots import ROBOTS
from ...formats.episode import Episode
from ...formats.errors import InputError, UnknownNameError
from ...instruction_gen import InstructConfig
from ...scene_repair.repair import RepairConfig
from ...trajectory_sampler.sampling import SampleConfig
from ..executors import Workers, available_cores
from ..ledger import Ledger, Row
from ..run_folder import RunFolder, open_run_folder, safe_name
from ..runner import Context, StageSummary, WorkItem, run_stage
from ..stages import align, episodes, export, render, repair, replay, scans
from ..stages.report import write_report
from ..summary import show_summary

log = logging.getLogger(__name__)

BUILTIN = "builtin"
ALL = "all"
MESH_SUFFIXES = {".glb", ".gltf", ".obj", ".ply", ".stl"}


@dataclass(frozen=True)
class Collect:
    """Collect a dataset: repair, sample, instruct, replay, render, export, report.

    Everything lands in one run folder; what is done already is reused, and changing one option
    redoes only what depends on it.
    """

    robot: str = "aliengo"
    """Which robot walks; `all` collects the same episodes with every robot."""
    controller: str = "path"
    """How it is driven."""
    scene: str = BUILTIN
    """A scan to collect in (.glb .gltf .obj .ply .stl), or `builtin` for the generated apartment."""
    scenes: Path | None = None
    """A folder of scans: all of them, or those that a VLN-CE file's scene ids name."""
    episodes: str = "6"
    """How many episodes to sample per scene, or a VLN-CE file (.json.gz)."""
    camera: str = "ego"
    """Which view to render."""
    light: str = "baked"
    """Which lighting to render."""
    out: Path | None = None
    """The run folder; by default `runs/<scene>`."""
    seed: int = 0
    """Of the built-in apartment, the sampling and everything else that is random."""
    frames_per_second: int = 4
    """Rendered frames per second: 4, 5, 10, 20, 25 or 50."""
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
    robots = _robots(options.robot)
    if options.controller not in CONTROLLERS:
        raise UnknownNameError("controller", options.controller, CONTROLLERS)
    view = render.view_of(options.camera, options.light, options.frames_per_second)
    sources = _sources(options)
    count, episode_file = _episodes(options.episodes)
    folder = open_run_folder(options.out or Path("runs") / _run_name(options, sources))
    with _context(folder, options.workers) as context:
        chain = _Chain(folder, context)
        scenes = chain.scenes(options, sources)
        if episode_file:
            asked = chain.aligned(episode_file, scenes, options.seed)
        else:
            asked = chain.sampled(scenes, SampleConfig(count=count), options.seed)
        for robot in robots:
            config = ReplayConfig(robot=robot, controller=options.controller, seed=options.seed)
            chain.collected(asked, scenes, config, view)
        page = write_report(folder, context.ledger)
    return show_summary(folder, chain.summaries, page, options.max_failed, options.json)


class _Chain:
    """The stages of one run, in order, remembering their summaries."""

    def __init__(self, folder: RunFolder, context: Context):
        self.folder = folder
        self.context = context
        self.summaries: list[StageSummary] = []

    def stage(self, name: str, items: Sequence[WorkItem], scope: str = "") -> StageSummary:
        summary = run_stage(self.context, name, items, scope)
        self.summaries.append(summary)
        return summary

    def scenes(self, options: Collect, sources: dict[str, Path]) -> dict[str, Row]:
        if not sources:
            scan = self.folder.scan(f"apartment-{options.seed}")
            self.stage(scans.STAGE, [scans.item(options.seed, scan)])
            sources = {scan.name: scan / "scan.glb"}
        items = repair.items(sources, RepairConfig(), self.folder.scenes)
        return self.stage(repair.STAGE, items).good()

    def sampled(self, scenes: dict[str, Row], config: SampleConfig, seed: int) -> list[Episode]:
        parts = {s: self.folder.episodes(f"sampled/{s}") for s in scenes}
        items = [
            episodes.sample_item(row, self.folder.scenes, parts[s], config, seed)
            for s, row in scenes.items()
        ]
        return self._instructed(self.stage("sample", items), parts, config.split, seed)

    def aligned(self, file: Path, scenes: dict[str, Row], seed: int) -> list[Episode]:
        split = file.name.split(".")[0]
        parts = {s: self.folder.episodes(f"aligned/{s}") for s in scenes}
        summary = self.stage(align.STAGE, align.items(file, scenes, self.folder.scenes, parts))
        align.record_rejected(self.context.ledger, summary, file, scenes)
        return self._instructed(summary, parts, split, seed)

    def _instructed(
        self, source: StageSummary, parts: dict[str, Path], split: str, seed: int
    ) -> list[Episode]:
        told = {s: self.folder.episodes(f"told/{s}") for s in source.good()}
        items = [
            episodes.instruct_item(
                row, self.folder.scenes, parts[s], told[s], InstructConfig(), seed
            )
            for s, row in source.good().items()
        ]
        done = self.stage("instruct", items).good()
        return episodes.merge([told[s] for s in done], self.folder.episodes(split))

    def collected(
        self,
        asked: list[Episode],
        scenes: dict[str, Row],
        config: ReplayConfig,
        view: render.View,
    ) -> None:
        folder = self.folder
        items = replay.items(asked, scenes, folder.scenes, folder.rollouts, config)
        rollouts = self.stage(replay.STAGE, items)
        items = render.items(rollouts.good(), scenes, folder, view)
        frames = self.stage(render.STAGE, items)
        units = self.stage(export.STAGE, export.items(frames.good(), folder, view))
        self.stage(export.DATASET_STAGE, export.dataset_items(units.good(), scenes, folder, view))


def _robots(name: str) -> list[str]:
    if name == ALL:
        return sorted(ROBOTS)
    if name not in ROBOTS:
        raise UnknownNameError("robot", name, [*ROBOTS, ALL])
    return [name]


def _sources(options: Collect) -> dict[str, Path]:
    """Scene id → scan; empty for the built-in apartment."""
    if options.scenes is not None:
        if not options.scenes.is_dir():
            raise InputError(f"SCENES={options.scenes}: no such folder")
        files = sorted(p for p in options.scenes.rglob("*") if p.suffix.lower() in MESH_SUFFIXES)
        if not files:
            valid = " ".join(sorted(MESH_SUFFIXES))
            raise InputError(f"SCENES={options.scenes}: no scan in it; valid: {valid}")
        return {safe_name(p.stem): p for p in files}
    if options.scene == BUILTIN:
        return {}
    source = Path(options.scene)
    repair.source_digest(source)  # says at once when the file is not there
    return {safe_name(source.stem): source}


def _episodes(text: str) -> tuple[int, Path | None]:
    if text.isdigit() and int(text) > 0:
        return int(text), None
    path = Path(text)
    if path.is_file():
        return 0, path
    raise InputError(f"EPISODES={text}: neither a number above 0 nor an existing VLN-CE file")


def _run_name(options: Collect, sources: dict[str, Path]) -> str:
    if options.scenes is not None:
        return safe_name(options.scenes.resolve().name)
    return next(iter(sources), f"apartment-{options.seed}")


@contextmanager
def _context(folder: RunFolder, workers: int) -> Iterator[Context]:
    if workers < 0:
        raise InputError(f"WORKERS={workers}: valid: 0 (one per core) and above")
    with Workers(workers or available_cores()) as pool:
        yield Context(Ledger(folder.root), pool)
