"""The parts of an instruction and when a walk came to them."""

import numpy as np
from numpy.typing import NDArray

from .rollout import Rollout

_REACHED_M = 0.1
_AHEAD_M = 1.5  # of the path searched for a robot's next place


def subtasks(rollout: Rollout, samples: NDArray[np.int64]) -> tuple[list[str], list[float]]:
    """Return the parts of the instruction that the robot came to, and since when [s].

    The record of an instruction has them where its writer told what its words claim: `claims`, a
    list of steps with their `words`, and `from_m`, how far along the reference path the step before
    each is done.

    Args:
        samples: The rollout's samples that are frames.
    """
    episode = rollout.episode
    records = (episode.extra.get("instruction") or {}).get("texts") or []
    told = (r for r in records if r.get("text") == episode.instruction and r.get("from_m"))
    record = next(told, None)
    if record is None:
        return [], []
    along_m = _progress_m(
        episode.reference_path_world_m[:, :2], rollout.position_world_m[samples, :2]
    )
    words, times_s = [], []
    for step, from_m in zip(record["claims"], record["from_m"], strict=True):
        frame = int(np.searchsorted(along_m, float(from_m) - _REACHED_M))
        if frame < len(samples):
            words.append(str(step["words"]))
            times_s.append(float(rollout.time_s[samples[frame]]))
    return words, times_s


def _progress_m(path_xy_m: NDArray[np.float64], xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far along a path (P, 2) each of the positions (N, 2) in turn is, ascending [m]."""
    legs_m = np.linalg.norm(np.diff(path_xy_m, axis=0), axis=1)
    corners_m = np.concatenate([[0.0], np.cumsum(legs_m)])
    at_m = np.linspace(0.0, corners_m[-1], max(2, round(corners_m[-1] / 0.05)))
    points = np.stack([np.interp(at_m, corners_m, path_xy_m[:, k]) for k in range(2)], axis=1)
    result, low = np.zeros(len(xy_m)), 0
    for k, position in enumerate(xy_m):
        high = int(np.searchsorted(at_m, at_m[low] + _AHEAD_M, side="right"))
        low += int(np.argmin(np.linalg.norm(points[low:high] - position, axis=1)))
        result[k] = at_m[low]
    return result
