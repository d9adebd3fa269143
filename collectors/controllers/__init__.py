"""What drives a robot along an episode: one registry of controllers."""

from .expert import Expert, ExpertConfig
from .flash import FlashConfig
from .interface import (
    STOPPED,
    Chooser,
    Coasting,
    Controller,
    Decision,
    Jump,
    Pose,
    Task,
    Teleporter,
)
from .path import PathConfig
from .registry import (
    CONTROLLERS,
    ControllerEntry,
    controller_for,
    get_controller,
    valid_controllers,
)
from .speed import SpeedConfig

__all__ = [
    "CONTROLLERS",
    "STOPPED",
    "Chooser",
    "Coasting",
    "Controller",
    "ControllerEntry",
    "Decision",
    "Expert",
    "ExpertConfig",
    "FlashConfig",
    "Jump",
    "PathConfig",
    "Pose",
    "SpeedConfig",
    "Task",
    "Teleporter",
    "controller_for",
    "get_controller",
    "valid_controllers",
]
