"""Stages `look` and `name`: what is seen along the paths, for the instructions.

The robot's own camera sees it; in scenes without labels a vision-language model says what it is.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ...collectors.robots import get_robot
from ...instruction_gen.llm.brief import SIGHT_PROMPTS, prompts_sha256
from ..engine.ledger import Row
from ..engine.work import WorkItem, work_item
from ..jobs.instructions.name_things import NameThingsJob
from ..jobs.instructions.visibility import LookJob
from .align import scene_of_part

STAGE = "look"
NAME_STAGE = "name"


def item(source: Row, scenes: Path, episodes: Path, out: Path, robot: str, every: bool) -> WorkItem:
    """Look along the paths of one scene's `episodes` with the camera of `robot`.

    Args:
        source: row of the stage that made `episodes`.
        robot: name or folder of the robot whose camera looks.
        every: also along paths that have an instruction already.
    """
    spec = get_robot(robot)
    job = LookJob(scenes / scene_of_part(source.item), episodes, out, robot, every)
    inputs = (source.key, spec.name, spec.content_sha256, every)
    return work_item(STAGE, source.item, job, (out,), *inputs)


def name_item(scene: str, job: NameThingsJob, *made_of: str) -> WorkItem:
    """Name the things and rooms of one scene.

    Args:
        made_of: keys of the items that made the scene and the episodes.
    """
    spec = get_robot(job.robot)
    prompts = prompts_sha256(SIGHT_PROMPTS)
    inputs = (*made_of, job.settings, spec.name, spec.content_sha256, job.every, prompts)
    return work_item(NAME_STAGE, scene, job, (job.out,), *inputs)


def was_asked(row: Row) -> bool:
    """Return whether the model was asked about a scene: those with labels need none."""
    return "language_model" in row.facts


def model_usage(rows: Iterable[Row]) -> dict[str, Any]:
    """Return requests, tokens and cost so far; empty if no scene needed any."""
    used = [row.facts.get("language_model") or {} for row in rows]
    return max(used, key=lambda one: one.get("requests", 0), default={})


def naming_report(rows: Iterable[Row]) -> list[str]:
    """Return one line for each scene: what was named, or that it has labels."""
    return [f"{row.item}: {_line(row)}\n" for row in rows if row.status == "done"]


def _line(row: Row) -> str:
    facts = row.facts
    if facts["labelled"]:
        return "has labels of its own; the vision-language model was not asked"
    if not was_asked(row):
        return "all paths have instructions; the vision-language model was not asked"
    asked = (facts["asked_for_things"], facts["asked_for_rooms"])
    frames, unknown, unanswered = (
        sum(one[key] for one in asked) for key in ("frames", "unknown", "unanswered")
    )
    left_out = f"; {unknown} unknown names were left out" if unknown else ""
    left_out += f"; {unanswered} had no usable answer" if unanswered else ""
    named = f"{facts['things']} things and {facts['rooms']} rooms"
    return f"{named} named by the vision-language model in {frames} requests{left_out}"
