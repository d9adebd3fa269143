"""VLN metrics of one executed path.

TL, NE, SR, OS, SPL: Anderson et al., "On Evaluation of Embodied Navigation Agents", 2018, and
Anderson et al., "Vision-and-Language Navigation", CVPR 2018. nDTW: Ilharco et al., "General
Evaluation for Instruction Conditioned Navigation using Dynamic Time Warping", 2019.

A legged base sways with every step, so that the length of its 100 Hz track grows with the gait.
As in VLN-CE, paths are therefore measured at action boundaries, four times a second.
"""

import itertools
import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import cdist

from ...formats.core.arrays import Array, Floats
from ...formats.core.episode import Episode
from ...formats.core.geometry import path_length, space_evenly
from ...formats.core.rollout import STATE_RATE_HZ, EndReason, Metrics
from ...formats.scene.freemap import Freemap
from ...wayfinding.storeys import Storeys, distance_on

ACTION_RATE_HZ = 4
NDTW_THRESHOLD_M = 3.0
REFERENCE_STEP_M = 0.25  # one FORWARD action

_STOPPED = (EndReason.SUCCESS, EndReason.STOPPED_NEAR, EndReason.STOPPED_FAR)


def dtw(a_m: ArrayLike, b_m: ArrayLike) -> float:
    """Return the dynamic time warping cost [m] of two point sequences (N, D) and (M, D).

    The exact minimum over all monotone alignments of the summed Euclidean distances.
    """
    return float(_least_cost(cdist(np.asarray(a_m, np.float64), np.asarray(b_m, np.float64))))


def _least_cost(cost: Floats) -> float:
    """Return the least sum over a matrix from corner to corner, by steps down, right, or both."""
    rows = cost.tolist()  # as many as a path has steps: a loop takes milliseconds
    total = list(itertools.accumulate(rows[0]))
    for row in rows[1:]:
        diagonal, total[0] = total[0], total[0] + row[0]
        for j in range(1, len(row)):
            diagonal, total[j] = total[j], row[j] + min(total[j], diagonal, total[j - 1])
    return total[-1]


def ndtw(path_m: ArrayLike, reference_m: ArrayLike, threshold_m: float = NDTW_THRESHOLD_M) -> float:
    """Return exp(−DTW / (|reference| · threshold)), in (0, 1]; 1 when the sequences coincide."""
    return math.exp(-dtw(path_m, reference_m) / (len(np.asarray(reference_m)) * threshold_m))


def rollout_metrics(
    episode: Episode,
    ground: Freemap | Storeys,
    position_world_m: Array,
    end_reason: EndReason,
) -> Metrics:
    """Return the metrics of a base track (T, 3) [m] at `STATE_RATE_HZ`, T ≥ 1.

    Geodesic distances are those of VLN-CE's agent, not of the robot's footprint, so that robots of
    different size are comparable (see `AGENT_RADIUS_M`). `success` is the VLN one: the robot
    stopped by itself, and less than the goal's radius (3 m) away; the stricter rule for collection
    (see `OutcomeConfig`) is `end_reason == "success"`. SPL uses the episode's geodesic distance
    as the shortest length.
    Who leaves the reachable floor (`flash` goes through walls) succeeds nowhere farther than
    `SNAP_M` from it; NE is then the straight way back to it and the distance from there.
    nDTW compares both paths every 0.25 m of way, one FORWARD action, so that it does not depend on
    the robot's speed.

    On `Storeys`, lengths and distances are three-dimensional, of the base less its height at the
    start.

    Args:
        ground: of the episode; see `ground_of`.
        position_world_m: where the base was.
    """
    stride = STATE_RATE_HZ // ACTION_RATE_HZ
    last = len(position_world_m) - 1
    ticks = np.unique(np.append(np.arange(0, last + 1, stride), last))
    size = 3 if isinstance(ground, Storeys) else 2
    base_m = position_world_m[0, 2] - episode.start_position_world_m[2]
    track = (position_world_m[ticks] - (0.0, 0.0, base_m))[:, :size]
    goal = episode.goal_position_world_m[:size]
    field = distance_on(ground, goal)
    distance = field.at(track)
    error = field.at(track[-1], math.inf)
    length = path_length(track)
    success = end_reason in _STOPPED and bool(distance[-1] < episode.goal_radius_m)
    shortest = episode.geodesic_distance_m
    longest = max(length, shortest)
    reference = space_evenly(episode.reference_path_world_m[:, :size], REFERENCE_STEP_M)
    return Metrics(
        trajectory_length_m=length,
        navigation_error_m=float(error),
        navigation_error_euclidean_m=float(np.linalg.norm(track[-1] - goal)),
        success=success,
        oracle_success=bool((distance < episode.goal_radius_m).any()),
        spl=float(success) * (shortest / longest if longest > 0 else 1.0),
        ndtw=ndtw(space_evenly(track, REFERENCE_STEP_M), reference),
        fall=end_reason is EndReason.FALL,
        stuck=end_reason is EndReason.STUCK,
        duration_s=last / STATE_RATE_HZ,
    )
