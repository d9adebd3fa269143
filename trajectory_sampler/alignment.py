"""Bring VLN-CE episodes into the world frame of repaired scenes, onto the floor, out of walls."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skimage.measure import label

from ..formats.core.episode import Episode
from ..formats.core.errors import InputError
from ..formats.core.frames import HABITAT_TO_WORLD, habitat_to_world_yaw, transform_points
from ..formats.core.geometry import path_length
from ..formats.scene import FULL_HEIGHT_M
from ..formats.scene.bundle import SceneBundle
from ..formats.scene.freemap import Freemap
from ..formats.vlnce.files import VlnceEpisode, VlnceFile
from ..wayfinding.distance import AGENT_RADIUS_M, distance_field, nearest_cell
from ..wayfinding.planning import floor_z, plan_path, segments_free, simplify_path
from .config import check_free_height
from .levels import level_gaps
from .record import low_passage

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AlignConfig:
    """How episodes are fitted into a scene.

    Attributes:
        split: name written into the episodes; None takes it from the file's name.
        robot_radius_m: clearance that starts, goals and paths need: the footprint of the widest
            robot that will walk them [m].
        free_height_m: free height that they need; less than `FULL_HEIGHT_M` lets low robots pass
            under tables [m].
        max_start_nudge_m: farthest that a start in collision may be moved [m].
        max_goal_nudge_m: farthest that a goal may be moved; no farther than a start [m].
        goal_beyond_start: let a path's goal be moved farther than its own start is. By default such
            a path is rejected: a goal that moves is another task, a start that moves hardly.
        max_waypoint_nudge_m: farthest that an inner waypoint may be moved; one that would need more
            is bypassed [m].
        max_bypassed_share: greatest share of the inner waypoints that may be bypassed.
        max_floor_gap_m: farthest that a point may float above or lie below its floor [m].
        recorded_snap_m: changes of height above this are recorded point by point [m].
        waypoint_spacing_m: of points put in where the straight way is blocked [m].
    """

    split: str | None = None
    robot_radius_m: float = 0.30
    free_height_m: float = FULL_HEIGHT_M
    max_start_nudge_m: float = 0.5
    max_goal_nudge_m: float = 0.5
    goal_beyond_start: bool = False
    max_waypoint_nudge_m: float = 0.5
    max_bypassed_share: float = 0.5
    max_floor_gap_m: float = 1.0
    recorded_snap_m: float = 0.03
    waypoint_spacing_m: float = 1.0

    def __post_init__(self):
        if not 0 <= self.max_goal_nudge_m <= self.max_start_nudge_m:
            raise InputError(
                f"goals may be moved by {self.max_goal_nudge_m:g} m and starts by "
                f"{self.max_start_nudge_m:g} m; valid: 0 ≤ goals ≤ starts"
            )
        if not self.robot_radius_m > 0:
            raise InputError(f"robot radius {self.robot_radius_m:g} m; valid: above 0")
        check_free_height(self.free_height_m)


@dataclass(frozen=True)
class AlignResult:
    """What came of a file.

    Attributes:
        episodes: the aligned ones, in file order.
        rejected: (episode_id, reason) of the others.
        moved: (episode_id, distance [m]) of starts that stood in collision and were moved.
        paths: Number of paths of the aligned episodes; episodes of one path share its geometry.
        changed: how many paths had a `start moved`, a `goal moved`, `waypoints moved`, `waypoints
            bypassed`, `heights snapped`.
    """

    episodes: list[Episode]
    rejected: list[tuple[int | str, str]] = field(default_factory=list)
    moved: list[tuple[int | str, float]] = field(default_factory=list)
    paths: int = 0
    changed: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class _Fitted:
    """A path in its scene: what all episodes of one path share."""

    level: int
    path_m: Array
    yaw_rad: float
    geodesic_m: float
    changes: dict[str, Any]


class _RejectedError(Exception):
    """Why an episode cannot be aligned."""


def align_episodes(
    file: VlnceFile, bundles: Mapping[str, SceneBundle], config: AlignConfig | None = None
) -> AlignResult:
    """Align each episode of `file` with its scene.

    Positions go through the scene's `habitat_to_world` (files of our own writer are in the
    repaired world already). The level is the one whose floor lies nearest in height under the
    whole path; heights are snapped to that floor. Points in collision move to the nearest place
    that is free for the robot and connected with the others; an inner waypoint that has none within
    reach is bypassed. Where the straight way between two waypoints is blocked, planned points go in
    between. `extra` keeps the source's keys and, under `alignment`, all that was changed. The
    geodesic distance is measured again. Episodes of one path are fitted once.

    Args:
        file: the episodes.
        bundles: repaired scenes by scene id, looked up by `VlnceEpisode.scene_stem`.
        config: thresholds; the defaults when None.
    """
    config = config or AlignConfig()
    result = AlignResult([])
    freemaps: dict[str, list[Freemap]] = {}
    split = config.split or file.split
    fits: dict[tuple[Any, ...], _Fitted | _RejectedError] = {}
    changed: Counter[str] = Counter()
    for raw in file.episodes:
        scene, key = raw.scene_stem, _path_key(raw)
        if key not in fits:
            try:
                if scene not in bundles:
                    known = ", ".join(sorted(bundles)) or "none"
                    raise _RejectedError(f"scene {raw.scene_id!r} is not at hand; at hand: {known}")
                if scene not in freemaps:
                    levels = range(len(bundles[scene].level_floor_z_m))
                    freemaps[scene] = [
                        bundles[scene].freemap(k).for_height(config.free_height_m) for k in levels
                    ]
                fits[key] = fitted = _fit(raw, bundles[scene], freemaps[scene], config)
                changed.update(_kinds(fitted.changes))
            except _RejectedError as error:
                fits[key] = error
        fitted = fits[key]
        if isinstance(fitted, _RejectedError):
            result.rejected.append((raw.episode_id, str(fitted)))
            continue
        result.episodes.append(_episode(raw, fitted, split, low_passage(config.free_height_m)))
        moved = fitted.changes["start_moved_m"]
        if moved > 0:
            result.moved.append((raw.episode_id, moved))
    result.changed.update(changed)
    good = [fit for fit in fits.values() if isinstance(fit, _Fitted)]
    return replace(result, paths=len(good))


def _path_key(raw: VlnceEpisode) -> tuple[Any, ...]:
    goals = tuple((g.position_habitat_m.tobytes(), g.radius_m) for g in raw.goals)
    arrays = (raw.start_position_habitat_m, raw.start_rotation_xyzw, raw.reference_path_habitat_m)
    return (raw.scene_id, raw.in_repaired_world, goals, *(a.tobytes() for a in arrays))


def _kinds(changes: Mapping[str, Any]) -> list[str]:
    """Return what was changed of a path, in words."""
    inner = any(nudge["point"].startswith("waypoint") for nudge in changes["nudges"])
    found = {
        "start moved": changes["start_moved_m"] > 0,
        "goal moved": changes["goal_moved_m"] > 0,
        "waypoints moved": inner,
        "waypoints bypassed": bool(changes["bypassed"]),
        "heights snapped": bool(changes["height_snaps"]),
    }
    return [kind for kind, is_so in found.items() if is_so]


def _episode(raw: VlnceEpisode, fitted: _Fitted, split: str, low: Mapping[str, float]) -> Episode:
    return Episode(
        episode_id=str(raw.episode_id),
        trajectory_id=str(raw.trajectory_id),
        scene_id=raw.scene_stem,  # the name by which every later stage finds the scene
        split=split,
        level=fitted.level,
        start_position_world_m=fitted.path_m[0].copy(),
        start_yaw_rad=fitted.yaw_rad,
        goal_position_world_m=fitted.path_m[-1].copy(),
        reference_path_world_m=fitted.path_m,
        geodesic_distance_m=fitted.geodesic_m,
        instruction=raw.instruction_text,
        goal_radius_m=raw.goals[0].radius_m,
        extra={
            **_source_keys(raw),
            "source_scene_id": raw.scene_id,
            "alignment": fitted.changes,
            **low,
        },
    )


def _fit(
    raw: VlnceEpisode, bundle: SceneBundle, freemaps: list[Freemap], config: AlignConfig
) -> _Fitted:
    if not raw.goals or not len(raw.reference_path_habitat_m):
        raise _RejectedError("no goal or no reference path, as in a test split")
    to_world = HABITAT_TO_WORLD if raw.in_repaired_world else bundle.habitat_to_world
    start = transform_points(to_world, raw.start_position_habitat_m)
    goal = transform_points(to_world, raw.goals[0].position_habitat_m)
    path = transform_points(to_world, raw.reference_path_habitat_m)
    level, gaps = _level(freemaps, np.vstack([start, path, goal]), config)
    freemap = freemaps[level]
    free, start_xy, goal_xy = _connected_ends(freemap, start, goal, config)
    names = ["start", *(f"waypoint {k}" for k in range(len(path))), "goal"]
    moved = {
        "start": float(np.linalg.norm(start_xy - start[:2])),
        "goal": float(np.linalg.norm(goal_xy - goal[:2])),
    }
    waypoints, bypassed = [start_xy], []
    for k, point in enumerate(path):
        place = _nearest(freemap, free, point, config.max_waypoint_nudge_m)
        if place is None:
            bypassed.append({"waypoint": k, "position_world_m": np.round(point, 3).tolist()})
            continue
        waypoints.append(place)
        moved[f"waypoint {k}"] = float(np.linalg.norm(place - point[:2]))
    allowed = config.max_bypassed_share * max(1, len(path) - 2)
    if len(bypassed) > allowed:
        where = ", ".join(str(one["waypoint"]) for one in bypassed)
        raise _RejectedError(
            f"waypoints {where} of {len(path)} stand in collision, farther than "
            f"{config.max_waypoint_nudge_m:g} m from floor that a robot of radius "
            f"{config.robot_radius_m:g} m reaches; at most {config.max_bypassed_share:g} of the "
            "inner ones may be bypassed"
        )
    whole, detours = _passable(freemap, free, [*waypoints, goal_xy], config)
    changes = {
        "robot_radius_m": config.robot_radius_m,
        "start_moved_m": moved["start"],
        "goal_moved_m": moved["goal"],
        "waypoints_moved_m": max(moved.values()),
        "floor_gap_m": float(np.abs(gaps).max()),
        "detours": detours,
        "nudges": [
            {"point": name, "moved_m": round(moved[name], 4)} for name in names if moved.get(name)
        ],
        "height_snaps": [
            {"point": name, "moved_m": round(-float(gap), 4)}
            for name, gap in zip(names, gaps, strict=True)
            if abs(gap) > config.recorded_snap_m
        ],
        "bypassed": bypassed,
        "length_m": [round(path_length(path), 3), round(path_length(whole), 3)],
    }
    return _Fitted(
        level,
        whole,
        _yaw(to_world, raw),
        float(distance_field(freemap, goal_xy, AGENT_RADIUS_M).at(start_xy)),
        changes,
    )


def _level(freemaps: list[Freemap], points: Array, config: AlignConfig) -> tuple[int, Array]:
    """Return the level under a path (P, 3) [m], and the heights above its floor (P,) [m].

    Its ends must lie on that floor. Inner points without floor nearby are compared with the level's
    usual height: at a hole they can be bypassed, on stairs they are too high or too low.
    """
    gaps = level_gaps(freemaps, points)
    for freemap, inner in zip(freemaps, gaps[:, 1:-1], strict=True):
        if np.isfinite(freemap.floor_z_m).any():
            usual_m = float(np.nanmedian(freemap.floor_z_m))
            inner[:] = np.where(np.isinf(inner), points[1:-1, 2] - usual_m, inner)
    worst = np.abs(gaps).max(axis=1)
    level = int(np.argmin(worst))
    if worst[level] <= config.max_floor_gap_m:
        return level, gaps[level]
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


def _connected_ends(
    freemap: Freemap, start: Array, goal: Array, config: AlignConfig
) -> tuple[NDArray[np.bool_], Array, Array]:
    """Return the connected free floor (rows, columns) on which start and goal move least.

    Returns that floor, and the places (2,) [m] of start and goal on it. A start half behind a chair
    thus goes to the room's side of it, not into the pocket that nothing leads out of.
    """
    parts = np.asarray(label(freemap.free(config.robot_radius_m), connectivity=1))
    options = []
    for point, what, limit in (
        (start, "start", config.max_start_nudge_m),
        (goal, "goal", config.max_goal_nudge_m),
    ):
        found = {
            part: place
            for part in _parts_near(freemap, parts, point, limit)
            if (place := _nearest(freemap, parts == part, point, limit)) is not None
        }
        if not found:
            raise _RejectedError(
                f"the {what} at {_place(point)} stands in collision, farther than "
                f"{limit:g} m from floor free for radius {config.robot_radius_m:g} m"
            )
        options.append(found)
    common = options[0].keys() & options[1].keys()
    if not common:
        raise _RejectedError(
            "start and goal are not connected for a robot of radius "
            f"{config.robot_radius_m:g} m, {_place(start)} and {_place(goal)}"
        )
    moved = {
        part: [
            float(np.linalg.norm(found[part] - point[:2]))
            for found, point in zip(options, (start, goal), strict=True)
        ]
        for part in sorted(common)
    }
    part = min(moved, key=lambda one: (_too_far(moved[one], config), sum(moved[one])))
    if _too_far(moved[part], config):
        start_moved, goal_moved = moved[part]
        raise _RejectedError(
            f"the goal at {_place(goal)} would be moved by {goal_moved:.2f} m, the start by "
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
    """Labels of `parts` (rows, columns) that occur within `within_m` of a point."""
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
    """Return what the source says beyond the Episode's fields."""
    ours = raw.info.get("vlnpe", {}).get("extra", {}) if raw.in_repaired_world else {}
    keys: dict[str, Any] = {**raw.unknown_keys, **raw.extra, **ours}
    info = {k: v for k, v in raw.info.items() if k != "vlnpe"}
    if info:
        keys["source_info"] = info
    return keys


def _place(point: Array) -> str:
    return "(" + ", ".join(f"{v:.2f}" for v in point) + ")"
