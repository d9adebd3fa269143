"""One MuJoCo model per robot and scene level, or staircase with both its levels."""

from .config import LevelModelConfig
from .floor_surface import FloorSurface
from .joined_floor import JoinedFloor
from .level_model import build_level_model, free_height, level_model
from .obstacle_boxes import robot_obstacles
from .obstacle_gate import ObstacleGate
from .storeys_model import build_storeys_model, storeys_model

__all__ = [
    "FloorSurface",
    "JoinedFloor",
    "LevelModelConfig",
    "ObstacleGate",
    "build_level_model",
    "build_storeys_model",
    "free_height",
    "level_model",
    "robot_obstacles",
    "storeys_model",
]
