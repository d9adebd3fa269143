"""Policies without a model: hand-made ones, against which others are compared."""

from hashlib import sha256

import numpy as np

from ...formats.core.rollout import Action
from ..observation import Observation
from ..policy import Assignment


class Stop:
    """Stops at once: what standing still is worth."""

    blind = True

    def reset(self, assignment: Assignment) -> None:
        """See `Policy.reset`."""

    def act(self, observation: Observation) -> Action:
        """See `Policy.act`."""
        return Action.STOP


class Forward:
    """Walks straight ahead for `steps` actions, then stops; 37 in VLN-CE's hand-crafted agent."""

    blind = True

    def __init__(self, steps: int = 37) -> None:
        self._steps = steps

    def reset(self, assignment: Assignment) -> None:
        """See `Policy.reset`."""

    def act(self, observation: Observation) -> Action:
        """See `Policy.act`."""
        return Action.FORWARD if observation.step < self._steps else Action.STOP


class Random:
    """Draws actions in the proportions of R2R's training paths in VLN-CE.

    68 % FORWARD, 15 % LEFT, 15 % RIGHT, 2 % STOP: Krantz et al., "Beyond the Nav-Graph", ECCV 2020.
    """

    blind = True
    actions = (Action.FORWARD, Action.LEFT, Action.RIGHT, Action.STOP)
    proportions = (0.68, 0.15, 0.15, 0.02)

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed
        self._rng = np.random.default_rng(seed)

    def reset(self, assignment: Assignment) -> None:
        """Draw as the seed and the episode's id say, whatever ran before."""
        text = f"{self._seed}/{assignment.scene_id}/{assignment.episode_id}".encode()
        self._rng = np.random.default_rng(np.frombuffer(sha256(text).digest(), dtype=np.uint32))

    def act(self, observation: Observation) -> Action:
        """See `Policy.act`."""
        return self.actions[self._rng.choice(len(self.actions), p=self.proportions)]
