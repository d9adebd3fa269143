"""Every robot by name."""

from __future__ import annotations

from collections.abc import Callable

from ...formats.errors import InputError, UnknownNameError
from .aliengo import ALIENGO
from .g1 import G1
from .h1 import H1
from .jetbot import JETBOT, jetbot
from .spec import RobotSpec
from .vlnce import VLNCE

ROBOTS: dict[str, RobotSpec] = {robot.name: robot for robot in (H1, G1, ALIENGO, JETBOT, VLNCE)}
# Robots of any size: `<name>@<scale>`.
SCALABLE: dict[str, Callable[[float], RobotSpec]] = {"jetbot": jetbot}


def get_robot(name: str) -> RobotSpec:
    """The robot called `name`: one of the registry, or `jetbot@2.5` for another size.

    Raises:
        UnknownNameError: there is none; the message lists the valid names.
        InputError: a scale that is no number above 0.
    """
    if name in ROBOTS:
        return ROBOTS[name]
    kind, at, scale = name.partition("@")
    if not at or kind not in SCALABLE:
        raise UnknownNameError("robot", name, valid_names())
    try:
        return SCALABLE[kind](float(scale))
    except ValueError as error:
        raise InputError(f"robot {name!r}: {scale!r} is no number; valid: {kind}@2.5") from error


def valid_names() -> list[str]:
    """What a user may say, for messages."""
    return [*ROBOTS, *(f"{name}@<scale>" for name in SCALABLE)]
