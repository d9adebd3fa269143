"""Every robot by name."""

from collections.abc import Callable
from pathlib import Path

from ...formats.core.errors import FileFormatError, InputError, UnknownNameError
from .aliengo.robot import ALIENGO
from .folder.facts import FACTS_NAME
from .folder.load import load_robot_folder
from .g1.robot import G1
from .h1.robot import H1
from .jetbot.robot import JETBOT, jetbot
from .spec import RobotSpec
from .vlnce import VLNCE

ROBOTS: dict[str, RobotSpec] = {robot.name: robot for robot in (H1, G1, ALIENGO, JETBOT, VLNCE)}
# Robots that exist at any size, as `<name>@<scale>`.
SCALABLE: dict[str, Callable[[float], RobotSpec]] = {"jetbot": jetbot}
# Robots that are folders like a user's own, by name.
FOLDERS: dict[str, Path] = {"go2": Path(__file__).parent / "go2"}
# Words that mean something else where a robot's name is expected.
RESERVED = frozenset({"all", "models", "robots"})


def get_robot(name: str) -> RobotSpec:
    """Return the robot called `name`.

    Args:
        name: key of `ROBOTS` or `FOLDERS`, `jetbot@2.5` for another size, or the path of a folder
            with a user's own robot.

    Raises:
        UnknownNameError: no such robot; the message lists the valid names.
        FileFormatError: a file in the folder is missing or invalid.
        InputError: the scale is not a number or outside its limits.
    """
    if name in ROBOTS:
        return ROBOTS[name]
    kind, at, scale = name.partition("@")
    if at and kind in SCALABLE:
        try:
            return SCALABLE[kind](float(scale))
        except ValueError as error:
            raise InputError(
                f"robot {name!r}: scale {scale!r} is not a number; valid: e.g. {kind}@2.5"
            ) from error
    folder = FOLDERS.get(name, Path(name))
    if not folder.is_dir():
        raise UnknownNameError("robot", name, valid_names())
    robot = load_robot_folder(folder)
    # A run keeps a copy of a robot that is a folder: `FOLDERS` are not reserved.
    if robot.name in ROBOTS or robot.name in RESERVED:
        raise FileFormatError(
            folder / FACTS_NAME, f"name is {robot.name!r}, which is reserved; choose another"
        )
    return robot


def valid_names() -> list[str]:
    """Return the valid names of robots, for messages."""
    scaled = [f"{name}@<scale>" for name in SCALABLE]
    return [*ROBOTS, *FOLDERS, *scaled, f"a folder with a {FACTS_NAME}"]
