"""Which robots a run sends out, and which controllers drive each of them."""

from __future__ import annotations

from collections.abc import Iterable

from ..collectors.controllers import CONTROLLERS, get_controller
from ..collectors.robots import ROBOTS, RobotSpec, get_robot
from ..formats.errors import InputError

ALL = "all"


def chosen_robots(text: str) -> list[RobotSpec]:
    """The robots that `ROBOT=<text>` means: a name, names with commas, or `all` with a body.

    A bodyless agent is no robot: it takes part only when it is named, also beside `all`.

    Raises:
        InputError: an unknown name, or none at all.
    """
    bodies = [name for name, robot in ROBOTS.items() if robot.joints]
    return [get_robot(name) for name in _names("ROBOT", text, bodies)]


def crews(robots: Iterable[RobotSpec], text: str) -> list[tuple[str, str]]:
    """Every robot with each controller of `CONTROLLER=<text>` that can drive it, by name.

    `text` is a name, names with commas, or `all`. What has no joints cannot be driven, only placed.

    Raises:
        InputError: an unknown name, or a robot that none of the controllers can drive.
    """
    names = _names("CONTROLLER", text, CONTROLLERS)
    entries = {name: get_controller(name) for name in names}
    result = []
    for robot in robots:
        able = [n for n, entry in entries.items() if entry.teleports or robot.joints]
        if not able:
            valid = ", ".join(n for n, entry in CONTROLLERS.items() if entry.teleports)
            raise InputError(
                f"CONTROLLER={text}: {robot.name} has no joints to drive; valid for it: {valid}"
            )
        result += [(robot.name, name) for name in able]
    return result


def _names(variable: str, text: str, everything: Iterable[str]) -> list[str]:
    """The comma-separated names in `text`, each once, `all` spelled out."""
    given = [part.strip() for part in text.split(",")]
    if not all(given):
        raise InputError(f"{variable}={text}: an empty name; valid: a name, or a,b,c, or {ALL}")
    spelled = [name for part in given for name in (everything if part == ALL else (part,))]
    return list(dict.fromkeys(spelled))
