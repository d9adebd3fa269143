"""Stage `look`: what the robot's own camera sees along the paths, for the instructions."""

from pathlib import Path

from ...collectors.robots import get_robot
from ..engine.ledger import Row
from ..engine.work import WorkItem, work_item
from ..jobs.instructions.visibility import LookJob

STAGE = "look"


def item(source: Row, scenes: Path, episodes: Path, out: Path, robot: str, every: bool) -> WorkItem:
    """Look along the paths of one scene's `episodes` with the camera of `robot`.

    Args:
        source: row of the stage that made `episodes`.
        robot: name or folder of the robot whose camera looks.
        every: also along paths that have an instruction already.
    """
    spec = get_robot(robot)
    scene = source.item.rsplit("@", 1)[-1]  # of several files, items are named split@scene
    job = LookJob(scenes / scene, episodes, out, robot, every)
    inputs = (source.key, spec.name, spec.content_sha256, every)
    return work_item(STAGE, source.item, job, (out,), *inputs)
