"""Replay an episode in physics and record it: one robot, one controller, no pixels.

After spawning, nothing but joint servos moves a robot: no write to qpos or qvel, no external
force, no weld. The one exception is the controller `flash`, which is there to show what that
costs.
"""

import contextlib
import logging
from collections.abc import Callable, Iterator
from pathlib import Path

import mujoco

from ...formats.core.episode import Episode
from ...formats.core.rollout import Rollout
from ...formats.scene.bundle import SceneBundle
from ..controllers import Chooser, SteeredController, Steerer, Task, controller_for
from ..robots import get_robot
from .config import ReplayConfig
from .episode_run import EpisodeRun
from .world import World, open_world

log = logging.getLogger(__name__)

__all__ = ["ReplayConfig", "replay_episode", "replay_in"]


def replay_episode(
    bundle: SceneBundle, episode: Episode, config: ReplayConfig, cache_dir: Path | None = None
) -> Rollout:
    """Open the episode's level with the configured robot and replay the episode in it.

    To replay many episodes of one level, `open_world` once and call `replay_in`.

    Args:
        cache_dir: where compiled models are kept; none are when None.

    Raises:
        UnknownNameError: no such robot or controller.
        InputError: the controller cannot move the robot, nobody climbs the episode's staircase, or
            it takes more than one.
        ValueError: the scene has no such level.
        FileFormatError: the level's or the policy's files are missing or broken.
    """
    robot = get_robot(config.robot)
    controller_for(robot, config.controller)
    physics = config.physics.for_episode(episode)
    world = open_world(bundle, episode.level, robot, None, physics, cache_dir, episode.staircase)
    return replay_in(world, episode, config)


def replay_in(
    world: World,
    episode: Episode,
    config: ReplayConfig,
    choose: Callable[[Task], Chooser] | None = None,
    steer: Callable[[Task], Steerer] | None = None,
) -> Rollout:
    """Replay an episode in an opened world. The same world, episode and config give the same bits.

    Whatever happens to the robot is an outcome, not an error: exploding physics gives a rollout
    that ends as `diverged`, its last state among the facts.

    Args:
        choose: function that returns the chooser of a task's discrete actions; the expert when
            None. It may read `world`: physics does not advance while it chooses.
        steer: function that returns the steerer of a task, whose motions replace the controller's
            own path or actions. It may read `world`, too.

    Raises:
        UnknownNameError: no such controller.
        InputError: the controller cannot move the world's robot, takes no discrete actions
            although `choose` is given, or no motions although `steer` is.
    """
    control = None if steer is None else lambda task: SteeredController(task, steer(task))
    with warnings_logged():
        return EpisodeRun(world, episode, config, choose, control).rollout()


@contextlib.contextmanager
def warnings_logged() -> Iterator[None]:
    """Send MuJoCo's warnings to our log; by itself it writes a file into the working folder."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: log.warning("physics: %s", message))
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
