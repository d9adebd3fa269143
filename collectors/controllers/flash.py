"""Flash: place the robot at the target pose of each action, without physics.

This is how disembodied collection works, and the reference for the cost of embodiment.
"""

import math
from dataclasses import dataclass, field

from ...formats.core.rollout import FORWARD_STEP_M, TURN_STEP_RAD, Action
from .expert import ExpertConfig
from .geometry import wrap_angle
from .interface import Jump, Pose, Task
from .legs import expert_for


@dataclass(frozen=True)
class FlashConfig:
    """Parameters of the controller `flash`.

    Attributes:
        steps_per_action: physics steps that one action stands for in the record; 50 is VLN-PE's.
        refuse_collisions: stay at the last free pose, which ends the episode as stuck, instead of
            jumping into obstacles and flagging each such target.
    """

    steps_per_action: int = 50
    refuse_collisions: bool = False
    expert: ExpertConfig = field(default_factory=ExpertConfig)


class FlashController:
    """See the module; satisfies `Teleporter`."""

    def __init__(self, task: Task, config: FlashConfig) -> None:
        self.config = config
        self._chooser = task.chooser or expert_for(task, config.expert)

    def jump(self, pose: Pose) -> Jump:
        """See `Teleporter.jump`."""
        action = self._chooser.next_action(pose)
        if action is Action.FORWARD:
            x = pose.x_m + FORWARD_STEP_M * math.cos(pose.yaw_rad)
            y = pose.y_m + FORWARD_STEP_M * math.sin(pose.yaw_rad)
            return Jump(action, Pose(x, y, pose.yaw_rad))
        turn = {Action.LEFT: TURN_STEP_RAD, Action.RIGHT: -TURN_STEP_RAD, Action.STOP: 0.0}[action]
        return Jump(action, Pose(pose.x_m, pose.y_m, wrap_angle(pose.yaw_rad + turn)))
