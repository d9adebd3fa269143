"""Controllers, which drive a robot along an episode, and their registry."""

from .expert import Expert, ExpertConfig
from .flash import FlashConfig
from .flight import PACE_M_S, FlightConfig
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
from .legs import expert_for
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
    "PACE_M_S",
    "STOPPED",
    "Chooser",
    "Coasting",
    "Controller",
    "ControllerEntry",
    "Decision",
    "Expert",
    "ExpertConfig",
    "FlashConfig",
    "FlightConfig",
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
    "expert_for",
    "get_controller",
    "valid_controllers",
]
