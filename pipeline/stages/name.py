"""Stage `name`: what a vision-language model sees in scenes without labels."""

from collections.abc import Iterable
from typing import Any

from ...collectors.robots import get_robot
from ...instruction_gen.llm.brief import SIGHT_PROMPTS, prompts_sha256
from ..engine.ledger import Row
from ..engine.work import WorkItem, work_item
from ..jobs.instructions.name_things import NameThingsJob

STAGE = "name"


def item(scene: str, job: NameThingsJob, *made_of: str) -> WorkItem:
    """Name the things and rooms of one scene.

    Args:
        made_of: Keys of the items that made the scene and the episodes.
    """
    spec = get_robot(job.robot)
    prompts = prompts_sha256(SIGHT_PROMPTS)
    inputs = (*made_of, job.settings, spec.name, spec.content_sha256, job.every, prompts)
    return work_item(STAGE, scene, job, (job.out,), *inputs)


def was_asked(row: Row | None) -> bool:
    """Return whether the model was asked about a scene: those with labels need none."""
    return row is not None and "language_model" in row.facts


def usage(rows: Iterable[Row]) -> dict[str, Any]:
    """Return requests, tokens and cost so far; empty if no scene needed any."""
    used = [row.facts.get("language_model") or {} for row in rows]
    return max(used, key=lambda one: one.get("requests", 0), default={})


def report(rows: Iterable[Row]) -> list[str]:
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
