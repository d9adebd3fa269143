"""A policy walks, and an expert says at every step what it would have done (DAgger; Ross, 2011)."""

from dataclasses import dataclass, replace
from operator import is_

import numpy as np

from ..collectors.controllers import Chooser, Pose, expert_for
from ..collectors.controllers.interface import Task
from ..collectors.replay.replay import ReplayConfig, replay_in
from ..collectors.replay.world import World
from ..formats.core.episode import Episode
from ..formats.core.rollout import DAGGER, Action, Rollout
from .episode import PolicyChooser
from .observation import Eye, Observation, checked_action
from .policy import Assignment, Policy


class _Mixture:
    """Policy that takes the expert's action or another policy's.

    Attributes:
        advice: the expert's action at every step.
        executed: the action that was taken.
    """

    def __init__(self, policy: Policy, expert_share: float, rng: np.random.Generator):
        self._policy, self._share, self._rng = policy, expert_share, rng
        self.blind = policy.blind
        self.wants_lens = getattr(policy, "wants_lens", False)
        self.wants_labels = getattr(policy, "wants_labels", False)
        self.reads_px = getattr(policy, "reads_px", None)
        self.advice: list[Action] = []
        self.executed: list[Action] = []

    def reset(self, assignment: Assignment) -> None:
        """See `Policy.reset`."""
        self._policy.reset(assignment)

    def act(self, observation: Observation) -> Action:
        """See `Policy.act`; the expert's advice is the last of `advice`."""
        advice = self.advice[-1]
        action = checked_action(self._policy.act(observation))
        # In data, STOP is the last action and no other; a walk that stops early teaches nothing of
        # what lies behind.
        if Action.STOP in (action, advice) or self._rng.random() < self._share:
            action = advice
        self.executed.append(action)
        return action


@dataclass(frozen=True)
class _Advised:
    """Asks the expert at every pose, and then the mixture."""

    chooser: PolicyChooser
    expert: Chooser
    mixture: _Mixture

    def next_action(self, pose: Pose, rest: Pose | None = None) -> Action:
        self.mixture.advice.append(self.expert.next_action(pose, rest))
        return self.chooser.next_action(pose, rest)

    def notes(self) -> list[tuple[str, str]]:
        return self.expert.notes()


def labelled_walk(
    world: World,
    episode: Episode,
    config: ReplayConfig,
    policy: Policy,
    eye: Eye | None,
    *,
    expert_share: float,
    rng: np.random.Generator,
) -> Rollout:
    """Let a policy and the expert share an episode; return the walk with the expert's actions.

    The walk's `actions` are those that were taken, its `labels` the expert's at each of them. It
    ends at the latest where the expert stops. A policy that stops earlier is overruled.

    Args:
        config: robot, controller and further settings; see `closed_loop`.
        eye: the robot's camera; None for a blind policy.
        expert_share: probability that an action is the expert's, β.

    Raises:
        PolicyError: the policy failed.
    """
    assignment = Assignment.of(episode, world.robot.name, config.controller)
    mixture = _Mixture(policy, expert_share, rng)
    mixture.reset(assignment)

    def choose(task: Task) -> _Advised:
        return _Advised(PolicyChooser(world, assignment, mixture, eye), expert_for(task), mixture)

    rollout = replay_in(world, episode, config, choose)
    agreed = sum(map(is_, mixture.executed, mixture.advice))
    facts = {"expert_share": expert_share, "agreed": agreed, "actions": len(mixture.advice)}
    return replace(
        rollout,
        controller=DAGGER,
        labels=tuple(mixture.advice),
        facts={**rollout.facts, "dagger": facts},
    )
