"""Walks of DAgger with what was seen, for training."""

import numpy as np

from ..collectors.replay.replay import ReplayConfig
from ..collectors.replay.world import World
from ..formats.core.episode import Episode
from ..formats.core.rollout import EndReason
from ..learning.images import depth_input, rgb_input
from ..learning.training.corrections import Correction
from .guided import Mixture, guided_walk
from .observation import Eye
from .policy import Policy


def corrected_walk(
    world: World,
    episode: Episode,
    config: ReplayConfig,
    policy: Policy | None,
    eye: Eye,
    *,
    expert_share: float,
    rng: np.random.Generator,
    size_px: int,
    depth_far_m: float,
) -> tuple[EndReason, Correction | None]:
    """Let a policy and the expert share an episode; return its end, and what can be learned.

    The walk is None if the robot stands in an obstacle at the start.

    Args:
        config: robot, controller and further settings; see `closed_loop`.
        policy: None lets the expert walk alone.
        expert_share: probability that a step is the expert's, β.
        size_px: width and height of the images kept.
        depth_far_m: greatest depth kept [m].

    Raises:
        PolicyError: the policy failed.
    """
    walk = Mixture(policy, expert_share, rng)
    end = guided_walk(world, episode, config, eye, walk).end_reason
    if not walk.executed:
        return end, None
    left_m = np.array(walk.left_m)
    return end, Correction(
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
