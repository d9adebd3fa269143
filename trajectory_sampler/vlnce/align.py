"""Bring VLN-CE episodes into the world frame of repaired scenes, onto the floor, out of walls."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ...formats.core.episode import Episode
from ...formats.core.errors import InputError
from ...formats.scene.bundle import SceneBundle
from ...formats.scene.freemap import Freemap
from ...formats.vlnce.files import VlnceEpisode, VlnceFile
from ..record import low_passage, over_stairs
from .align_config import AlignConfig
from .fit import FittedPath, fit_path
from .levels import RejectedError


@dataclass(frozen=True)
class AlignResult:
    """The outcome of aligning a file.

    Attributes:
        episodes: the aligned ones, in file order.
        rejected: (episode_id, reason) of the others.
        moved: (episode_id, distance [m]) of starts that stood in collision and were moved.
        paths: number of paths of the aligned episodes; episodes of one path share its geometry.
        changed: how many paths had a `start moved`, a `goal moved`, `waypoints moved`, `waypoints
            bypassed`, `heights snapped`.
    """

    episodes: list[Episode]
    rejected: list[tuple[int | str, str]] = field(default_factory=list)
    moved: list[tuple[int | str, float]] = field(default_factory=list)
    paths: int = 0
    changed: dict[str, int] = field(default_factory=dict)


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
        bundles: repaired scenes by scene id, looked up by `VlnceEpisode.scene_stem`.
        config: thresholds; the defaults when None.
    """
    config = config or AlignConfig()
    result = AlignResult([])
    freemaps: dict[str, list[Freemap]] = {}
    split = config.split or file.split
    fits: dict[tuple[Any, ...], FittedPath | RejectedError] = {}
    changed: Counter[str] = Counter()
    for raw in file.episodes:
        scene, key = raw.scene_stem, _path_key(raw)
        if key not in fits:
            try:
                if scene not in bundles:
                    names = ", ".join(sorted(bundles)) or "none"
                    raise RejectedError(f"scene {raw.scene_id!r} is missing; given: {names}")
                if scene not in freemaps:
                    levels = range(len(bundles[scene].level_floor_z_m))
                    freemaps[scene] = [
                        bundles[scene].freemap(k).for_height(config.free_height_m) for k in levels
                    ]
                fits[key] = fitted = fit_path(raw, bundles[scene], freemaps[scene], config)
                changed.update(_kinds(fitted.changes))
            except RejectedError as error:
                fits[key] = error
            except (InputError, ValueError) as error:  # a damaged record costs only its episodes
                fits[key] = RejectedError(f"{type(error).__name__}: {error}")
        fitted = fits[key]
        if isinstance(fitted, RejectedError):
            result.rejected.append((raw.episode_id, str(fitted)))
            continue
        result.episodes.append(_episode(raw, fitted, split, config))
        moved = fitted.changes["start_moved_m"]
        if moved > 0:
            result.moved.append((raw.episode_id, moved))
    result.changed.update(changed)
    good = [fit for fit in fits.values() if isinstance(fit, FittedPath)]
    return replace(result, paths=len(good))


def _path_key(raw: VlnceEpisode) -> tuple[Any, ...]:
    goals = tuple((g.position_habitat_m.tobytes(), g.radius_m) for g in raw.goals)
    arrays = (raw.start_position_habitat_m, raw.start_rotation_xyzw, raw.reference_path_habitat_m)
    return (raw.scene_id, raw.in_repaired_world, goals, *(a.tobytes() for a in arrays))


def _kinds(changes: Mapping[str, Any]) -> list[str]:
    """Return the kinds of changes made to a path."""
    inner = any(nudge["point"].startswith("waypoint") for nudge in changes["nudges"])
    kinds = {
        "start moved": changes["start_moved_m"] > 0,
        "goal moved": changes["goal_moved_m"] > 0,
        "waypoints moved": inner,
        "waypoints bypassed": bool(changes["bypassed"]),
        "heights snapped": bool(changes["height_snaps"]),
    }
    return [kind for kind, is_so in kinds.items() if is_so]


def _episode(raw: VlnceEpisode, fitted: FittedPath, split: str, config: AlignConfig) -> Episode:
    return Episode(
        episode_id=str(raw.episode_id),
        trajectory_id=str(raw.trajectory_id),
        scene_id=raw.scene_stem,  # the name by which every later stage finds the scene
        split=split,
        level=fitted.levels[0],
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
            **low_passage(config.free_height_m),
            **over_stairs(fitted.levels, fitted.staircases, config.climb_height_m),
        },
    )


def _source_keys(raw: VlnceEpisode) -> dict[str, Any]:
    """Return the source's keys that are no fields of an `Episode`."""
    ours = raw.info.get("vlnpe", {}).get("extra", {}) if raw.in_repaired_world else {}
    keys: dict[str, Any] = {**raw.unknown_keys, **raw.extra, **ours}
    info = {k: v for k, v in raw.info.items() if k != "vlnpe"}
    if info:
        keys["source_info"] = info
    return keys
