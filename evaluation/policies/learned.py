"""Learned policies: a checkpoint of `vlnpe train` in closed loop."""

from pathlib import Path

from ...formats.core.rollout import Action
from ...learning.checkpoint import Checkpoint, load_checkpoint
from ...learning.stepper import LIKELIEST, Choice, Sight, Stepper
from ..motions import DISCRETE
from ..observation import Observation
from ..policy import Assignment, PolicyError


class LearnedPolicy:
    """Lets a trained model choose the actions."""

    def __init__(self, checkpoint: Checkpoint, choice: Choice = LIKELIEST) -> None:
        """Get ready."""
        self.blind = not {"rgb", "depth"} & set(checkpoint.card.config.model.inputs)
        self._stepper = Stepper(checkpoint, choice)
        self.reads_px = self._stepper.reads_px

    @classmethod
    def load(cls, path: Path, choice: Choice = LIKELIEST) -> "LearnedPolicy":
        """Return the policy of a checkpoint.

        Raises:
            FileFormatError: it is damaged.
        """
        return cls(load_checkpoint(path), choice)

    def reset(self, assignment: Assignment) -> None:
        """See `Policy.reset`."""
        if assignment.actions != DISCRETE:
            raise PolicyError(f"actions {assignment.actions}; a learned policy has: {DISCRETE}")
        name = f"{assignment.scene_id}/{assignment.episode_id}"
        self._stepper.begin(assignment.instruction, name)

    def act(self, observation: Observation) -> Action:
        """See `Policy.act`."""
        previous = observation.previous_action
        assert isinstance(previous, int)  # of discrete actions, which `reset` demands
        return self._stepper.act(
            Sight(observation.rgb, observation.depth_m, previous, observation.pose)
        )
