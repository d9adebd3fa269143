"""One MuJoCo model per scene level and robot."""

from .floor_surface import FloorSurface
from .level_model import LevelModelConfig, build_level_model, level_model
from .obstacle_boxes import robot_obstacles

__all__ = [
    "FloorSurface",
    "LevelModelConfig",
    "build_level_model",
    "level_model",
    "robot_obstacles",
]
