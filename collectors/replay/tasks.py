"""What an episode asks of a controller."""

from dataclasses import replace

from ...formats.core.episode import Episode
from ...wayfinding.legs import legs_of
from ..controllers import Coasting, Task
from .config import ReplayConfig
from .world import World


def task_of(world: World, episode: Episode, config: ReplayConfig, coasting: Coasting) -> Task:
    """Return the task of an episode; over storeys, with a leg for each level and staircase.

    Raises:
        InputError: see `legs_of`.
    """
    robot = world.robot
    task = Task(
        reference_xy_m=episode.reference_path_world_m[:, :2],
        goal_xy_m=episode.goal_position_world_m[:2],
        freemap=world.freemap,
        radius_m=robot.footprint_radius_m,
        limits=robot.command_limits,
        goal_tolerance_m=config.outcome.success_m,
        coasting=coasting,
    )
    if not episode.staircases:
        return task
    legs = legs_of(world.bundle, episode)
    return replace(
        task,
        legs=tuple(
            replace(
                task,
                reference_xy_m=leg.xy_m,
                goal_xy_m=leg.xy_m[-1],
                freemap=leg.sheet,
                is_stairs=leg.is_stairs,
                passes_on=leg is not legs[-1],
            )
            for leg in legs
        ),
    )
