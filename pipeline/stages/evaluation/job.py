"""Let a policy walk one episode in closed loop."""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from ....evaluation.episode import evaluate_episode
from ....evaluation.guided import labelled_walk
from ....evaluation.observation import Eye
from ....evaluation.policies.names import ORACLE
from ....evaluation.policies.registry import PolicyChoice
from ....evaluation.policy import Policy
from ....formats.core.episode import Episode
from ....rendering.camera.views import View
from ...engine.work import ItemResult
from ..rollouts.replay_job import Walker, open_level, store
from ..scenes.renderer import scene_renderer


@dataclass(frozen=True)
class EvaluateJob:
    """Let a policy walk one episode and record it.

    Attributes:
        models: folder where compiled models are kept.
        expert_share: let the expert take this share of the actions and label all of them; None
            lets the policy walk alone.
    """

    scene: Path
    episode: Episode
    walker: Walker
    policy: PolicyChoice
    view: View
    actions: str
    models: Path
    out: Path
    expert_share: float | None = None

    def run(self) -> ItemResult:
        """Evaluate one episode.

        Raises:
            PolicyError: the policy failed, or what it answered is no action.
            DivergedError: physics exploded.
        """
        world, config = (
            open_level(self.scene, self.episode, self.walker, self.models),
            self.walker.config,
        )
        policy: Policy | None = None
        eye: Eye | None = None
        if self.policy.name != ORACLE:
            policy = _policy(self.policy, config.seed)
            if not policy.blind:
                _, renderer = scene_renderer(self.scene, self.view.renderer, self.view.light)
                eye = Eye(world, self.view, renderer)
        if self.expert_share is None:
            rollout = evaluate_episode(world, self.episode, config, policy, eye, kind=self.actions)
        else:
            assert policy is not None  # the oracle is the expert itself
            rollout = labelled_walk(
                world,
                self.episode,
                config,
                policy,
                eye,
                expert_share=self.expert_share,
                rng=np.random.default_rng([config.seed, *self.episode.episode_id.encode()]),
            )
        rollout = replace(rollout, facts={**rollout.facts, "policy": self.policy.name})
        result = store(rollout, self.scene.name, config, self.out)
        more = {
            "policy": self.policy.name,
            "split": self.episode.split,
            "trajectory": self.episode.trajectory_id,
            "instruction": self.episode.instruction,
            "taken": [int(span.action) for span in rollout.actions],
        }
        for count in ("unclear", "left_out"):
            if hasattr(policy, count):
                more[count] = getattr(policy, count)
        # Whatever the policy does is a result: missing the goal is no failure of the item.
        return replace(result, facts={**result.facts, **more}, failed=False)


@lru_cache(maxsize=1)
def _policy(policy: PolicyChoice, seed: int) -> Policy:
    """Return a policy; a worker keeps it, with the connection to its server."""
    return policy.make(seed)
