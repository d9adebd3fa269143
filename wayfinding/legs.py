"""The legs of paths over storeys: each lies on one level, or on one staircase."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..formats.core.arrays import Array
from ..formats.core.episode import Episode
from ..formats.core.errors import InputError
from ..formats.scene.bundle import SceneBundle
from ..formats.scene.freemap import Freemap
from ..formats.scene.staircase import Staircase
from .storeys import climbable_staircase

_PASSES_M = 0.3  # how near a path over a staircase comes to both ends of its middle line


@dataclass(frozen=True)
class Leg:
    """A part of a reference path on one level, or on a staircase and the floor at its ends.

    Attributes:
        sheet: planning map of the level, or of the staircase.
        path_m: (P, 3) [m], P ≥ 2; it begins where the leg before ends.
        index: of the level, or of the staircase, in the scene.
    """

    sheet: Freemap
    path_m: Array
    index: int
    is_stairs: bool = False

    @property
    def xy_m(self) -> Array:
        """(P, 2) [m]."""
        return self.path_m[:, :2]


def legs_of(bundle: SceneBundle, episode: Episode) -> tuple[Leg, ...]:
    """Return the legs of an episode's reference path, in order.

    Raises:
        InputError: its staircases do not join its levels, its path does not take them, or nobody
            can climb one of them.
    """
    path, height_m = episode.reference_path_world_m, episode.free_height_m
    levels, staircases = episode.levels, episode.staircases
    name = f"episode {episode.episode_id} of {episode.scene_id}"
    cuts = [0]
    for k, (before, after) in zip(staircases, pairwise(levels), strict=True):
        for end_m in line_between(climbable_staircase(bundle, k), before, after)[[0, -1]]:
            gaps_m = np.linalg.norm(path[cuts[-1] :] - end_m, axis=1)
            if gaps_m.min() > _PASSES_M:
                raise InputError(
                    f"{name}: its path passes an end of staircase {k} at {gaps_m.min():.2f} m; "
                    f"valid: at most {_PASSES_M:g} m"
                )
            cuts.append(cuts[-1] + int(np.argmin(gaps_m)))
    legs: list[Leg] = []
    for number, (first, last) in enumerate(pairwise([*cuts, len(path) - 1])):
        index = (staircases if number % 2 else levels)[number // 2]
        if first < last:
            part = path[first : last + 1]
            if is_stairs := bool(number % 2):
                sheet = bundle.stair_freemap(index).for_height(episode.climb_height_m)
            else:
                sheet = bundle.freemap(index).for_height(height_m)
            legs.append(Leg(sheet, part, index, is_stairs))
    return tuple(legs)


def line_between(staircase: Staircase, before: int, after: int) -> Array:
    """Return a staircase's middle line (K, 3) [m] in the direction from one level to another.

    Raises:
        InputError: it joins other levels.
    """
    if {before, after} != set(staircase.levels):
        raise InputError(
            f"a staircase between levels {staircase.levels[0]} and {staircase.levels[1]} is taken "
            f"from level {before} to level {after}"
        )
    return staircase.line_world_m[:: 1 if before < after else -1]
