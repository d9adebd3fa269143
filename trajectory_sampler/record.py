"""From a kept path to its episode: headings, waypoints, the ideal agent's actions, its family."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from ..formats.core.episode import Episode
from ..formats.core.frames import Array, wrap_angle
from ..formats.core.geometry import arc_length, path_length, point_along
from ..formats.scene import FULL_HEIGHT_M
from ..formats.scene.bundle import SceneBundle
from ..formats.scene.freemap import Freemap
from ..wayfinding.crossings import DOORWAY_M
from ..wayfinding.legs import legs_of
from .candidates import Candidate
from .config import ALONG_PATH, SampleConfig
from .ideal import ideal_actions
from .similarity import PathIndex
from .view import start_heading

WAYPOINT_M = 0.25


def episode_of(
    bundle: SceneBundle,
    candidate: Candidate,
    number: int,
    group: int,
    config: SampleConfig,
    rng: np.random.Generator,
) -> Episode:
    """Return the episode of a kept path.

    `extra` has the rooms visited and the doorways crossed, the waypoints every 0.25 m with their
    clearance, the actions of an ideal agent, how the start looks, and the similarity group.
    """
    path = candidate.reference_m
    drawn = float(rng.uniform(-1.0, 1.0))
    if config.heading == ALONG_PATH:
        yaw = start_heading(path) + drawn * config.heading_noise_rad
    else:
        yaw = drawn * np.pi
    yaw = float(wrap_angle(yaw))
    name = f"{bundle.scene_id}-{number:04d}"
    route = low_passage(config.free_height_m)
    route |= over_stairs(candidate.levels, candidate.staircases, config.climb_height_m)
    episode = Episode(
        episode_id=name,
        trajectory_id=name,
        scene_id=bundle.scene_id,
        split=candidate.split,
        level=candidate.levels[0],
        start_position_world_m=path[0].copy(),
        start_yaw_rad=yaw,
        goal_position_world_m=path[-1].copy(),
        reference_path_world_m=path,
        geodesic_distance_m=candidate.geodesic_m,
        extra=route,
    )
    waypoints = evenly(path, WAYPOINT_M)
    extra = {
        "rooms": list(candidate.rooms),
        "crossings": [
            {
                "along_m": round(c.along_m, 3),
                "position_xy_m": [round(float(v), 3) for v in c.position_xy_m],
                "width_m": round(c.width_m, 3),
                "doorway": c.width_m <= DOORWAY_M,
            }
            for c in candidate.crossed
        ],
        "start_heading": config.heading,
        "turning_deg": round(candidate.turning_deg, 1),
        "similarity_group": f"{bundle.scene_id}/{group}",
        "waypoints": {
            "position_world_m": np.round(waypoints, 3).tolist(),
            "clearance_m": np.round(_clearance(bundle, episode, waypoints), 3).tolist(),
        },
        # Actions move the agent on the plan: stairs are as long as they are seen from above.
        "actions": ideal_actions(path[:, :2] if candidate.staircases else path, yaw),
    }
    return replace(episode, extra=extra | route)


def over_stairs(
    levels: Sequence[int], staircases: Sequence[int], climb_height_m: float
) -> dict[str, Any]:
    """Return the keys that an episode over several levels has in its `extra`."""
    if not staircases:
        return {}
    return {
        "staircases": list(staircases),
        "levels": list(levels),
        "climb_height_m": round(climb_height_m, 3),
    }


def _clearance(bundle: SceneBundle, episode: Episode, points_m: Array) -> Array:
    """Return the clearance (W,) [m] of points (W, 3) [m] along an episode's path, on its sheets."""
    legs = legs_of(bundle, episode)
    ends_m = np.cumsum([path_length(leg.path_m) for leg in legs])[:-1]
    of = np.searchsorted(ends_m, arc_length(points_m))
    result = np.zeros(len(points_m))
    for number, leg in enumerate(legs):
        result[of == number] = clearance_at(leg.sheet, points_m[of == number])
    return result


def low_passage(free_height_m: float) -> dict[str, float]:
    """Return the keys that an episode planned for low robots has in its `extra`."""
    return {} if free_height_m >= FULL_HEIGHT_M else {"free_height_m": round(free_height_m, 3)}


def similarity_groups(paths: Sequence[tuple[int, Array]], config: SampleConfig) -> list[int]:
    """Return the number of each path's family: stations of paths linked by `family_gap_m`.

    Two paths belong together when they are closer than that, forward or backward, and so do those
    that a chain of such pairs links.

    Args:
        paths: the ground that each was drawn on, and its stations (S, D) [m].
    """
    links = np.eye(len(paths), dtype=bool)
    indices: dict[int, tuple[PathIndex, list[int]]] = {}
    for number, (ground, own) in enumerate(paths):
        fresh = (PathIndex(config.family_gap_m, config.similarity), [])
        index, numbers = indices.setdefault(ground, fresh)
        for other in (*index.near(own), *index.near(own[::-1].copy())):
            links[number, numbers[other]] = True
        index.add(own)
        numbers.append(number)
    _, families = connected_components(csr_array(links), directed=False)
    return families.tolist()


def evenly(path_m: Array, spacing_m: float) -> Array:
    """Return the points every `spacing_m` along a path (P, 3) [m], and its end: (W, 3)."""
    length = path_length(path_m)
    along = np.arange(0.0, length, spacing_m)
    if length - along[-1] < 1e-6:
        along = along[:-1]
    return point_along(path_m, np.append(along, length))


def clearance_at(freemap: Freemap, points_m: Array) -> Array:
    """Distance [m] from points (W, 2 or 3) [m] to the nearest untraversable cell: (W,)."""
    grid = freemap.grid
    fractional = (points_m[:, :2] - np.asarray(grid.origin_xy_m)) / grid.cell_m - 0.5
    return map_coordinates(freemap.clearance_m, fractional[:, ::-1].T, order=1, mode="nearest")
