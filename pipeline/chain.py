"""The stages of one run, in order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..collectors.rendering.views import View
from ..collectors.replay import ReplayConfig
from ..formats.episode import Episode
from ..instruction_gen.records import InstructConfig
from ..scene_repair.config import RepairConfig
from ..trajectory_sampler.sampling import SampleConfig
from .ledger import Row
from .run_folder import RunFolder
from .runner import Context, StageSummary, WorkItem, run_stage
from .stages import align, episodes, export, render, repair, replay, scans


class Chain:
    """Runs stages one after another and remembers their summaries.

    Attributes:
        summaries: of every stage that ran, in order.
    """

    def __init__(self, folder: RunFolder, context: Context, seed: int):
        """Args: folder: of the run; context: ledger and workers; seed: of all randomness."""
        self.folder = folder
        self.context = context
        self.seed = seed
        self.summaries: list[StageSummary] = []

    def scenes(self, sources: Mapping[str, Path], config: RepairConfig) -> dict[str, Row]:
        """Repair the scans, by scene id; without any, generate and scan an apartment first."""
        if not sources:
            scan = self.folder.scan(f"apartment-{self.seed}")
            self._stage(scans.STAGE, [scans.item(self.seed, scan)], required=True)
            sources = {scan.name: scan / "scan.glb"}
        items = repair.items(sources, config, self.folder.scenes)
        return self._stage(repair.STAGE, items, required=True).good()

    def sampled(self, config: SampleConfig, scenes: Mapping[str, Row]) -> list[Episode]:
        """Sample episodes in every scene and instruct them."""
        parts = {s: self.folder.episodes(f"sampled/{s}") for s in scenes}
        items = [
            episodes.sample_item(row, self.folder.scenes, parts[s], config, self.seed)
            for s, row in scenes.items()
        ]
        self._unselect(align.FILTER_STAGE, align.STAGE)
        sampled = self._stage("sample", items, required=True)
        return self._instructed(sampled, parts, config.split)

    def aligned(self, source: Path, scenes: Mapping[str, Row]) -> list[Episode]:
        """Filter and align a VLN-CE file's episodes; instruct those that have no words."""
        split = source.name.split(".")[0]
        kept = self.folder.episodes(f"filtered/{split}")
        self._unselect("sample")
        item = align.filter_item(source, kept)
        filtered = self._stage(align.FILTER_STAGE, [item], required=True)
        parts = {s: self.folder.episodes(f"aligned/{s}") for s in scenes}
        row = next(iter(filtered.good().values()))
        items = align.items(kept, row, scenes, self.folder.scenes, parts)
        summary = self._stage(align.STAGE, items)
        align.record_rejected(self.context.ledger, summary, kept, scenes)
        return self._instructed(summary, parts, split)

    def collected(
        self,
        asked: Sequence[Episode],
        scenes: Mapping[str, Row],
        robot: str,
        controller: str,
        view: View,
        frames_per_second: int,
        facts: Mapping[str, Any],
    ) -> None:
        """Replay, render and export the episodes with one robot; `facts` go to the provenance."""
        folder = self.folder
        scope = f"{robot}/{controller}/"
        config = ReplayConfig(robot=robot, controller=controller, seed=self.seed)
        items = replay.items(asked, scenes, folder.scenes, folder.rollouts, config)
        self._unselect_strangers(asked, scenes, scope)
        rollouts = self._stage(replay.STAGE, items, scope).good()
        items = render.items(
            rollouts,
            scenes,
            folder.root,
            folder.scenes,
            folder.frames,
            folder.root,
            view,
            frames_per_second,
        )
        scope += f"{view.name}/"
        frames = self._stage(render.STAGE, items, scope).good()
        dataset = export.Dataset.under(folder.root, robot, controller, view.name)
        items = export.unit_items(frames, folder.root, dataset)
        units = self._stage(export.STAGE, items, scope).good()
        items = export.mcap_items(frames, folder.root, folder.scenes, dataset)
        self._stage(export.MCAP_STAGE, items, scope)
        used = {
            str(row.facts["scene"]): folder.scenes / str(row.facts["scene"])
            for row in units.values()
        }
        if not units:
            return  # every episode is quarantined: no dataset, and the report says why
        item = export.dataset_item(units, folder.root, used, dataset, {"options": dict(facts)})
        self._stage(export.DATASET_STAGE, [item], dataset.name)

    def _instructed(
        self, source: StageSummary, parts: Mapping[str, Path], split: str
    ) -> list[Episode]:
        told = {s: self.folder.episodes(f"told/{s}") for s in parts}
        items = [
            episodes.instruct_item(
                row, self.folder.scenes, parts[s], told[s], InstructConfig(), self.seed
            )
            for s, row in source.good().items()
        ]
        done = self._stage("instruct", items).good()
        return episodes.merge([told[s] for s in done], self.folder.episodes(split))

    def _unselect(self, *stages: str) -> None:
        """Rows of a way to get episodes that this run does not take are not current."""
        for stage in stages:
            self.context.ledger.select(stage, "", ())

    def _unselect_strangers(
        self,
        asked: Sequence[Episode],
        scenes: Mapping[str, Row],
        own: str,
    ) -> None:
        """Rollouts of other robots stay current only where they walked these very episodes."""
        ledger = self.context.ledger
        scopes = {r.item.rsplit("/", 1)[0] for r in ledger.rows(replay.STAGE)} - {own.rstrip("/")}
        for scope in scopes:
            robot, controller = scope.split("/")
            config = ReplayConfig(robot=robot, controller=controller, seed=self.seed)
            items = replay.items(asked, scenes, self.folder.scenes, self.folder.rollouts, config)
            same = {i.name for i in items if ledger.is_done(replay.STAGE, i.name, i.key)}
            ledger.select(replay.STAGE, f"{scope}/", same)

    def _stage(
        self, name: str, items: Sequence[WorkItem], scope: str = "", required: bool = False
    ) -> StageSummary:
        summary = run_stage(self.context, name, items, scope, required)
        self.summaries.append(summary)
        return summary
