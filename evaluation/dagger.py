"""Walks of DAgger with what a model saw, for training; without a model the expert walks alone."""

import numpy as np

from ..collectors.replay.replay import ReplayConfig
from ..collectors.replay.world import World
from ..formats.core.episode import Episode
from ..formats.core.errors import InputError
from ..formats.core.rollout import EndReason
from ..learning.checkpoint import Checkpoint
from ..learning.images import depth_input, rgb_input
from ..learning.training.corrections import Correction
from .guided import Mixture, guided_walk
from .observation import Eye
from .policies.learned import LearnedPolicy


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
    walk = Mixture(LearnedPolicy(checkpoint), expert_share, rng)
    guided_walk(world, episode, config, eye, walk)
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
    walk = Mixture(None, 1.0, np.random.default_rng(0))
    rollout = guided_walk(world, episode, config, eye, walk)
    if rollout.end_reason is not EndReason.SUCCESS:
        return None
    return _correction(walk, world, episode, size_px, depth_far_m)


def _correction(
    walk: Mixture, world: World, episode: Episode, size_px: int, depth_far_m: float
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
