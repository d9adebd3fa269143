"""Sample distinct paths that pass between rooms of a repaired scene, for one split or several."""

import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..formats.core.episode import Episode
from ..formats.core.errors import SceneError
from ..formats.scene.bundle import SceneBundle
from ..formats.scene.freemap import Freemap
from .candidates import Candidate
from .config import CROSS, CROSS_SHARE, SampleConfig
from .level import longest_way
from .record import episode_of, similarity_groups
from .search import LEAST_GAP_M, Search, attempts

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class SampleResult:
    """Sampled episodes, and why other candidates were dropped.

    Attributes:
        episodes: at most as many as asked for, split by split.
        requested: how many were asked for.
        dropped: number of dropped candidates by reason: `no_goal_in_range`, `unreachable`,
            `end_at_wall`, `too_short`, `too_long`, `detour`, `turning`,
            `same_room`, `too_similar`, `family_of_another_split`, `unsafe`.
        missing: how many each split lacks; empty when all quotas are filled.
        gap_m: least distance between two paths at which these were found [m].
        clear_for_m: radius for which all of them are free, the configured one or more [m].
        enough_at_m: without `relax`, the gap at which the scene does hold all that were asked for;
            None when no gap that was tried does, or when nothing is missing [m].
    """

    episodes: list[Episode]
    requested: int
    dropped: dict[str, int] = field(default_factory=dict)
    missing: dict[str, int] = field(default_factory=dict)
    gap_m: float = 0.0
    clear_for_m: float = 0.0
    enough_at_m: float | None = None

    @property
    def summary(self) -> str:
        """One line for logs."""
        reasons = ", ".join(f"{k} {v}" for k, v in sorted(self.dropped.items())) or "none"
        return f"{len(self.episodes)} of {self.requested} episodes; dropped candidates: {reasons}"


# Paths shorter than this are no navigation.
LEAST_WORTH_M = 1.0


def sample_episodes(
    bundle: SceneBundle,
    config: SampleConfig,
    rng: np.random.Generator,
    quotas: Mapping[str, int] | None = None,
    avoid: Sequence[Episode] = (),
) -> SampleResult:
    """Sample distinct paths over all levels of a scene, up to a quota for each split.

    Starts are spread over the rooms, and goals over lengths, over the number of doors passed, and
    over the rooms least reached from there, so that few paths already see the whole scene. Levels
    are served in turn. Paths of different splits are of different families: nowhere nearer than
    `family_gap_m`, forward or backward. When the scene does not hold as many distinct paths, those
    found are returned and the result says what is missing. Without quotas, the first paths of a
    larger count are those of a smaller one.

    Paths over storeys take one staircase. Where the scene does not hold as many of them as `mixed`
    asks for, paths on its levels take their place, with a warning; the reverse never happens.

    Args:
        quotas: paths by split; by default `config.count` of `config.split`.
        avoid: episodes of this scene that new paths keep away from, as from those of another split.

    Raises:
        SceneError: not a single path can be found; the message counts the reasons, or says of each
            staircase why no path takes it.
    """
    # The smallest split first: the large ones fill what is left around its families.
    requested = dict(sorted((quotas or {config.split: config.count}).items(), key=lambda q: q[1]))
    # Headings have a stream of their own, so that the first paths of a larger count are those of a
    # smaller one. Between quotas paths compete, and fixed sets are known by digest.
    headings = rng if quotas else rng.spawn(1)[0]
    search = Search(bundle, config, rng)
    for episode in avoid:
        search.avoid(episode)
    accepted: list[Candidate] | None = None
    gap_m = config.min_gap_m
    enough_at_m = None
    clear_for_m = config.robot_radius_m
    for radius_m, gap_m, view_m in attempts(config):
        if gap_m < config.min_gap_m and accepted is None and not config.relax:
            accepted = list(search.accepted)  # what counts; from here on it is only advice
        search.fill(requested, radius_m, gap_m, view_m)
        if search.complete(requested):
            enough_at_m = gap_m if accepted is not None else None
            clear_for_m = radius_m if accepted is None else clear_for_m
            break
    accepted = search.accepted if accepted is None else accepted
    total = sum(requested.values())
    missing = {s: n - sum(c.split == s for c in accepted) for s, n in requested.items()}
    missing = {split: n for split, n in missing.items() if n}
    if not accepted and config.storeys == CROSS:
        raise SceneError(f"{bundle.scene_id}: {_no_stairs(search)}")
    if not accepted:
        raise SceneError(_nothing(bundle, config, SampleResult([], total, dict(search.dropped))))
    result = SampleResult(
        episodes=_episodes(bundle, accepted, requested, config, headings),
        requested=total,
        dropped=dict(search.dropped),
        missing=missing,
        gap_m=gap_m if config.relax else config.min_gap_m,
        clear_for_m=clear_for_m,
        enough_at_m=enough_at_m,
    )
    _warn(search, accepted, result)
    return result


def _episodes(
    bundle: SceneBundle,
    accepted: Sequence[Candidate],
    requested: Mapping[str, int],
    config: SampleConfig,
    rng: np.random.Generator,
) -> list[Episode]:
    groups = similarity_groups([(c.ground, c.stations) for c in accepted], config)
    episodes = [
        episode_of(bundle, candidate, number, group, config, rng)
        for number, (candidate, group) in enumerate(zip(accepted, groups, strict=True))
    ]
    return [episode for split in requested for episode in episodes if episode.split == split]


def _nothing(bundle: SceneBundle, config: SampleConfig, result: SampleResult) -> str:
    levels = range(len(bundle.level_floor_z_m))
    maps = [bundle.freemap(k).for_height(config.free_height_m) for k in levels]
    radius_m = config.robot_radius_m
    area, longest = _longest(maps, radius_m, config.ends_m)
    floor = f"connected floor of {area:.1f} m²" if area >= 0.05 else "no floor so wide"
    return (
        f"{bundle.scene_id}: no episode of {config.min_length_m:g} … {config.max_length_m:g} m: "
        f"the longest way with {radius_m:.2f} m of clearance along the way and "
        f"{config.ends_m:.2f} m at both ends (--end-clearance-m), to turn on the spot, is about "
        f"{longest:.1f} m, on {floor}; {result.summary}. "
        + _advice(longest, _longest(maps, radius_m, radius_m)[1], radius_m)
    )


def _no_stairs(search: Search) -> str:
    """Say why there are no more paths over storeys."""
    bundle, config = search.bundle, search.config
    if not search.closed:
        count = len(bundle.level_floor_z_m)
        return (
            f"--storeys {config.storeys} needs a staircase; the scene has {count} "
            f"level{'s' * (count > 1)} and none (scenes that an older version repaired do not "
            "record any; repair them again)"
        )
    counts = Counter(search.dropped)
    reasons = ", ".join(f"{reason} {n}" for reason, n in sorted(counts.items())) or "none"
    return (
        f"too few paths of {config.min_length_m:g} … {config.max_length_m:g} m and a staircase: "
        + "; ".join(
            f"staircase {k} (levels {' to '.join(map(str, bundle.staircases[k].levels))}) "
            + (problem or f"can be climbed, dropped candidates: {reasons}")
            for k, problem in search.closed.items()
        )
    )


def _longest(maps: Sequence[Freemap], radius_m: float, ends_m: float) -> tuple[float, float]:
    """Return the area [m²] of the floor with the longest way of all levels, and its length [m]."""
    lengths = [longest_way(entry, radius_m, ends_m) for entry in maps]
    return max(lengths, key=lambda entry: entry[1], default=(0.0, 0.0))


def _advice(longest_m: float, with_tight_ends_m: float, radius_m: float) -> str:
    """Say which options help, by the longest way now and with ends no wider than the robot [m]."""
    if with_tight_ends_m < LEAST_WORTH_M:
        return f"With {radius_m:.2f} m of clearance there is hardly room to walk at all"
    help_text, way_m = "Shorter paths may be had:", longest_m
    if longest_m < LEAST_WORTH_M:
        help_text = f"Less room to turn gives shorter paths: --end-clearance-m {radius_m:g}"
        way_m = with_tight_ends_m
    return f"{help_text} --min-length-m {0.8 * way_m:.1f} --min-crossings 0"


def _warn(search: Search, accepted: Sequence[Candidate], result: SampleResult) -> None:
    bundle, config = search.bundle, search.config
    flat = [c for c in accepted if not c.staircases]
    single = sorted({c.ground for c in flat if c.steps < config.min_crossings})
    if single:
        logger.warning(
            "%s level %s is a single room: its episodes cannot pass between rooms",
            bundle.scene_id,
            ", ".join(map(str, single)),
        )
    splits = Counter(c.split for c in accepted).values()
    due = sum(round(CROSS_SHARE[config.storeys] * count) for count in splits)
    if (over_stairs := len(accepted) - len(flat)) != due:
        logger.warning(
            "%s: %d of %d paths take a staircase; --storeys %s asks for %d. %s",
            bundle.scene_id,
            over_stairs,
            len(accepted),
            config.storeys,
            due,
            _no_stairs(search),
        )
    if near := sum(not c.open_ends for c in accepted) if config.min_view_m else 0:
        logger.warning(
            "%s: holds too few paths whose first and last pictures show %g m of depth; accepted "
            "%d without that",
            bundle.scene_id,
            config.min_view_m,
            near,
        )
    if config.relax and result.gap_m < config.min_gap_m:
        logger.warning(
            "%s: holds too few paths that differ by %g m; accepted paths that differ by %g m",
            bundle.scene_id,
            config.min_gap_m,
            result.gap_m,
        )
    if result.missing and config.relax:
        logger.warning(
            "%s: %s. It holds no more paths of %g … %g m that differ by %g m; lower "
            "--min-length-m, or ask for fewer",
            bundle.scene_id,
            result.summary,
            config.min_length_m,
            config.max_length_m,
            min(LEAST_GAP_M, config.min_gap_m),
        )
