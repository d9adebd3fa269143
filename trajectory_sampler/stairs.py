"""The stair filter: episodes whose reference path climbs steps that no robot of ours takes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..formats.core.errors import InputError
from ..formats.vlnce.files import VlnceFile

MAX_STEP_M = 0.3  # VLN-PE's public rule


@dataclass(frozen=True)
class DroppedEpisode:
    """An episode that the filter drops.

    Attributes:
        episode_id: as written in the file.
        step: index i of the step from reference point i to i + 1.
        height_m: signed height of that step, up is positive [m].
        reason: the same in words.
    """

    episode_id: int | str
    step: int
    height_m: float
    reason: str


@dataclass(frozen=True)
class StairResult:
    """The file without its stair episodes, and the episodes dropped, in file order."""

    kept: VlnceFile
    dropped: tuple[DroppedEpisode, ...]


def steep_step(heights_m: ArrayLike, max_step_m: float = MAX_STEP_M) -> int | None:
    """Index of the first step (i → i + 1) higher or lower than `max_step_m`, or None.

    Args:
        heights_m: (P,) heights along a path [m].
        max_step_m: largest height difference allowed [m]; a step of exactly it is allowed, also
            when the file's decimals do not add up in binary.
    """
    steps = np.abs(np.diff(np.asarray(heights_m, dtype=np.float64)))
    high = np.flatnonzero(steps > max_step_m + 1e-9)
    return int(high[0]) if len(high) else None


def filter_stairs(file: VlnceFile, max_step_m: float = MAX_STEP_M) -> StairResult:
    """Drop episodes where any consecutive reference-path height step exceeds `max_step_m` [m].

    Episodes without a reference path (a test split) cannot be judged, and are kept.

    Raises:
        InputError: the threshold is not positive.
    """
    if not max_step_m > 0:
        raise InputError(f"stair threshold is {max_step_m} m; valid: above 0")
    kept, dropped = [], []
    for episode in file.episodes:
        heights = episode.reference_path_habitat_m[:, 1]  # Habitat's y is up
        step = steep_step(heights, max_step_m)
        if step is None:
            kept.append(episode)
            continue
        height = float(heights[step + 1] - heights[step])
        reason = (
            f"reference path {'climbs' if height > 0 else 'descends'} {abs(height):.2f} m "
            f"between points {step} and {step + 1}; at most {max_step_m:g} m is allowed"
        )
        dropped.append(DroppedEpisode(episode.episode_id, step, height, reason))
    return StairResult(replace(file, episodes=tuple(kept)), tuple(dropped))
