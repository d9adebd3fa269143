"""What is true of a path: its actions, rooms and landmarks as the robot's camera sees them."""

from .build import path_facts
from .level import LevelFacts
from .records import LandmarkFact, PathFacts

__all__ = ["LandmarkFact", "LevelFacts", "PathFacts", "path_facts"]
