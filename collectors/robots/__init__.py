"""Robots: published facts, MJCF models built from primitive shapes, and their registry."""

from .folder.load import CARD_NAME, POLICY_NAME
from .handles import RobotHandles
from .parts import CameraMount, CommandLimits, FallThresholds, Foot, JointFacts
from .registry import ROBOTS, get_robot
from .spec import POLICY_DECIMATION, TIMESTEP_S, RobotSpec, apply_physics_options

__all__ = [
    "CARD_NAME",
    "POLICY_DECIMATION",
    "POLICY_NAME",
    "ROBOTS",
    "TIMESTEP_S",
    "CameraMount",
    "CommandLimits",
    "FallThresholds",
    "Foot",
    "JointFacts",
    "RobotHandles",
    "RobotSpec",
    "apply_physics_options",
    "get_robot",
]
