"""Controllers, which drive a robot along an episode, and their registry."""

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
from .steered import Motion, SteeredController, Steerer, Velocity, Waypoints

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
    "Motion",
    "PathConfig",
    "Pose",
    "SpeedConfig",
    "SteeredController",
    "Steerer",
    "Task",
    "Teleporter",
    "Velocity",
    "Waypoints",
    "controller_for",
    "get_controller",
    "valid_controllers",
]
