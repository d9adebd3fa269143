"""Sample distinct episodes that pass between rooms of a repaired scene."""

from __future__ import annotations

import logging
from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..formats.core.episode import Episode
from ..formats.core.errors import SceneError
from ..formats.core.frames import wrap_angle
from ..formats.core.geometry import point_along
from ..formats.scene.bundle import SceneBundle
from ..wayfinding.crossings import DOORWAY_M
from .candidates import Candidate, Level, from_one_start, longest_way, open_level
from .config import SampleConfig

logger = logging.getLogger(__name__)

_LOOK_AHEAD_M = 0.75  # a start's heading is that of the path over this length


@dataclass(frozen=True)
class SampleResult:
    """Sampled episodes, and why other candidates were dropped.

    Attributes:
        episodes: at most as many as asked for.
        requested: how many were asked for.
        dropped: number of dropped candidates by reason: `no_goal_in_range`, `unreachable`,
            `too_short`, `too_long`, `detour`, `same_room`, `too_similar`, `unsafe`.
    """

    episodes: list[Episode]
    requested: int
    dropped: dict[str, int] = field(default_factory=dict)

    @property
    def summary(self) -> str:
        """One line for logs."""
        reasons = ", ".join(f"{k} {v}" for k, v in sorted(self.dropped.items())) or "none"
        return f"{len(self.episodes)} of {self.requested} episodes; dropped candidates: {reasons}"


# Paths shorter than this are no navigation.
LEAST_WORTH_M = 1.0
# Paths nearer to each other than this on average are the same, however small the room is.
LEAST_GAP_M = 0.4


def sample_episodes(
    bundle: SceneBundle, config: SampleConfig, rng: np.random.Generator
) -> SampleResult:
    """Sample up to `config.count` distinct episodes over all levels of a scene.

    Starts are spread over the rooms, and goals over the rooms least reached from there, so that
    few episodes already see the whole scene. Levels are served in turn. When the scene does not
    hold as many distinct episodes, those found are returned and the result says why.

    Args:
        bundle: the repaired scene.
        config: what is wanted.
        rng: the only source of randomness.

    Raises:
        SceneError: not a single episode can be found; the message counts the reasons.
    """
    dropped: Counter[str] = Counter()
    kept: list[Candidate] = []
    levels: list[Level] = []
    opened_m = 0.0
    for radius, gap_m in _attempts(config):
        if radius != opened_m:
            opened_m, count = radius, len(bundle.level_floor_z_m)
            levels = [open_level(bundle, k, radius, config) for k in range(count)]
        wanted = replace(config, min_gap_m=gap_m)
        _fill(kept, [level for level in levels if len(level.cells)], wanted, rng, dropped)
        if len(kept) == config.count:
            break
    episodes = [_episode(bundle, c, k, config, rng) for k, c in enumerate(kept)]
    result = SampleResult(episodes, config.count, dict(dropped))
    if not episodes:
        area = sum(level.area_m2 for level in levels)
        longest = max((longest_way(level) for level in levels), default=0.0)
        raise SceneError(
            f"{bundle.scene_id}: no episode of {config.min_length_m:g} … {config.max_length_m:g} m "
            f"for a robot of radius {config.robot_radius_m:g} m: the connected free floor has "
            f"{area:.1f} m², the longest way on it about {longest:.1f} m; {result.summary}. "
            f"{_advice(longest)}"
        )
    single = sorted({c.level for c in kept if len(c.crossed) < config.min_crossings})
    if single:
        logger.warning(
            "%s level %s is a single room: its episodes cannot pass between rooms",
            bundle.scene_id,
            ", ".join(map(str, single)),
        )
    if len(episodes) < config.count:
        area = sum(level.area_m2 for level in levels)
        logger.warning(
            "%s: %s. Its connected free floor of %.1f m² holds no more paths of %g … %g m that "
            "differ by %g m; shorter or fewer ones may be had: --min-length-m, --count",
            bundle.scene_id,
            result.summary,
            area,
            config.min_length_m,
            config.max_length_m,
            min(LEAST_GAP_M, config.min_gap_m),
        )
    return result


def _attempts(config: SampleConfig) -> list[tuple[float, float]]:
    """Clearances and gaps between paths [m] to try in turn, until there are enough episodes."""
    roomy = max(config.roomy_radius_m, config.robot_radius_m)
    radii = sorted({roomy, config.robot_radius_m}, reverse=True)
    attempts = [(radius, config.min_gap_m) for radius in radii]
    gap_m = config.min_gap_m
    # In a small room all paths lie near each other.
    while gap_m > LEAST_GAP_M:
        gap_m = max(gap_m / 2, LEAST_GAP_M)
        attempts.append((config.robot_radius_m, gap_m))
    return attempts


def _advice(longest_m: float) -> str:
    if longest_m < LEAST_WORTH_M:
        return "No option helps: there is hardly room for this robot; a narrower one may have it"
    return f"Shorter paths may be had: --min-length-m {0.8 * longest_m:.1f} --min-crossings 0"


def _fill(
    kept: list[Candidate],
    levels: list[Level],
    config: SampleConfig,
    rng: np.random.Generator,
    dropped: Counter[str],
) -> None:
    """Append candidates to `kept` until there are enough, or `patience` runs out."""
    visits = [Counter(c.ends for c in kept if c.level == level.index) for level in levels]
    starts = failed = 0
    while levels and len(kept) < config.count and failed < config.patience * len(levels):
        k = starts % len(levels)
        starts += 1
        failed += 1
        paths = [c.reference_m for c in kept if c.level == levels[k].index]
        for outcome in from_one_start(levels[k], visits[k], paths, config, rng):
            if isinstance(outcome, str):
                dropped[outcome] += 1
                continue
            visits[k][outcome.ends] += 1
            kept.append(outcome)
            failed = 0
            break


def _episode(
    bundle: SceneBundle,
    candidate: Candidate,
    number: int,
    config: SampleConfig,
    rng: np.random.Generator,
) -> Episode:
    path = candidate.reference_m
    noise = float(rng.uniform(-1.0, 1.0)) * config.heading_noise_rad
    name = f"{bundle.scene_id}-{number:04d}"
    return Episode(
        episode_id=name,
        trajectory_id=name,
        scene_id=bundle.scene_id,
        split=config.split,
        level=candidate.level,
        start_position_world_m=path[0].copy(),
        start_yaw_rad=float(wrap_angle(_initial_heading(path) + noise)),
        goal_position_world_m=path[-1].copy(),
        reference_path_world_m=path,
        geodesic_distance_m=candidate.geodesic_m,
        extra={
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
        },
    )


def _initial_heading(path_m: NDArray[np.float64]) -> float:
    ahead = point_along(path_m, _LOOK_AHEAD_M) - path_m[0]
    return float(np.arctan2(ahead[1], ahead[0]))
