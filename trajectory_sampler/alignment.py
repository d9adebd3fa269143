"""Bring VLN-CE episodes into the world frame of repaired scenes, onto the floor, out of walls."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..formats.core.episode import Episode
from ..formats.core.frames import HABITAT_TO_WORLD, habitat_to_world_yaw, transform_points
from ..formats.scene.bundle import SceneBundle
from ..formats.scene.freemap import Freemap
from ..formats.vlnce.files import VlnceEpisode, VlnceFile
from ..wayfinding.distance import AGENT_RADIUS_M, distance_field, nearest_cell
from ..wayfinding.planning import floor_z, plan_path, segments_free, simplify_path

Array = NDArray[np.float64]

_FLOOR_REACH_M = 0.5  # floor this far from a point still counts as the floor under it


@dataclass(frozen=True)
class AlignConfig:
    """How episodes are fitted into a scene.

    Attributes:
        split: name written into the episodes; None takes it from the file's name.
        robot_radius_m: clearance that starts, goals and paths need [m].
        max_nudge_m: farthest that a start, goal or waypoint in collision may be moved [m].
        max_floor_gap_m: farthest that a point may float above or lie below its floor [m].
        waypoint_spacing_m: of points put in where the straight way is blocked [m].
    """

    split: str | None = None
    robot_radius_m: float = 0.30
    max_nudge_m: float = 0.5
    max_floor_gap_m: float = 1.0
    waypoint_spacing_m: float = 1.0


@dataclass(frozen=True)
class AlignResult:
    """What came of a file.

    Attributes:
        episodes: the aligned ones, in file order.
        rejected: (episode_id, reason) of the others.
        moved: (episode_id, distance [m]) of starts that stood in collision and were moved.
    """

    episodes: list[Episode]
    rejected: list[tuple[int | str, str]] = field(default_factory=list)
    moved: list[tuple[int | str, float]] = field(default_factory=list)


class _RejectedError(Exception):
    """Why an episode cannot be aligned."""


def align_episodes(
    file: VlnceFile, bundles: Mapping[str, SceneBundle], config: AlignConfig | None = None
) -> AlignResult:
    """Align each episode of `file` with its scene.

    Positions go through the scene's `habitat_to_world` (files of our own writer are in the
    repaired world already). The level is the one whose floor lies nearest in height under the
    whole path; heights are snapped to that floor. Points in collision move to the nearest place
    that is free for the robot, by at most `max_nudge_m`; where the straight way between two
    waypoints is blocked, planned points go in between. `extra` keeps the source's keys and, under
    `alignment`, all that was changed. The geodesic distance is measured anew.

    Args:
        file: the episodes.
        bundles: repaired scenes by scene id, looked up by `VlnceEpisode.scene_stem`.
        config: thresholds; the defaults when None.
    """
    config = config or AlignConfig()
    result = AlignResult([])
    freemaps: dict[str, list[Freemap]] = {}
    split = config.split or file.path.name.split(".")[0]
    for raw in file.episodes:
        scene = raw.scene_stem
        try:
            if scene not in bundles:
                known = ", ".join(sorted(bundles)) or "none"
                raise _RejectedError(f"scene {raw.scene_id!r} is not at hand; at hand: {known}")
            if scene not in freemaps:
                levels = range(len(bundles[scene].level_floor_z_m))
                freemaps[scene] = [bundles[scene].freemap(k) for k in levels]
            episode = _align(raw, bundles[scene], freemaps[scene], split, config)
        except _RejectedError as error:
            result.rejected.append((raw.episode_id, str(error)))
            continue
        result.episodes.append(episode)
        moved = episode.extra["alignment"]["start_moved_m"]
        if moved > 0:
            result.moved.append((raw.episode_id, moved))
    return result


def _align(
    raw: VlnceEpisode,
    bundle: SceneBundle,
    freemaps: list[Freemap],
    split: str,
    config: AlignConfig,
) -> Episode:
    if not raw.goals or not len(raw.reference_path_habitat_m):
        raise _RejectedError("no goal or no reference path, as in a test split")
    to_world = HABITAT_TO_WORLD if raw.in_repaired_world else bundle.habitat_to_world
    start = transform_points(to_world, raw.start_position_habitat_m)
    goal = transform_points(to_world, raw.goals[0].position_habitat_m)
    path = transform_points(to_world, raw.reference_path_habitat_m)
    level, gap = _level(freemaps, np.vstack([start, path, goal]), config)
    freemap = freemaps[level]
    free = freemap.free(config.robot_radius_m)
    start_xy, start_moved = _nudged(freemap, free, start, "start", config)
    goal_xy, goal_moved = _nudged(freemap, free, goal, "goal", config)
    reach = distance_field(freemap, goal_xy, config.robot_radius_m)
    if not np.isfinite(reach.at(start_xy)):
        raise _RejectedError(
            "start and goal are not connected for a robot of radius "
            f"{config.robot_radius_m:g} m, {_place(start)} and {_place(goal)}"
        )
    inner = [_nudged(freemap, free, p, f"waypoint {k}", config) for k, p in enumerate(path)]
    waypoints = [start_xy, *(xy for xy, _ in inner), goal_xy]
    whole, detours = _passable(freemap, free, waypoints, config)
    changes = {
        "start_moved_m": start_moved,
        "goal_moved_m": goal_moved,
        "waypoints_moved_m": max(moved for _, moved in inner),
        "floor_gap_m": gap,
        "detours": detours,
    }
    return Episode(
        episode_id=str(raw.episode_id),
        trajectory_id=str(raw.trajectory_id),
        scene_id=raw.scene_stem,  # the name by which every later stage finds the scene
        split=split,
        level=level,
        start_position_world_m=whole[0].copy(),
        start_yaw_rad=_yaw(to_world, raw),
        goal_position_world_m=whole[-1].copy(),
        reference_path_world_m=whole,
        geodesic_distance_m=float(distance_field(freemap, goal_xy, AGENT_RADIUS_M).at(start_xy)),
        instruction=raw.instruction_text,
        goal_radius_m=raw.goals[0].radius_m,
        extra={**_source_keys(raw), "source_scene_id": raw.scene_id, "alignment": changes},
    )


def _level(freemaps: list[Freemap], points: Array, config: AlignConfig) -> tuple[int, float]:
    """The level under a path (P, 3) [m], and the greatest height gap to its floor [m]."""
    gaps = np.array([_floor_gaps(freemap, points) for freemap in freemaps])
    worst = np.abs(gaps).max(axis=1)
    level = int(np.argmin(worst))
    if worst[level] <= config.max_floor_gap_m:
        return level, float(worst[level])
    # Say what is wrong by the level that most of the path lies on.
    level = int(np.argmin(np.median(np.abs(gaps), axis=1)))
    point = int(np.argmax(np.abs(gaps[level])))
    gap = gaps[level, point]
    where = f"of level {level} at {_place(points[point])}"
    if not np.isfinite(gap):
        raise _RejectedError(f"there is no floor {where}")
    raise _RejectedError(
        f"a point lies {abs(gap):.2f} m {'above' if gap > 0 else 'below'} the floor {where}; "
        f"at most {config.max_floor_gap_m:g} m is allowed (the path may change levels)"
    )


def _floor_gaps(freemap: Freemap, points: Array) -> Array:
    """Height of points (P, 3) [m] above the floor (P,); inf where there is none nearby."""
    known = np.isfinite(freemap.floor_z_m)
    if not known.any():
        return np.full(len(points), np.inf)
    gaps = points[:, 2] - floor_z(freemap, points[:, :2])
    near = [nearest_cell(freemap.grid, known, p, _FLOOR_REACH_M) is not None for p in points[:, :2]]
    return np.where(near, gaps, np.inf)


def _nudged(
    freemap: Freemap, free: NDArray[np.bool_], point: Array, what: str, config: AlignConfig
) -> tuple[Array, float]:
    """The nearest place (2,) [m] to `point` (3,) that is free, and how far that is [m]."""
    xy = point[:2]
    cell = nearest_cell(freemap.grid, free, xy, config.max_nudge_m)
    if cell is None:
        raise _RejectedError(
            f"the {what} at {_place(point)} stands in collision, farther than "
            f"{config.max_nudge_m:g} m from floor free for radius {config.robot_radius_m:g} m"
        )
    if np.array_equal(freemap.grid.cell_of(xy), cell):
        return xy.copy(), 0.0
    moved = freemap.grid.center_of(cell)
    return moved, float(np.linalg.norm(moved - xy))


def _passable(
    freemap: Freemap, free: NDArray[np.bool_], waypoints: list[Array], config: AlignConfig
) -> tuple[Array, int]:
    """Waypoints (2,) as a path (P, 3) whose segments all are free, and how many were not."""
    pieces = [waypoints[0][None]]
    detours = 0
    for a, b in pairwise(waypoints):
        if np.linalg.norm(b - a) < 1e-6:
            continue
        if segments_free(freemap.grid, free, np.array([a, b]))[0]:
            pieces.append(b[None])
            continue
        way = plan_path(freemap, a, b, config.robot_radius_m)
        if way is None:
            raise _RejectedError(
                f"there is no way from waypoint {_place(a)} to {_place(b)} for a robot of "
                f"radius {config.robot_radius_m:g} m"
            )
        thin = simplify_path(
            freemap,
            way,
            radius_m=config.robot_radius_m,
            spacing_m=config.waypoint_spacing_m,
            tolerance_m=0.03,
        )
        pieces.append(thin[1:, :2])
        detours += 1
    xy = np.concatenate(pieces)
    if len(xy) == 1:
        raise _RejectedError("start and goal are the same place")
    return np.column_stack([xy, floor_z(freemap, xy)]), detours


def _yaw(to_world: Array, raw: VlnceEpisode) -> float:
    """Heading of the start in the world [rad], whatever rotation the scene was levelled by."""
    yaw = habitat_to_world_yaw(raw.start_rotation_xyzw)
    levelling = to_world[:3, :3] @ HABITAT_TO_WORLD[:3, :3].T
    ahead = levelling @ (np.cos(yaw), np.sin(yaw), 0.0)
    return float(np.arctan2(ahead[1], ahead[0]))


def _source_keys(raw: VlnceEpisode) -> dict[str, Any]:
    """What the source says beyond the Episode's fields."""
    ours = raw.info.get("vlnpe", {}).get("extra", {}) if raw.in_repaired_world else {}
    keys: dict[str, Any] = {**raw.extra, **ours}
    info = {k: v for k, v in raw.info.items() if k != "vlnpe"}
    if info:
        keys["source_info"] = info
    return keys


def _place(point: Array) -> str:
    return "(" + ", ".join(f"{v:.2f}" for v in point) + ")"
