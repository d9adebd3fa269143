"""Walk many episodes under one policy in this process, to validate a model in training."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..collectors.replay.replay import ReplayConfig
from ..collectors.replay.world import open_world
from ..collectors.robots import get_robot
from ..formats.core.episode import Episode
from ..formats.core.rollout import Rollout
from ..formats.scene.bundle import load_bundle
from ..rendering.camera.views import View
from ..rendering.registry import make_renderer, scene_renderer_name
from .episode import closed_loop, evaluate_episode
from .observation import Eye
from .policy import Policy


@dataclass(frozen=True)
class Round:
    """Episodes, and the robot and camera that walk them."""

    episodes: tuple[Episode, ...]
    scenes: Path
    view: View
    config: ReplayConfig

    def walk(self, policy: Policy) -> Iterator[Rollout]:
        """Yield the rollout of every episode, one scene after another.

        Raises:
            PolicyError: the policy failed.
            InputError: an episode takes more than one staircase.
            FileFormatError: a scene is missing or damaged.
        """
        config, groups = closed_loop(self.config), dict[tuple[object, ...], list[Episode]]()
        for episode in self.episodes:
            groups.setdefault(episode.world, []).append(episode)
        for first, *others in groups.values():
            folder = self.scenes / first.scene_id
            bundle, physics = load_bundle(folder), config.physics.for_episode(first)
            robot = get_robot(config.robot)
            world = open_world(bundle, first.level, robot, None, physics, None, first.staircase)
            name = scene_renderer_name(folder, self.view.renderer)
            view = replace(self.view, renderer=name)
            eye = Eye(world, view, make_renderer(bundle, name, light=view.light))
            for episode in (first, *others):
                yield evaluate_episode(world, episode, config, policy, eye)


def spread(episodes: Sequence[Episode], count: int) -> tuple[Episode, ...]:
    """Return up to `count` episodes, evenly spread over all of them."""
    count = min(count, len(episodes))
    chosen = np.linspace(0, len(episodes) - 1, count).round().astype(int)
    return tuple(episodes[k] for k in dict.fromkeys(chosen.tolist()))
