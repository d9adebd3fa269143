"""How a robot's gait is trained: its clock and its phases, from tables or from its own folder."""

from dataclasses import dataclass, replace
from functools import cache

from ....formats.core.errors import InputError
from ...robots import RobotSpec
from ..runtime.gait import GaitClock
from .config import PHASES, TrainingConfig
from .derived import derived_gait
from .gaits import GAITS

# Robots of one's own are trained as the built-in robot with as many legs.
MODELS = {2: "h1", 4: "aliengo"}


@dataclass(frozen=True)
class Recipe:
    """Clock and reference motion of a gait, and the phases of its training with iterations."""

    gait: GaitClock
    phases: tuple[tuple[TrainingConfig, int], ...]


@cache
def recipe(robot: RobotSpec) -> Recipe:
    """Return how the robot's gait is trained.

    Raises:
        InputError: the robot does not walk, or does not say how it steps.
    """
    if robot.name in GAITS and robot.folder is None:
        return Recipe(GAITS[robot.name], PHASES[robot.name])
    legs = len(robot.feet)
    if not robot.policy_joints or legs not in MODELS:
        raise InputError(
            f"robot {robot.name} has {robot.policy_joints} joints for a policy and {legs} feet; "
            f"valid for training: a robot that walks on {' or '.join(map(str, MODELS))} feet"
        )
    gait = derived_gait(robot)
    assert robot.rhythm is not None
    height_m = robot.rhythm.swing_height_m
    phases = tuple(
        (replace(phase, stand_joint_rad=(), swing_height_m=height_m), count)
        for phase, count in PHASES[MODELS[legs]]
    )
    return Recipe(gait, phases)
