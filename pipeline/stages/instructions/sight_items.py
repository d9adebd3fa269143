"""Stages `look` and `name`: what is seen along the paths, for the instructions.

The robot's own camera sees it; in scenes without labels a vision-language model says what it is.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ....collectors.robots import RobotSpec
from ....instruction_gen.llm.brief import SIGHT_PROMPTS, prompts_sha256
from ....instruction_gen.llm.settings import LlmSettings
from ...engine.ledger import Row
from ...engine.rows import StageSummary
from ...engine.run_folder import SightFiles
from ...engine.work import WorkItem, work_item
from ..episodes.align_items import scene_of_part
from .name_things import NameThingsJob
from .visibility import LookJob

STAGE = "look"
NAME_STAGE = "name"


@dataclass(frozen=True)
class Sight:
    """Observation of the paths of scenes before they are instructed.

    Attributes:
        every: look also along paths that have an instruction already.
    """

    scenes: Path
    files: SightFiles
    robot: RobotSpec
    every: bool

    def look(self, source: Row, episodes: Path) -> WorkItem:
        """Return the item that looks along the paths of one scene."""
        out = self.files.seen(source.item)
        scene = self.scenes / scene_of_part(source.item)
        job = LookJob(scene, episodes, out, self.robot, self.every)
        inputs = (source.key, self.robot.name, self.robot.content_sha256, self.every)
        return work_item(STAGE, source.item, job, (out,), *inputs)

    def name(
        self, scene: str, episodes: Sequence[Path], model: LlmSettings, cache: Path, *made_of: str
    ) -> WorkItem:
        """Return the item that names the things and rooms of one scene.

        Args:
            made_of: keys of the items that made the scene and the episodes.
        """
        out = self.files.named(scene)
        job = NameThingsJob(
            scene=self.scenes / scene,
            episodes=tuple(episodes),
            settings=model,
            robot=self.robot,
            every=self.every,
            cache=cache,
            out=out,
        )
        prompts = prompts_sha256(SIGHT_PROMPTS)
        inputs = (*made_of, model, self.robot.name, self.robot.content_sha256, self.every, prompts)
        return work_item(NAME_STAGE, scene, job, (out,), *inputs)


@dataclass(frozen=True)
class Model:
    """A vision-language model that names things and rooms, and the folder of its answers."""

    settings: LlmSettings
    cache: Path


def named_scenes(
    stage: Callable[..., StageSummary],
    sight: Sight,
    model: Model,
    rows: Mapping[str, Row],
    parts: Mapping[str, Path],
) -> StageSummary:
    """Have a model name things and rooms along all paths of each scene; one item per scene.

    Args:
        stage: Runs a stage; the arguments are those of `Run.stage`.
        rows: Rows of the stage that made the episode files, by item.
        parts: Episode files by item.
    """
    by_scene: dict[str, list[str]] = {}
    for part in rows:
        by_scene.setdefault(scene_of_part(part), []).append(part)
    items = []
    for scene, here in by_scene.items():
        keys = (rows[part].key for part in here)
        files = [parts[part] for part in here]
        items.append(sight.name(scene, files, model.settings, model.cache, *keys))
    return stage(NAME_STAGE, items, required=True)


def used_model(row: Row) -> bool:
    """Return whether the model was asked about a scene: those with labels need none."""
    return "language_model" in row.facts


def model_usage(rows: Iterable[Row]) -> dict[str, Any]:
    """Return requests, tokens and cost so far; empty if no scene needed any."""
    used = [row.facts.get("language_model") or {} for row in rows]
    return max(used, key=lambda usage: usage.get("requests", 0), default={})


def naming_report(rows: Iterable[Row]) -> list[str]:
    """Return one line for each scene: what was named, or that it has labels."""
    return [f"{row.item}: {_line(row)}\n" for row in rows if row.status == "done"]


def _line(row: Row) -> str:
    facts = row.facts
    if facts["labelled"]:
        return "has labels of its own; the vision-language model was not asked"
    if not used_model(row):
        return "all paths have instructions; the vision-language model was not asked"
    tallies = (facts["asked_for_things"], facts["asked_for_rooms"])
    frames, unknown, unanswered = (
        sum(tally[key] for tally in tallies) for key in ("frames", "unknown", "unanswered")
    )
    left_out = f"; {unknown} unknown names were left out" if unknown else ""
    left_out += f"; {unanswered} had no usable answer" if unanswered else ""
    named = f"{facts['things']} things and {facts['rooms']} rooms"
    return f"{named} named by the vision-language model in {frames} requests{left_out}"
