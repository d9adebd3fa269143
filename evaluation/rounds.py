"""Many episodes under one policy in this process: for the validation of a training."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..collectors.rendering.camera.views import View
from ..collectors.rendering.registry import make_renderer
from ..collectors.replay import ReplayConfig
from ..collectors.robots import get_robot
from ..collectors.world import open_world
from ..formats.core.episode import Episode
from ..formats.core.rollout import Rollout
from ..formats.scene.bundle import load_bundle
from .episode import closed_loop, evaluate_episode
from .observation import Eye
from .policy import Policy


@dataclass(frozen=True)
class Round:
    """Episodes, and what walks them.

    Attributes:
        episodes: of any scenes and levels.
        scenes: folder of the repaired scenes.
        view: the policy's camera.
        config: robot, controller, and how.
    """

    episodes: tuple[Episode, ...]
    scenes: Path
    view: View
    config: ReplayConfig

    def walk(self, policy: Policy) -> Iterator[Rollout]:
        """Yield the rollout of every episode, scene by scene.

        Raises:
            PolicyError: the policy failed.
            FileFormatError: a scene is missing or damaged.
        """
        config = closed_loop(self.config)
        for scene, level in sorted({(e.scene_id, e.level) for e in self.episodes}):
            bundle = load_bundle(self.scenes / scene)
            world = open_world(bundle, level, get_robot(config.robot), None, config.physics, None)
            renderer = make_renderer(bundle, self.view.renderer, light=self.view.light)
            eye = Eye(world, self.view, renderer)
            for episode in self.episodes:
                if (episode.scene_id, episode.level) == (scene, level):
                    yield evaluate_episode(world, episode, config, policy, eye)


def spread(episodes: Sequence[Episode], count: int) -> tuple[Episode, ...]:
    """Return up to `count` episodes, evenly spread over all of them."""
    count = min(count, len(episodes))
    chosen = np.linspace(0, len(episodes) - 1, count).round().astype(int)
    return tuple(episodes[k] for k in dict.fromkeys(chosen.tolist()))
