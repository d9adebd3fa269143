"""The paths that `sample` and `collect` sample, and their scenes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ...formats.core.errors import InputError
from ...formats.scene import FULL_HEIGHT_M
from ...trajectory_sampler.config import CROSS_SHARE, SampleConfig
from ...trajectory_sampler.presets import (
    choose_seen,
    get_preset,
    parse_quotas,
    parse_splits,
    plan_quotas,
)
from ..options.episodes import Sampling
from ..options.shared import settings_of

if TYPE_CHECKING:
    from ...collectors.robots import RobotSpec


@dataclass(frozen=True)
class SamplingPlan:
    """Paths of several splits over several scenes.

    Attributes:
        train_scenes: the scenes that are trained in.
        quotas: paths by split, by scene.
        instructions: per path; 0 if the user did not ask for a published set.
        exact: a scene that holds fewer paths is an error.
    """

    splits: Mapping[str, int]
    train_scenes: tuple[str, ...]
    quotas: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    instructions: int = 0
    exact: bool = True

    @staticmethod
    def of(options: Sampling, preset: str, scenes: Sequence[str]) -> SamplingPlan | None:
        """Return the plan that options ask for; None if each scene gives the same number."""
        if preset and options.splits:
            raise InputError(
                f"--splits {options.splits} and the preset {preset} cannot be combined; choose one"
            )
        if not preset and not options.splits:
            for name in ("quota", "train_scenes", "allow_fewer"):
                if value := getattr(options, name):
                    flag = f"--{name.replace('_', '-')}"
                    given = flag if value is True else f"{flag} {value}"
                    raise InputError(f"{given} needs --splits or a preset")
            return None
        published = get_preset(preset) if preset else None
        if published and len(scenes) != published.scenes:
            raise InputError(
                f"the preset {preset} needs {published.scenes} scene"
                f"{'s' * (published.scenes > 1)}, not {len(scenes)}; for other numbers give "
                f"--splits {','.join(f'{s}={n}' for s, n in published.splits.items())}"
            )
        splits = dict(published.splits) if published else parse_splits(options.splits)
        named = [name.strip() for name in options.train_scenes.split(",") if name.strip()]
        first = published.seen if published else 0
        if len(named) == 1 and named[0].isdecimal() and named[0] not in scenes:
            first, named = _first(named[0], scenes), []
        seen = choose_seen(splits, scenes, first, named)
        quotas = plan_quotas(splits, scenes, seen, parse_quotas(options.quota))
        count = published.instructions if published else 0
        return SamplingPlan(splits, tuple(seen), quotas, count, not options.allow_fewer)


def _first(number: str, scenes: Sequence[str]) -> int:
    if not 1 <= int(number) <= len(scenes):
        raise InputError(f"--train-scenes {number}; valid: 1 to {len(scenes)} scenes, or names")
    return int(number)


def chosen_free_height(robots: Iterable[RobotSpec], asked_m: float) -> float:
    """Return the free height [m] that paths need: `asked_m`, or for 0 that of the tallest robot."""
    if asked_m >= FULL_HEIGHT_M:
        return asked_m
    from ...collectors.physics import free_height

    needed = {robot.name: free_height(robot) for robot in robots}
    if not needed:
        if asked_m == 0:
            raise InputError(
                "--free-height-m 0 uses the height of the robots; name them with --robot"
            )
        return asked_m
    tallest = max(needed, key=lambda name: needed[name])
    if 0 < asked_m < needed[tallest]:
        raise InputError(
            f"--free-height-m {asked_m:g}: {tallest} needs {needed[tallest]:g} m; valid: "
            f"{needed[tallest]:g} to {FULL_HEIGHT_M:g}, or 0 for the height of the tallest robot"
        )
    return asked_m or needed[tallest]


def check_climbing(option: str, robots: Iterable[RobotSpec]) -> None:
    """Raise InputError unless all robots take stairs, as an option needs."""
    from ...collectors.locomotion.runtime.policy import climbs
    from ...collectors.replay.suits import climber_names

    unable = [robot.name for robot in robots if not climbs(robot)]
    if unable:
        valid = f"valid: {climber_names()}"
        raise InputError(f"{option}: {', '.join(unable)} cannot climb stairs; {valid}")


def climber_radius(robots: Sequence[RobotSpec]) -> float:
    """Return the radius [m] of the widest robot that `--keep-climbable` keeps episodes for.

    Raises:
        InputError: no robot is named, or one cannot climb.
    """
    if not robots:
        raise InputError("--keep-climbable needs the robots that climb; name them with --robot")
    check_climbing("--keep-climbable", robots)
    return max(robot.footprint_radius_m for robot in robots)


def climber_height(robots: Iterable[RobotSpec]) -> float:
    """Return the free height [m] above treads that all of these robots need.

    Without robots it is that of the tallest one that climbs.
    """
    from ...collectors.physics import free_height
    from ...collectors.replay.suits import climbers

    return max(free_height(robot) for robot in tuple(robots) or climbers())


def sample_config(
    options: Sampling,
    count: int,
    robots: Sequence[RobotSpec],
    radius_m: float,
    free_height_m: float,
    *,
    strict: bool,
) -> SampleConfig:
    """Return what to sample in each scene.

    Args:
        robots: that will walk the paths, if they are known.
        count: paths per scene, where no plan says how many.
        strict: never take paths that are more similar than asked for.
    """
    config = settings_of(
        SampleConfig,
        options,
        count=count,
        robot_radius_m=radius_m,
        free_height_m=free_height_m,
        relax=not strict,
        patience=60 if strict else SampleConfig.patience,
    )
    if not CROSS_SHARE[config.storeys]:
        return config
    check_climbing(f"--storeys {config.storeys}", robots)
    return replace(config, climb_height_m=climber_height(robots))
