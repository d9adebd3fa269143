"""What an episode asks of a controller."""

from dataclasses import replace

from ...formats.core.episode import Episode
from ...formats.core.errors import InputError
from ...wayfinding.legs import legs_of
from ..controllers import CONTROLLERS, Coasting, Task, controller_for
from ..controllers.registry import ControllerEntry
from .config import ReplayConfig
from .world import World


def entry_of(world: World, config: ReplayConfig, chooses: bool, controls: bool) -> ControllerEntry:
    """Return the controller's entry, for a caller that chooses actions, or that commands.

    Raises:
        InputError: the controller does not take that.
    """
    entry = controller_for(world.robot, config.controller)
    if chooses and not entry.discrete:
        valid = ", ".join(name for name, other in CONTROLLERS.items() if other.discrete)
        raise InputError(
            f"controller {config.controller!r} takes no discrete actions; valid: {valid}"
        )
    if controls and entry.teleports:
        valid = ", ".join(name for name, other in CONTROLLERS.items() if not other.teleports)
        raise InputError(
            f"controller {config.controller!r} takes no velocities or waypoints; valid: {valid}"
        )
    return entry


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
