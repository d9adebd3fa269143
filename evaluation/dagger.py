"""DAgger: a policy walks, an expert says at every step what it would have done.

Without a policy the expert walks alone, which gives further walks to train on.
"""

from dataclasses import dataclass

import numpy as np

from ..collectors.controllers import Expert, Pose
from ..collectors.controllers.interface import Task
from ..collectors.replay.replay import ReplayConfig, replay_in
from ..collectors.replay.world import World
from ..formats.core.episode import Episode
from ..formats.core.errors import InputError
from ..formats.core.rollout import Action, EndReason, Rollout
from ..learning.checkpoint import Checkpoint
from ..learning.images import depth_input, rgb_input
from ..learning.training.corrections import Correction
from .episode import PolicyChooser
from .learned import LearnedPolicy
from .observation import Eye, Observation
from .policy import Assignment


class _Mixed:
    """Takes the expert's action or the model's, and keeps what was seen, advised and done."""

    blind = False

    def __init__(self, policy: LearnedPolicy | None, expert_share: float, rng: np.random.Generator):
        self._policy, self._share, self._rng = policy, expert_share, rng
        self.seen: list[Observation] = []
        self.advice: list[Action] = []
        self.executed: list[Action] = []
        self.left_m: list[float] = []

    def reset(self, assignment: Assignment) -> None:
        if self._policy is not None:
            self._policy.reset(assignment)

    def act(self, observation: Observation) -> Action:
        action = advice = self.advice[-1]
        if self._policy is not None:
            action = self._policy.act(observation)
            # A model that stops early ends its walk, and all that could be learned behind it.
            early = action is Action.STOP and advice is not Action.STOP
            if early or self._rng.random() < self._share:
                action = advice
        self.seen.append(observation)
        self.executed.append(action)
        return action


@dataclass(frozen=True)
class _Corrected:
    """Asks the expert at every pose, and then the mixture."""

    chooser: PolicyChooser
    expert: Expert
    mixed: _Mixed

    def next_action(self, pose: Pose, rest: Pose | None = None) -> Action:
        self.mixed.advice.append(self.expert.next_action(pose, rest))
        self.mixed.left_m.append(self.expert.remaining_m)
        return self.chooser.next_action(pose, rest)

    def notes(self) -> list[tuple[str, str]]:
        return self.expert.notes()


def corrected_walk(
    world: World,
    episode: Episode,
    config: ReplayConfig,
    checkpoint: Checkpoint,
    eye: Eye,
    *,
    expert_share: float,
    rng: np.random.Generator,
) -> Correction:
    """Let a checkpoint's model walk an episode and return the walk with the expert's answers.

    Args:
        config: robot, controller and further settings; see `closed_loop`.
        expert_share: probability that a step is the expert's, β.

    Raises:
        PolicyError: the model failed.
        InputError: the robot stands in an obstacle at the episode's start.
    """
    walk = _Mixed(LearnedPolicy(checkpoint), expert_share, rng)
    _walk(world, episode, config, eye, walk)
    if not walk.executed:
        raise InputError(f"episode {episode.episode_id} cannot be started")
    card = checkpoint.card
    return _correction(walk, world, episode, card.config.size_px, card.view.depth_far_m)


def expert_walk(
    world: World,
    episode: Episode,
    config: ReplayConfig,
    eye: Eye,
    *,
    size_px: int,
    depth_far_m: float,
) -> Correction | None:
    """Let the expert walk an episode; return the walk, or None if it does not end at the goal.

    A robot that stands in an obstacle at the start does not.

    Args:
        config: robot, controller and further settings; see `closed_loop`.
        size_px: width and height of the images kept.
        depth_far_m: greatest depth kept [m].
    """
    walk = _Mixed(None, 1.0, np.random.default_rng(0))
    rollout = _walk(world, episode, config, eye, walk)
    if rollout.end_reason is not EndReason.SUCCESS:
        return None
    return _correction(walk, world, episode, size_px, depth_far_m)


def _walk(world: World, episode: Episode, config: ReplayConfig, eye: Eye, walk: _Mixed) -> Rollout:
    assignment = Assignment.of(episode, world.robot.name, config.controller)
    walk.reset(assignment)

    def choose(task: Task) -> _Corrected:
        return _Corrected(PolicyChooser(world, assignment, walk, eye), Expert(task), walk)

    return replay_in(world, episode, config, choose)


def _correction(
    walk: _Mixed, world: World, episode: Episode, size_px: int, depth_far_m: float
) -> Correction:
    left_m = np.array(walk.left_m)
    return Correction(
        rgb=np.stack([rgb_input(o.rgb, size_px).numpy() for o in walk.seen]),
        depth_m=np.stack([depth_input(o.depth_m, size_px, depth_far_m).numpy() for o in walk.seen]),
        action=np.array([int(a) for a in walk.advice], np.int64),
        executed=np.array([int(a) for a in walk.executed], np.int64),
        pose=np.stack([o.pose for o in walk.seen]),
        progress=(1 - left_m / max(left_m.max(), 1e-6)).clip(0, 1).astype(np.float32),
        instruction=episode.instruction,
        name=f"{episode.split}/{episode.scene_id}/{episode.episode_id}",
        robot=world.robot.name,
    )
