"""One MuJoCo model per scene level and robot."""

from .config import LevelModelConfig
from .floor_surface import FloorSurface
from .level_model import build_level_model, free_height, level_model
from .obstacle_boxes import robot_obstacles
from .obstacle_gate import ObstacleGate

__all__ = [
    "FloorSurface",
    "LevelModelConfig",
    "ObstacleGate",
    "build_level_model",
    "free_height",
    "level_model",
    "robot_obstacles",
]
