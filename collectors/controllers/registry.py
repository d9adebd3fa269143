"""Every controller by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ...formats.errors import UnknownNameError
from .flash import FlashConfig, FlashController
from .interface import Controller, Task, Teleporter
from .path import PathConfig, PathController
from .speed import SpeedConfig, SpeedController


@dataclass(frozen=True)
class ControllerEntry:
    """One controller.

    Attributes:
        title: what it is, in a few words.
        config: its configuration's class; the defaults are its own.
        build: makes one for an episode.
        teleports: it places the robot instead of driving it; there is no physics then.
    """

    title: str
    config: type
    build: Callable[[Task, Any], Controller | Teleporter]
    teleports: bool = False


CONTROLLERS: dict[str, ControllerEntry] = {
    "path": ControllerEntry("move along the planned path", PathConfig, PathController),
    "speed": ControllerEntry("discrete actions by velocity", SpeedConfig, SpeedController),
    "flash": ControllerEntry("jump from pose to pose", FlashConfig, FlashController, True),
}


def get_controller(name: str) -> ControllerEntry:
    """The controller called `name`.

    Raises:
        UnknownNameError: there is none; the message lists the valid names.
    """
    if name not in CONTROLLERS:
        raise UnknownNameError("controller", name, CONTROLLERS)
    return CONTROLLERS[name]
