"""The robots: public facts, own MJCF models of primitive shapes, one registry."""

from .folder.load import CARD_NAME, POLICY_NAME
from .handles import RobotHandles
from .physics import POLICY_DECIMATION, TIMESTEP_S, apply_physics_options
from .registry import ROBOTS, get_robot
from .spec import CameraMount, CommandLimits, FallThresholds, Foot, JointFacts, RobotSpec

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
