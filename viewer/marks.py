"""What stays where it is while a walk plays: its paths, its goal, its events, its name."""

from typing import Any

import numpy as np

from ..formats.core.arrays import Array
from ..formats.core.rollout import REST_EVENT, STATE_RATE_HZ
from .walk import Walk

Color = tuple[int, int, int]
REFERENCE, WALKED, GOAL = (255, 170, 0), (0, 120, 255), (20, 160, 60)
ABOVE_M = np.array([0, 0, 0.03])
UP_M = np.array([0, 0, 0.5])
NAME_M = np.array([0, 0, 1.5])
APART_M = 0.8  # of labels of events


def add_marks(scene: Any, root: str, walk: Walk) -> list[Any]:
    """Add a walk's paths, goal and events below a node; return the nodes."""
    episode = walk.rollout.episode
    goal = tuple(episode.goal_position_world_m)
    labels = [
        scene.add_label(f"{root}/events/{k}", text, position=tuple(at + UP_M))
        for k, (at, text) in enumerate(_places(walk))
    ]
    return [
        _add_line(scene, f"{root}/reference", episode.reference_path_world_m, REFERENCE),
        add_track(scene, f"{root}/walked", walk, WALKED),
        scene.add_icosphere(f"{root}/goal", 0.08, subdivisions=2, color=GOAL, position=goal),
        *labels,
    ]


def add_track(scene: Any, name: str, walk: Walk, color: Color) -> Any:
    """Add the way that a robot walked, on the floor."""
    points = walk.rollout.position_world_m[::5].copy()
    points[:, 2] = walk.rollout.floor_z_m[::5]
    return _add_line(scene, name, points, color)


def add_name(scene: Any, name: str, walk: Walk) -> Any:
    """Add a walk's name above its start."""
    at = walk.rollout.position_world_m[0] + NAME_M
    return scene.add_label(name, walk.name, position=tuple(at))


def _add_line(scene: Any, name: str, points_m: Array, color: Color) -> Any:
    points = np.asarray(points_m, float) + ABOVE_M
    if len(points) < 2:
        points = np.repeat(points, 2, axis=0)
    segments = np.stack([points[:-1], points[1:]], axis=1)
    return scene.add_line_segments(name, segments, color, thickness=4.0, thickness_units="screen")


def _places(walk: Walk) -> list[tuple[Array, str]]:
    """Return where (3,) [m] events were, those of one place together, with their kinds."""
    places: list[tuple[Array, list[str]]] = []
    for event in walk.rollout.events:
        if event.kind == REST_EVENT:
            continue
        sample = min(len(walk) - 1, round(event.time_s * STATE_RATE_HZ))
        at = walk.rollout.position_world_m[sample]
        near = (kinds for place, kinds in places if np.linalg.norm(place - at) < APART_M)
        kinds = next(near, None)
        if kinds is None:
            places.append((at, kinds := []))
        kinds.append(event.kind)
    return [(at, ", ".join(dict.fromkeys(kinds))) for at, kinds in places]
