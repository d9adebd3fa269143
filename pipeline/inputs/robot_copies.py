"""Copies of users' own robots in a run."""

from pathlib import Path

from ...collectors.robots import RobotSpec, get_robot

FOLDER = "robots"


def robot_of_run(name: str, root: Path) -> RobotSpec:
    """Return the robot of a run with a name that its ledger records."""
    copy = root / FOLDER / name
    return get_robot(str(copy) if copy.is_dir() else name)
