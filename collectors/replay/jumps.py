"""Episodes of a robot that is placed pose by pose; there is no physics in between."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...formats.core.rollout import Action, EndReason
from ..controllers import STOPPED, Teleporter
from .recorder import STEPS_PER_SAMPLE

if TYPE_CHECKING:
    from .episode_run import EpisodeRun


def place_along(run: EpisodeRun, teleporter: Teleporter) -> EndReason:
    """Do a whole episode; return why it ended."""
    world, config = run.world, run.config
    flash = config.flash
    hold = flash.steps_per_action // STEPS_PER_SAMPLE
    pose = world.pose
    for _ in range(config.outcome.timeout_actions + 1):
        jump = teleporter.jump(pose)
        for note in run.task.chooser.notes() if run.task.chooser else ():
            run.note(*note)
        run.actions.append((jump.action, len(run.recorder)))
        run.recorder.sample(STOPPED)
        run.recorder.repeat(hold - 1)
        if jump.action is Action.STOP:
            return run.end_of_stop()
        world.spawn(jump.pose, near_z_m=world.foot_z_m)
        inside = world.in_collision()
        if inside:
            run.note("collision_target", ", ".join(sorted(inside)))
            if flash.refuse_collisions:
                return EndReason.STUCK
        pose = jump.pose
    return EndReason.TIMEOUT
