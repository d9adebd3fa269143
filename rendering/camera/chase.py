"""A camera that follows a robot from behind and above and stays inside the room."""

import itertools

import numpy as np

from ...formats.core.arrays import I64, Array
from ...formats.core.camera import CameraModel
from ...formats.core.frames import look_at, matrix_to_quat, quat_to_yaw, wrap_angle
from ...formats.core.rollout import Rollout
from ..interface import Renderer

HEADING_TIME_S = 0.6  # smooths out the gait and small corrections
TURN_TIME_S = 0.5
WALL_GAP_M = 0.15
# Directions relative to straight behind the robot, the preferred one first: slightly from the side
# more of the robot is visible.
AZIMUTHS_RAD = np.deg2rad([20.0, 0.0, -20.0, 50.0, -50.0, 85.0, -85.0])
ELEVATIONS_RAD = np.deg2rad([24.0, 38.0, 55.0])
# Things nearer to the lens than this, a chandelier or the leaf of a door, would fill the picture.
CLEAR_M = 1.0
CLUTTER_COST = 0.8  # of a picture all of which is nearer
PROBES_DEG = tuple(itertools.product((-25.0, 0.0, 25.0), (0.0, 15.0)))  # right, up
AZIMUTH_COST = 0.5  # share of the distance that a change of 1 rad must gain
ELEVATION_COST = 0.5


def chase_poses(
    rollout: Rollout,
    samples: I64,
    base_height_m: float,
    camera: CameraModel,
    renderer: Renderer,
) -> tuple[Array, Array]:
    """Return positions (N, 3) [m] and optical quaternions (N, 4) of the camera at `samples` (N,).

    Rays from a point above the base probe the free distance backwards; the camera takes the
    direction with the largest share of the preferred distance and the fewest things close to the
    lens, moves there smoothly and always stays in front of what the ray hits.
    """
    distance = 1.0 + 1.5 * base_height_m
    yaw = np.unwrap(quat_to_yaw(rollout.quat_wxyz[samples]))
    time = rollout.time_s[samples]
    position = np.empty((len(samples), 3))
    quat = np.empty((len(samples), 4))
    heading = yaw[0]
    azimuth = elevation = None
    for n, sample in enumerate(samples):
        step = time[n] - time[n - 1] if n else np.inf
        heading += (1 - np.exp(-step / HEADING_TIME_S)) * (yaw[n] - heading)
        base = rollout.position_world_m[sample]
        pivot = base + np.array([0.0, 0.0, 0.35 * base_height_m])
        best = _best_direction(pivot, renderer, heading=heading, distance=distance)
        if azimuth is None or elevation is None:
            azimuth, elevation = best
        else:
            share = 1 - np.exp(-step / TURN_TIME_S)
            azimuth += share * float(wrap_angle(best[0] - azimuth))
            elevation += share * (best[1] - elevation)
        backwards = _direction(azimuth=azimuth, elevation=elevation)
        free = renderer.first_hit_m(pivot, backwards) - WALL_GAP_M
        position[n] = pivot + max(min(distance, free), 0.5 * WALL_GAP_M) * backwards
        quat[n] = matrix_to_quat(look_at(position[n], pivot))
    return position, quat


def _direction(*, azimuth: float, elevation: float) -> Array:
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


def _best_direction(
    pivot: Array, renderer: Renderer, *, heading: float, distance: float
) -> tuple[float, float]:
    """Return azimuth and elevation [rad], world, of the direction with the best free distance."""
    best, best_score = (heading + np.pi, float(ELEVATIONS_RAD[0])), -np.inf
    for elevation in ELEVATIONS_RAD:
        for offset in AZIMUTHS_RAD:
            azimuth = heading + np.pi + offset
            direction = _direction(azimuth=azimuth, elevation=elevation)
            free = renderer.first_hit_m(pivot, direction) - WALL_GAP_M
            score = min(free, distance) / distance
            score -= AZIMUTH_COST * abs(offset - AZIMUTHS_RAD[0]) + ELEVATION_COST * (
                elevation - ELEVATIONS_RAD[0]
            )
            if score > best_score:
                eye = pivot + max(min(distance, free), 0.5 * WALL_GAP_M) * direction
                score -= CLUTTER_COST * _clutter(eye, pivot, renderer)
            if score > best_score:
                best, best_score = (azimuth, float(elevation)), score
    return best


def _clutter(eye: Array, target: Array, renderer: Renderer) -> float:
    """Return the share of the view from `eye` to `target` that is nearer than `CLEAR_M`."""
    view = look_at(eye, target)
    rays = [
        view @ (np.tan(np.deg2rad(right)), -np.tan(np.deg2rad(up)), 1.0) for right, up in PROBES_DEG
    ]
    return float(np.mean([renderer.first_hit_m(eye, ray) < CLEAR_M for ray in rays]))
