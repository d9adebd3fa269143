"""Folders of a user's robot: the documented rover, and exports of ours."""

import shutil
from collections.abc import Callable
from pathlib import Path

from vlnpe.collectors.locomotion.runtime.policy import policy_files
from vlnpe.collectors.robots import get_robot
from vlnpe.collectors.robots.folder.export import export_robot

ROVER = Path(__file__).resolve().parents[2] / "examples" / "rover"


def written_rover(folder: Path) -> Path:
    """The rover of the examples, as its reader would copy it."""
    return Path(shutil.copytree(ROVER, folder))


def exported(name: str, folder: Path) -> Path:
    robot = get_robot(name)
    export_robot(robot, folder, policy_files(robot) if robot.policy_joints else None)
    return folder


def edit(name: str, old: str, new: str) -> Callable[[Path], None]:
    """Replace text in a file of the folder, which must have it."""

    def spoil(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new))

    return spoil


TOML, XML = "robot.toml", "model.xml"
