"""Every controller by name."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ...formats.core.errors import InputError, check_name
from ..robots import RobotSpec
from .flash import FlashConfig, FlashController
from .interface import Controller, Task, Teleporter
from .legs import path_controller
from .path import PathConfig
from .speed import SpeedConfig, SpeedController


@dataclass(frozen=True)
class ControllerEntry:
    """Registry entry of a controller.

    Attributes:
        build: creates one for an episode.
        teleports: places the robot, without physics.
        discrete: carries out discrete actions that a `Chooser` chooses.
    """

    title: str
    config: type
    build: Callable[[Task, Any], Controller | Teleporter]
    teleports: bool = False
    discrete: bool = False


CONTROLLERS: dict[str, ControllerEntry] = {
    "path": ControllerEntry("move along the planned path", PathConfig, path_controller),
    "speed": ControllerEntry(
        "discrete actions by velocity",
        SpeedConfig,
        SpeedController,
        discrete=True,
    ),
    "flash": ControllerEntry(
        "jump from pose to pose", FlashConfig, FlashController, teleports=True, discrete=True
    ),
}


def valid_controllers(robot: RobotSpec) -> list[str]:
    """Return the names of the controllers that can move `robot`."""
    return [name for name, entry in CONTROLLERS.items() if entry.teleports or robot.joints]


def controller_for(robot: RobotSpec, name: str) -> ControllerEntry:
    """Return the controller called `name`, which must be able to move `robot`.

    Raises:
        UnknownNameError: there is none of that name.
        InputError: it drives, and the robot has no joints to drive.
    """
    entry, valid = get_controller(name), valid_controllers(robot)
    if name not in valid:
        raise InputError(
            f"controller {name!r}: {robot.name} has no joints to drive; valid for it: "
            f"{', '.join(valid)}"
        )
    return entry


def get_controller(name: str) -> ControllerEntry:
    """Return the controller called `name`.

    Raises:
        UnknownNameError: there is none; the message lists the valid names.
    """
    check_name("controller", name, CONTROLLERS)
    return CONTROLLERS[name]
