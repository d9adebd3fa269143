"""Copies of users' own robots beside what they did, so that it can be rendered anywhere, later."""

from __future__ import annotations

import shutil
from pathlib import Path

from ..collectors.robots import RobotSpec
from ..collectors.robots.folder.load import folder_digest
from ..collectors.robots.folder.safety import folder_files
from ..formats.core.atomic import atomic_folder

FOLDER = "robots"


def keep(robot: RobotSpec, root: Path) -> str:
    """Copy a robot that came from a folder to `<root>/robots/<name>`; ours need no copy.

    Returns:
        What `get_robot` finds it by from now on.
    """
    if robot.folder is not None:
        copy = root / FOLDER / robot.name
        if not copy.is_dir() or folder_digest(copy) != robot.content_sha256:
            with atomic_folder(copy) as temporary:
                for path in folder_files(robot.folder):
                    target = temporary / path.relative_to(robot.folder)
                    target.parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(path, target)
    return kept(robot.name, root)


def kept(name: str, root: Path) -> str:
    """What `get_robot` finds the robot `name` of a run by: its copy, or its own name."""
    copy = root / FOLDER / name
    return str(copy) if copy.is_dir() else name
