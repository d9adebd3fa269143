"""Whether a robot can walk given episodes: whether it climbs, and fits under what hangs there."""

from collections.abc import Callable, Sequence

from ...formats.core.episode import Episode
from ...formats.core.errors import InputError
from ..locomotion.runtime.policy import climbs
from ..physics import free_height
from ..robots import ROBOTS, RobotSpec


def climbers() -> tuple[RobotSpec, ...]:
    """Return the robots that take stairs."""
    return tuple(robot for robot in ROBOTS.values() if climbs(robot))


def climber_names() -> str:
    """Return their names as a message lists them."""
    return ", ".join(robot.name for robot in climbers()) or "none"


def check_suits(robot: RobotSpec, episodes: Sequence[Episode]) -> None:
    """Raise unless a robot can walk all episodes as far as stairs and its height are concerned.

    Raises:
        InputError: it cannot; the message names the first such episode, how many there are, the
            heights, and what to do.
    """
    name = robot.name
    if any(episode.staircases for episode in episodes) and not climbs(robot):
        _refuse(
            episodes,
            lambda e: bool(e.staircases),
            lambda e: (
                f"takes stairs, which {name} cannot climb; valid: {climber_names()}, or paths of "
                "--storeys no"
            ),
        )
    needs_m = free_height(robot)
    lower = "a lower robot, or paths sampled for this one (collect --free-height-m 0"
    _refuse(
        episodes,
        lambda e: e.free_height_m < needs_m,
        lambda e: (
            f"has {e.free_height_m:g} m free above its path, and {name} needs {needs_m:g} m; "
            f"valid: {lower} --robot {name})"
        ),
    )
    _refuse(
        episodes,
        lambda e: bool(e.staircases) and e.climb_height_m < needs_m,
        lambda e: (
            f"{_free_over_stairs(e)}, and {name} needs "
            f"{needs_m:g} m; valid: {lower} --storeys cross --robot {name})"
        ),
    )


def _free_over_stairs(episode: Episode) -> str:
    if episode.extra.get("climb_height_m"):
        return f"has {episode.climb_height_m:g} m free above its stairs"
    return f"does not state the height free above its stairs ({episode.climb_height_m:g} m assumed)"


def _refuse(
    episodes: Sequence[Episode], unfit: Callable[[Episode], bool], why: Callable[[Episode], str]
) -> None:
    out = [episode for episode in episodes if unfit(episode)]
    if not out:
        return
    others = f" (so have {len(out)} of {len(episodes)} episodes)" if len(out) > 1 else ""
    raise InputError(f"episode {out[0].episode_id} of {out[0].scene_id} {why(out[0])}{others}")
