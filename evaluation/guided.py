"""A policy walks, and an expert says at every step what it would have done (DAgger)."""

from dataclasses import dataclass, replace
from operator import is_

import numpy as np

from ..collectors.controllers import Expert, Pose
from ..collectors.controllers.interface import Task
from ..collectors.replay.replay import ReplayConfig, replay_in
from ..collectors.replay.world import World
from ..formats.core.episode import Episode
from ..formats.core.rollout import DAGGER, Action, Rollout
from .episode import PolicyChooser
from .observation import Eye, Observation, checked_action
from .policy import Assignment, Policy


class Mixture:
    """Takes the expert's action or the policy's, and keeps what was seen, advised and done.

    Attributes:
        seen: observations, if images are kept.
        advice: the expert's action at every step.
        executed: the action that was taken.
        left_m: the length of the expert's route [m].
    """

    def __init__(
        self,
        policy: Policy | None,
        expert_share: float,
        rng: np.random.Generator,
        *,
        keep_images: bool = True,
        stop_with_expert: bool = False,
    ):
        self._policy, self._share, self._rng = policy, expert_share, rng
        self._keep_images, self._stop_with_expert = keep_images, stop_with_expert
        self.blind = policy is not None and policy.blind
        self.wants_lens = getattr(policy, "wants_lens", False)
        self.wants_labels = getattr(policy, "wants_labels", False)
        self.seen: list[Observation] = []
        self.advice: list[Action] = []
        self.executed: list[Action] = []
        self.left_m: list[float] = []

    def reset(self, assignment: Assignment) -> None:
        """See `Policy.reset`."""
        if self._policy is not None:
            self._policy.reset(assignment)

    def act(self, observation: Observation) -> Action:
        """See `Policy.act`; the expert's advice is the last of `advice`."""
        action = advice = self.advice[-1]
        if self._policy is not None:
            action = checked_action(self._policy.act(observation))
            # A model that stops early ends its walk, and all that could be learned behind it.
            early = action is Action.STOP and advice is not Action.STOP
            late = self._stop_with_expert and advice is Action.STOP
            if early or late or self._rng.random() < self._share:
                action = advice
        if self._keep_images:
            self.seen.append(observation)
        self.executed.append(action)
        return action


@dataclass(frozen=True)
class _Corrected:
    """Asks the expert at every pose, and then the mixture."""

    chooser: PolicyChooser
    expert: Expert
    mixed: Mixture

    def next_action(self, pose: Pose, rest: Pose | None = None) -> Action:
        self.mixed.advice.append(self.expert.next_action(pose, rest))
        self.mixed.left_m.append(self.expert.remaining_m)
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
    # In data, STOP is the last action and no other.
    walk = Mixture(policy, expert_share, rng, keep_images=False, stop_with_expert=True)
    rollout = guided_walk(world, episode, config, eye, walk)
    agreed = sum(map(is_, walk.executed, walk.advice))
    facts = {"expert_share": expert_share, "agreed": agreed, "actions": len(walk.advice)}
    return replace(
        rollout,
        controller=DAGGER,
        labels=tuple(walk.advice),
        facts={**rollout.facts, "dagger": facts},
    )


def guided_walk(
    world: World, episode: Episode, config: ReplayConfig, eye: Eye | None, walk: Mixture
) -> Rollout:
    """Let a mixture of policy and expert walk an episode."""
    assignment = Assignment.of(episode, world.robot.name, config.controller)
    walk.reset(assignment)

    def choose(task: Task) -> _Corrected:
        return _Corrected(PolicyChooser(world, assignment, walk, eye), Expert(task), walk)

    return replay_in(world, episode, config, choose)
