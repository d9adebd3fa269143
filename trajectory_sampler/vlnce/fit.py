"""Fit the path of a VLN-CE episode into a repaired scene: onto the floor, out of walls."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skimage.measure import label

from ...formats.core.frames import HABITAT_TO_WORLD, Array, habitat_to_world_yaw
from ...formats.core.geometry import path_length
from ...formats.scene.bundle import SceneBundle
from ...formats.scene.freemap import Freemap
from ...formats.vlnce.files import VlnceEpisode
from ...wayfinding.distance import AGENT_RADIUS_M, distance_field, nearest_cell
from ...wayfinding.planning import floor_z, plan_path, segments_free, simplify_path
from .align_config import AlignConfig
from .climb import around_stairs, climb_of, joined
from .levels import STAIRS, Part, RejectedError, level_under, place_text, points_of, world_from


@dataclass(frozen=True)
class FittedPath:
    """A path in its scene: what all episodes of one path share."""

    levels: tuple[int, ...]
    staircases: tuple[int, ...]
    path_m: Array
    yaw_rad: float
    geodesic_m: float
    changes: dict[str, Any]


def fit_path(
    raw: VlnceEpisode, bundle: SceneBundle, freemaps: list[Freemap], config: AlignConfig
) -> FittedPath:
    """Return an episode's path in its scene.

    Args:
        freemaps: of the scene's levels, for the free height of `config`.

    Raises:
        RejectedError: the path does not fit.
    """
    if not raw.goals or not len(raw.reference_path_habitat_m):
        raise RejectedError("no goal or no reference path, as in a test split")
    points = points_of(raw, bundle)
    path = points[1:-1]
    names = ["start", *(f"waypoint {k}" for k in range(len(path))), "goal"]
    climb = None
    try:
        level, gaps = level_under(freemaps, points, config.max_floor_gap_m)
        levels, staircases = (level,), ()
        parts = [Part(freemaps[level], points, names, gaps)]
    except RejectedError as error:
        if not config.keep_climbable:
            raise
        climb = climb_of(
            bundle,
            freemaps,
            points,
            radius_m=config.robot_radius_m,
            free_height_m=config.free_height_m,
            climb_height_m=config.climb_height_m,
        )
        if isinstance(climb, str):
            raise RejectedError(f"{error}; {climb}") from error
        levels, staircases = climb.levels, (climb.staircase,)
        parts = around_stairs(climb, points, names)
    moved: dict[str, float] = {}
    bypassed: list[dict[str, Any]] = []
    placed = [_placed(part, config, moved, bypassed) for part in parts]
    _check(moved, bypassed, path, config, over_stairs=climb is not None)
    fitted = [
        _passable(part.freemap, free, places, config)
        for part, (free, places) in zip(parts, placed, strict=True)
    ]
    whole = fitted[0][0]
    if climb:
        whole = joined(climb, whole, fitted[1][0], config.robot_radius_m)
    gap_of = {
        name: gap for part in parts for name, gap in zip(part.names, part.gaps_m, strict=True)
    }
    changes = {
        "robot_radius_m": config.robot_radius_m,
        "start_moved_m": moved["start"],
        "goal_moved_m": moved["goal"],
        "waypoints_moved_m": max(moved.values()),
        "floor_gap_m": float(np.abs(list(gap_of.values())).max()),
        "detours": sum(detours for _, detours in fitted),
        "nudges": [
            {"point": name, "moved_m": round(moved[name], 4)} for name in names if moved.get(name)
        ],
        "height_snaps": [
            {"point": name, "moved_m": round(-float(gap_of[name]), 4)}
            for name in names
            if abs(gap_of.get(name, 0.0)) > config.recorded_snap_m
        ],
        "bypassed": bypassed,
        "length_m": [round(path_length(path), 3), round(path_length(whole), 3)],
    }
    if climb:
        geodesic = float(climb.storeys.distance(whole[-1]).at(whole[0]))
    else:
        ((_, places),) = placed
        field = distance_field(parts[0].freemap, places[-1], AGENT_RADIUS_M)
        geodesic = float(field.at(places[0]))
    return FittedPath(levels, staircases, whole, _yaw(raw, bundle), geodesic, changes)


def _placed(
    part: Part, config: AlignConfig, moved: dict[str, float], bypassed: list[dict[str, Any]]
) -> tuple[NDArray[np.bool_], list[Array]]:
    """Return the connected free floor of a part, and the places (2,) of its points on it.

    Adds to `moved` how far points moved [m], by name, and to `bypassed` those without a place.
    """
    (start, *path, goal), freemap = part.points_m, part.freemap
    if STAIRS in part.names:  # starts and goals are compared where both are known
        config = replace(config, goal_beyond_start=True)
    free, start_xy, goal_xy = _connected_ends(freemap, start, goal, config)
    moved[part.names[0]] = float(np.linalg.norm(start_xy - start[:2]))
    moved[part.names[-1]] = float(np.linalg.norm(goal_xy - goal[:2]))
    places = [start_xy]
    for name, point in zip(part.names[1:-1], path, strict=True):
        place = _nearest(freemap, free, point, config.max_waypoint_nudge_m)
        if place is None:
            number = int(name.split()[-1])
            position = np.round(point, 3).tolist()
            bypassed.append({"waypoint": number, "position_world_m": position})
            continue
        places.append(place)
        moved[name] = float(np.linalg.norm(place - point[:2]))
    return free, [*places, goal_xy]


def _check(
    moved: Mapping[str, float],
    bypassed: Sequence[Mapping[str, Any]],
    path: Array,
    config: AlignConfig,
    *,
    over_stairs: bool,
) -> None:
    """Raise RejectedError if too much of a path (P, 3) would be changed."""
    if over_stairs and _too_far((moved["start"], moved["goal"]), config):
        raise RejectedError(
            f"the goal at {place_text(path[-1])} would be moved by {moved['goal']:.2f} m, the "
            f"start by {moved['start']:.2f} m; goals are moved no farther than their starts, "
            "unless --goal-beyond-start is given"
        )
    allowed = config.max_bypassed_share * max(1, len(path) - 2)
    if len(bypassed) > allowed:
        where = ", ".join(str(entry["waypoint"]) for entry in bypassed)
        raise RejectedError(
            f"waypoints {where} of {len(path)} stand in collision, farther than "
            f"{config.max_waypoint_nudge_m:g} m from floor that a robot of radius "
            f"{config.robot_radius_m:g} m reaches; at most {config.max_bypassed_share:g} of the "
            "inner ones may be bypassed"
        )


def _connected_ends(
    freemap: Freemap, start: Array, goal: Array, config: AlignConfig
) -> tuple[NDArray[np.bool_], Array, Array]:
    """Return the connected free floor (rows, columns) on which start and goal move least.

    Returns that floor, and the places (2,) [m] of start and goal on it. A start half behind a chair
    is moved to the room's side of it, not into a pocket without a way out.
    """
    parts = np.asarray(label(freemap.free(config.robot_radius_m), connectivity=1))
    options = []
    for point, what, limit in (
        (start, "start", config.max_start_nudge_m),
        (goal, "goal", config.max_goal_nudge_m),
    ):
        places = {
            part: place
            for part in _parts_near(freemap, parts, point, limit)
            if (place := _nearest(freemap, parts == part, point, limit)) is not None
        }
        if not places:
            raise RejectedError(
                f"the {what} at {place_text(point)} is in collision, farther than "
                f"{limit:g} m from floor that is free for radius {config.robot_radius_m:g} m"
            )
        options.append(places)
    common = options[0].keys() & options[1].keys()
    if not common:
        raise RejectedError(
            "start and goal are not connected for a robot of radius "
            f"{config.robot_radius_m:g} m, {place_text(start)} and {place_text(goal)}"
        )
    moved = {
        part: [
            float(np.linalg.norm(places[part] - point[:2]))
            for places, point in zip(options, (start, goal), strict=True)
        ]
        for part in sorted(common)
    }
    part = min(moved, key=lambda number: (_too_far(moved[number], config), sum(moved[number])))
    if _too_far(moved[part], config):
        start_moved, goal_moved = moved[part]
        raise RejectedError(
            f"the goal at {place_text(goal)} would be moved by {goal_moved:.2f} m, the start by "
            f"{start_moved:.2f} m, for a robot of radius {config.robot_radius_m:g} m; goals are "
            "moved no farther than their starts, unless --goal-beyond-start is given"
        )
    return parts == part, options[0][part], options[1][part]


def _too_far(moved_m: Sequence[float], config: AlignConfig) -> bool:
    """Return whether a goal is moved farther than allowed, given the moves of start and goal."""
    start_m, goal_m = moved_m
    return not config.goal_beyond_start and goal_m > start_m + 1e-9


def _parts_near(
    freemap: Freemap, parts: NDArray[np.int64], point: Array, within_m: float
) -> list[int]:
    """Return the labels of `parts` (rows, columns) that occur within `within_m` of a point."""
    row, column = freemap.grid.cell_of(point[:2])
    reach = int(np.ceil(within_m / freemap.grid.cell_m)) + 1
    window = parts[
        max(row - reach, 0) : max(row + reach + 1, 0),
        max(column - reach, 0) : max(column + reach + 1, 0),
    ]
    return [int(part) for part in np.unique(window) if part]


def _nearest(
    freemap: Freemap, free: NDArray[np.bool_], point: Array, within_m: float
) -> Array | None:
    """Return the place (2,) [m] in `free` nearest to `point` (3,); None beyond `within_m`."""
    xy = point[:2]
    cell = nearest_cell(freemap.grid, free, xy, within_m)
    if cell is None:
        return None
    if np.array_equal(freemap.grid.cell_of(xy), cell):
        return xy.copy()
    return freemap.grid.center_of(cell)


def _passable(
    freemap: Freemap, free: NDArray[np.bool_], waypoints: list[Array], config: AlignConfig
) -> tuple[Array, int]:
    """Return waypoints (2,) as a path (P, 3) of free segments, and how many needed a detour."""
    pieces = [waypoints[0][None]]
    detours = 0
    for a, b in pairwise(waypoints):
        if np.linalg.norm(b - a) < 1e-6:
            continue
        if segments_free(freemap.grid, free, np.array([a, b]))[0]:
            pieces.append(b[None])
            continue
        planned = plan_path(freemap, a, b, config.robot_radius_m)
        if planned is None:
            raise RejectedError(
                f"no path leads from waypoint {place_text(a)} to {place_text(b)} for a robot of "
                f"radius {config.robot_radius_m:g} m"
            )
        thin = simplify_path(
            freemap,
            planned,
            radius_m=config.robot_radius_m,
            spacing_m=config.waypoint_spacing_m,
            tolerance_m=0.03,
        )
        pieces.append(thin[1:, :2])
        detours += 1
    xy = np.concatenate(pieces)
    if len(xy) == 1:
        raise RejectedError("start and goal are the same place")
    return np.column_stack([xy, floor_z(freemap, xy)]), detours


def _yaw(raw: VlnceEpisode, bundle: SceneBundle) -> float:
    """Return the heading of the start in the levelled world [rad]."""
    to_world = world_from(raw, bundle)
    yaw = habitat_to_world_yaw(raw.start_rotation_xyzw)
    levelling = to_world[:3, :3] @ HABITAT_TO_WORLD[:3, :3].T
    ahead = levelling @ (np.cos(yaw), np.sin(yaw), 0.0)
    return float(np.arctan2(ahead[1], ahead[0]))
