"""The stages of one run, in order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ..collectors.controllers import SpeedConfig
from ..collectors.rendering.camera.extras import Extras
from ..collectors.rendering.camera.views import View
from ..formats.core.episode import Episode
from ..formats.core.errors import InputError
from ..formats.vlnce.records import split_name
from ..instruction_gen.records import InstructConfig
from ..scene_repair.config import RepairConfig
from ..trajectory_sampler.align_config import AlignConfig
from ..trajectory_sampler.config import SampleConfig
from ..trajectory_sampler.stairs import StairRules
from .engine.ledger import Row
from .engine.run_folder import RunFolder
from .engine.runner import Context, StageSummary, WorkItem, run_stage
from .inputs.builtin import BuiltIn
from .inputs.crews import action_timing, kept
from .jobs.instructions.instruct import CACHE, InstructJob
from .stages import align, episodes, export, instruct, render, repair, replay, together, visibility


@dataclass(frozen=True)
class Product:
    """What is rendered and exported from rollouts.

    Attributes:
        frames_per_second: rendered.
        extras: videos beside colour and depth.
        only_success: leave failures out of the export; they are rendered in any case.
        rgb_codec: key of `formats.video.RGB_CODECS`.
        depth_storage: what `export.check_depth_storage` takes.
        mcap: write MCAP files, too.
    """

    frames_per_second: int
    extras: Extras
    only_success: bool
    rgb_codec: str
    depth_storage: str
    mcap: bool = True


class Chain:
    """Runs stages one after another and remembers their summaries.

    Attributes:
        summaries: of every stage that ran, in order.
    """

    def __init__(
        self,
        folder: RunFolder,
        context: Context,
        seed: int,
        actions: SpeedConfig,
        instructing: InstructConfig,
        eye: str,
        per_instruction: bool = False,
    ):
        """Set up the chain.

        Args:
            folder: of the run.
            context: ledger and workers.
            seed: of all randomness.
            actions: how the controller `speed` carries discrete actions out.
            instructing: how instructions are made.
            eye: the robot whose camera says what there is to see on the way.
            per_instruction: make files and datasets with one episode per instruction.
        """
        self.folder = folder
        self.context = context
        self.seed = seed
        self.actions = actions
        self.instructing = instructing
        self.eye = eye
        self.per_instruction = per_instruction
        self.summaries: list[StageSummary] = []

    def scenes(
        self, sources: Mapping[str, Path | BuiltIn], config: RepairConfig, allow_unsound: bool
    ) -> dict[str, Row]:
        """Repair the scans, by scene id; generate and scan the built-in ones first.

        Scenes that are not sound are quarantined unless they are allowed.
        """
        files = {name: source for name, source in sources.items() if isinstance(source, Path)}
        built = [source for source in sources.values() if isinstance(source, BuiltIn)]
        if built:
            items = [repair.scan_item(b, self.folder.scan(b.name)) for b in built]
            made = self._stage(repair.SCAN_STAGE, items, required=True).good()
            files |= {name: self.folder.scan(name) / "scan.glb" for name in made}
        items = repair.items(files, config, self.folder.scenes)
        repaired = self._stage(repair.STAGE, items, required=True).good()
        checks = repair.check_items(repaired, self.folder.scenes, allow_unsound)
        sound = self._stage(repair.CHECK_STAGE, checks, required=True).good()
        return {scene: repaired[scene] for scene in sound}

    def sampled(
        self,
        config: SampleConfig,
        scenes: Mapping[str, Row],
        quotas: Mapping[str, Mapping[str, int]] | None = None,
        *,
        exact: bool = True,
    ) -> list[Episode]:
        """Sample paths in every scene and instruct them.

        Args:
            config: what to sample.
            scenes: rows of the repair stage by scene id.
            quotas: paths by split, by scene. Without them, every scene gives the count of
                `config`.
            exact: the quotas must be filled.

        Raises:
            InputError: a scene cannot hold its share.
        """
        planned = {s: row for s, row in scenes.items() if quotas is None or s in quotas}
        before = [row for summary in self.summaries for row in summary.rows]
        parts = {s: self.folder.episodes(f"sampled/{s}") for s in planned}

        def item(scene: str, radius_m: float) -> WorkItem:
            wanted, quota = config.for_radius(radius_m), (quotas or {}).get(scene)
            folders = (self.folder.scenes, parts[scene])
            return episodes.sample_item(planned[scene], *folders, wanted, self.seed, quota)

        items = episodes.items(self.context.ledger, planned, config.robot_radius_m, item)
        self._unselect(align.FILTER_STAGE, align.STAGE)
        sampled = self._stage(episodes.STAGE, items, required=True)
        if quotas is not None:
            episodes.check_complete(sampled.rows, quotas, exact=exact, before=before)
        return self._instructed(sampled, parts)

    def aligned(
        self,
        sources: Sequence[Path],
        scenes: Mapping[str, Row],
        rules: StairRules,
        config: AlignConfig,
    ) -> list[Episode]:
        """Filter and align the episodes of VLN-CE files; instruct those that have no words.

        Args:
            sources: one file per split.
            scenes: rows of the repair stage by scene id.
            rules: what counts as a stair.
            config: tolerances, and the footprint of the widest robot.
        """
        kept = {s: self.folder.episodes(f"filtered/{s.name.split('.')[0]}") for s in sources}
        self._unselect(episodes.STAGE)
        items = [align.filter_item(s, kept[s], rules, scenes, self.folder.scenes) for s in sources]
        filtered = self._stage(align.FILTER_STAGE, items, required=True)
        good = filtered.good()
        files = {kept[s]: good[s.name].key for s in sources if s.name in good}
        parts: dict[str, Path] = {}
        for file in files:
            for scene in scenes:
                name = align.part_name(split_name(file), scene, len(files))
                parts[name] = self.folder.episodes(f"aligned/{name}")
        items = align.items(files, scenes, self.folder.scenes, parts, config)
        summary = self._stage(align.STAGE, items)
        align.record_rejected(self.context.ledger, filtered, summary, files, scenes)
        return self._instructed(summary, parts)

    def keep(
        self, asked: Sequence[Episode], scenes: Mapping[str, Row], pairs: Sequence[tuple[str, str]]
    ) -> None:
        """Drop the rows of robots other than `pairs` unless they walked these episodes.

        Those of another seed stay: the report says that they are.
        """
        ledger = self.context.ledger
        done = {tuple(row.item.split("/")[:2]) for row in ledger.rows(replay.STAGE)}
        current = {(robot, self._label(robot, controller)) for robot, controller in pairs}
        for robot, controller in sorted(done - current):
            try:
                seed, actions, driver = self._driven(robot, controller)
                if seed != self.seed:
                    continue
                items = self._walks(asked, scenes, robot, driver, seed, actions, controller)
            except InputError:  # a robot that is known no more
                items = []
            same = {item.name for item in items if self._is_current(item)}
            scope = f"{robot}/{controller}/"
            ledger.select(replay.STAGE, scope, same)
            if len(same) < len(items) or not items:
                for stage in (render.STAGE, export.STAGE, export.MCAP_STAGE):
                    ledger.select(stage, scope, ())
                ledger.select(export.DATASET_STAGE, f"{robot}-{controller}-", ())

    def collected(
        self,
        asked: Sequence[Episode],
        scenes: Mapping[str, Row],
        robot: str,
        controller: str,
        views: Sequence[View],
        product: Product,
        facts: Mapping[str, Any],
    ) -> None:
        """Replay the episodes with one robot; render and export each view, with `facts`."""
        folder = self.folder
        label = self._label(robot, controller)
        scope = f"{robot}/{label}/"
        walks = self._walks(asked, scenes, robot, controller, self.seed, self.actions, label)
        rollouts: dict[str, Row] | None = None
        for view in views:
            dataset = export.Dataset.under(folder.root, robot, label, view.name)
            renders = partial(self._renders, scenes, view, product)
            of_view = f" {view.kind} {view.light}"
            together.run(
                self.context,
                asked,
                walks,
                renders,
                partial(self._exports, dataset, product),
                only_success=product.only_success,
                label=f"{robot} {label}{of_view if len(views) > 1 else ''}",
            )
            if rollouts is None:
                rollouts = self._stage(replay.STAGE, walks, scope).good()
                self.context.ledger.record_new(folder.models)
            frames = self._stage(render.STAGE, renders(rollouts), dataset.scope).good()
            self.summaries += export.run(
                self.context,
                export.wanted(frames, product.only_success),
                folder.root,
                folder.scenes,
                dataset,
                {"options": dict(facts), "language_model": self._model_usage()},
                depth_storage=product.depth_storage,
                per_instruction=self.per_instruction,
                mcap=product.mcap,
            )

    def _renders(
        self,
        scenes: Mapping[str, Row],
        view: View,
        product: Product,
        rollouts: Mapping[str, Row],
    ) -> list[WorkItem]:
        folder = self.folder
        return render.items(
            render.Recorded(rollouts, folder.root, scenes, folder.scenes),
            view,
            product.frames_per_second,
            folder.frames,
            folder.root,
            product.rgb_codec,
            product.extras,
        )

    def _exports(
        self, dataset: export.Dataset, product: Product, frames: Mapping[str, Row]
    ) -> dict[str, list[WorkItem]]:
        root, depth = self.folder.root, product.depth_storage
        items = {
            export.STAGE: export.unit_items(frames, root, dataset, depth, self.per_instruction)
        }
        if product.mcap:
            scenes = self.folder.scenes
            items[export.MCAP_STAGE] = export.mcap_items(frames, root, scenes, dataset, depth)
        return items

    def _instructed(self, source: StageSummary, parts: Mapping[str, Path]) -> list[Episode]:
        folder, config = self.folder, self.instructing
        rows = source.good()
        items = [
            visibility.item(row, folder.scenes, parts[s], folder.seen(s), self.eye, config.replace)
            for s, row in rows.items()
        ]
        seen = self._stage(visibility.STAGE, items).good()
        instructed = {s: folder.episodes(f"told/{s}") for s in seen}
        items = [
            instruct.item(
                s,
                InstructJob(
                    scenes=folder.scenes,
                    episodes=parts[s],
                    seen=(folder.seen(s),),
                    out=instructed[s],
                    facts=folder.facts(s),
                    cache=folder.root / CACHE,
                    config=config,
                    seed=self.seed,
                ),
                rows[s].key,
                seen[s].key,
            )
            for s in seen
        ]
        done = self._stage(instruct.STAGE, items)
        instruct.record_failed(self.context.ledger, done)
        paths, files = episodes.merge(
            [instructed[s] for s in done.good()], folder.episodes, self.per_instruction
        )
        self.context.ledger.record(files.values())
        self.context.ledger.record_new(folder.root / CACHE)
        return paths

    def _model_usage(self) -> dict[str, Any]:
        """Return requests, tokens and cost of the language model; empty without one."""
        used = [r.facts.get("language_model") or {} for r in self.context.ledger.rows("instruct")]
        return max(used, key=lambda one: one.get("requests", 0), default={})

    def _unselect(self, *stages: str) -> None:
        """Mark the rows of stages that this run does not use as not current."""
        for stage in stages:
            self.context.ledger.select(stage, "", ())

    def _driven(self, robot: str, label: str) -> tuple[int, SpeedConfig, str]:
        """Return seed, action timing and controller of the rollouts kept under a label."""
        for row in self.context.ledger.rows(replay.STAGE):
            if row.item.startswith(f"{robot}/{label}/") and "seed" in row.facts:
                actions, facts = row.facts["actions"], row.facts
                timing = action_timing(**actions) if actions else self.actions
                return facts["seed"], timing, facts["controller"]
        return self.seed, self.actions, label

    def _label(self, robot: str, controller: str) -> str:
        """Return the name under which this run keeps a robot's rollouts."""
        reference = kept(robot, self.folder.root)
        config = replay.config(reference, controller, self.seed, self.actions)
        return replay.label_of(self.context.ledger, config)

    def _walks(
        self,
        asked: Sequence[Episode],
        scenes: Mapping[str, Row],
        robot: str,
        controller: str,
        seed: int,
        actions: SpeedConfig,
        label: str,
    ) -> list[WorkItem]:
        folder = self.folder
        reference = kept(robot, folder.root)
        config = replay.config(reference, controller, seed, actions)
        where = (folder.scenes, folder.rollouts, folder.models)
        return replay.items(asked, scenes, *where, config, label)

    def _is_current(self, item: WorkItem) -> bool:
        """Return whether an earlier run did, or failed at, exactly this item."""
        ledger = self.context.ledger
        row = ledger.row(replay.STAGE, item.name)
        broken = row is not None and row.status == "quarantined" and row.key == item.key
        return broken or ledger.is_done(replay.STAGE, item.name, item.key)

    def _stage(
        self, name: str, items: Sequence[WorkItem], scope: str = "", required: bool = False
    ) -> StageSummary:
        summary = run_stage(self.context, name, items, scope, required)
        self.summaries.append(summary)
        return summary
