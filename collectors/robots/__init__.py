"""Robots: published facts, MJCF models built from primitive shapes, and their registry."""

from .folder.load import CARD_NAME, NETWORK_NAMES
from .handles import RobotHandles
from .parts import CameraMount, CommandLimits, FallThresholds, Foot, JointFacts
from .registry import ROBOTS, get_robot
from .spec import POLICY_DECIMATION, TIMESTEP_S, RobotSpec, apply_physics_options

__all__ = [
    "CARD_NAME",
    "NETWORK_NAMES",
    "POLICY_DECIMATION",
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
