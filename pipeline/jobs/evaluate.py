"""Let a policy walk one episode in closed loop."""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from ...collectors.rendering.camera.views import View
from ...collectors.replay import ReplayConfig
from ...evaluation.episode import evaluate_episode
from ...evaluation.observation import Eye
from ...evaluation.policy import ORACLE, ModelUse, Policy, make_policy
from ...formats.core.episode import Episode
from ..engine.work import ItemResult
from .render import scene_renderer
from .replay import open_level, store


@dataclass(frozen=True)
class EvaluateJob:
    """Let a policy walk one episode and record it.

    Attributes:
        policy: name, or address of a policy server.
        timeout_s: how long a policy server may take for one action.
        models: folder where compiled models are kept.
    """

    scene: Path
    episode: Episode
    config: ReplayConfig
    policy: str
    timeout_s: float
    view: View
    actions: str
    models: Path
    use: ModelUse
    out: Path

    def run(self) -> ItemResult:
        """Evaluate one episode.

        Raises:
            PolicyError: the policy failed, or what it answered is no action.
            DivergedError: physics exploded.
        """
        world = open_level(self.scene, self.episode, self.config, self.models)
        policy: Policy | None = None
        eye: Eye | None = None
        if self.policy != ORACLE:
            policy = _policy(self.policy, self.config.seed, self.timeout_s, self.use)
            if not policy.blind:
                _, renderer = scene_renderer(self.scene, self.view.renderer, self.view.light)
                eye = Eye(world, self.view, renderer)
        rollout = evaluate_episode(world, self.episode, self.config, policy, eye, kind=self.actions)
        rollout = replace(rollout, facts={**rollout.facts, "policy": self.policy})
        result = store(rollout, self.scene.name, self.config, self.out)
        more = {
            "policy": self.policy,
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
def _policy(name: str, seed: int, timeout_s: float, use: ModelUse) -> Policy:
    """Return a policy; a worker keeps it, with the connection to its server."""
    return make_policy(name, seed, timeout_s, use)
