"""Every robot by name."""

from __future__ import annotations

from ...formats.errors import UnknownNameError
from .aliengo import ALIENGO
from .spec import RobotSpec

ROBOTS: dict[str, RobotSpec] = {robot.name: robot for robot in (ALIENGO,)}


def get_robot(name: str) -> RobotSpec:
    """The robot called `name`.

    Raises:
        UnknownNameError: there is none; the message lists the valid names.
    """
    if name not in ROBOTS:
        raise UnknownNameError("robot", name, ROBOTS)
    return ROBOTS[name]
