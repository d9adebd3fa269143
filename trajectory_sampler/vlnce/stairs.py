"""The stair filter: episodes whose reference path climbs steps that no robot of ours takes.

Three rules can be combined. `step` is VLN-PE's public one. `geometric` asks the repaired scene
whether the way leaves its level. `text` reads the instruction; it is never on by default, because
many instructions mention stairs that the path does not climb.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from ...formats.core.errors import InputError, check_name
from ...formats.core.frames import transform_points
from ...formats.scene import FULL_HEIGHT_M
from ...formats.scene.bundle import SceneBundle
from ...formats.scene.freemap import Freemap
from ...formats.vlnce.files import VlnceEpisode, VlnceFile
from ...wayfinding.distance import AGENT_RADIUS_M, distance_field
from .climb import climb_of
from .levels import level_gaps, points_of, world_from
from .stair_words import stair_word, unknown_language

MAX_STEP_M = 0.3  # VLN-PE's public rule
STEP, GEOMETRIC, TEXT = "step", "geometric", "text"
RULES = (STEP, GEOMETRIC, TEXT)
ANY, ALL = "any", "all"
_ABOVE_FLOOR_M = 1.0  # a reference point farther from every floor lies on none


@dataclass(frozen=True)
class StairRules:
    """Rules of the stair filter, and how they are combined.

    Attributes:
        rules: of `RULES`.
        combine: `any` drops an episode that one of the rules drops; `all` only one that every rule
            that can judge it drops.
        max_step_m: largest height between two reference points allowed by `step` [m].
        climber_radius_m: keep what a robot of this radius can walk over a climbable staircase,
            whatever the rules say; None keeps none of it [m].
        free_height_m, climb_height_m: free height that this robot needs on levels and above treads
            [m].
    """

    rules: tuple[str, ...] = (STEP,)
    combine: str = ANY
    max_step_m: float = MAX_STEP_M
    climber_radius_m: float | None = None
    free_height_m: float = FULL_HEIGHT_M
    climb_height_m: float = FULL_HEIGHT_M

    def __post_init__(self):
        if not self.rules:
            raise InputError(f"no stair rule; valid: {', '.join(RULES)}")
        for rule in self.rules:
            check_name("stair rule", rule, RULES)
        check_name("combination of stair rules", self.combine, (ANY, ALL))
        if not self.max_step_m > 0:
            raise InputError(f"stair threshold is {self.max_step_m} m; valid: above 0")

    @property
    def need_scenes(self) -> bool:
        """Whether repaired scenes are needed."""
        return GEOMETRIC in self.rules or self.climber_radius_m is not None


@dataclass(frozen=True)
class DroppedEpisode:
    """An episode that the filter drops.

    Attributes:
        episode_id: as written in the file.
        reasons: what each rule that drops it says, by rule.
    """

    episode_id: int | str
    reasons: Mapping[str, str]

    @property
    def reason(self) -> str:
        """The reasons of all rules in one line."""
        return "; ".join(self.reasons.values())


@dataclass(frozen=True)
class StairCounts:
    """Numbers of episodes and paths kept and dropped; a path counts once for its episodes.

    Attributes:
        kept, dropped: (episodes, paths).
        climbable: (episodes, paths) that are kept although the rules drop them.
        by_rule: (episodes, paths) that each rule drops, alone or with others.
        not_judged: (episodes, paths) that a rule could not judge, by rule and cause: no reference
            path (a test split), for `geometric` no repaired scene, for `text` a language whose
            words it does not know. They are kept unless another rule drops them.
    """

    kept: tuple[int, int]
    dropped: tuple[int, int]
    by_rule: Mapping[str, tuple[int, int]]
    not_judged: Mapping[str, Mapping[str, tuple[int, int]]]
    climbable: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class StairResult:
    """The file without its stair episodes, the episodes dropped, in file order, and the counts."""

    kept: VlnceFile
    dropped: tuple[DroppedEpisode, ...]
    counts: StairCounts


def steep_step(heights_m: ArrayLike, max_step_m: float = MAX_STEP_M) -> int | None:
    """Return the index of the first step (i → i + 1) higher or lower than `max_step_m`, or None.

    Args:
        heights_m: (P,) heights along a path [m].
        max_step_m: largest height difference allowed [m]; a step of exactly it is allowed, also
            when the file's decimals do not add up in binary.
    """
    steps = np.abs(np.diff(np.asarray(heights_m, dtype=np.float64)))
    high = np.flatnonzero(steps > max_step_m + 1e-9)
    return int(high[0]) if len(high) else None


def filter_stairs(
    file: VlnceFile,
    rules: StairRules = StairRules(),
    bundles: Mapping[str, SceneBundle] | None = None,
) -> StairResult:
    """Drop the episodes that climb stairs.

    What no rule can judge is kept.

    Args:
        rules: which rules, and how they are combined.
        bundles: repaired scenes by name, for the rule `geometric` and for climbable stairs.

    Raises:
        InputError: the rule `geometric`, or what is climbable, is asked without any scene.
    """
    if rules.need_scenes and not bundles:
        what = "the stair rule geometric" if GEOMETRIC in rules.rules else "--keep-climbable"
        raise InputError(f"{what} needs repaired scenes (--scenes)")
    judge = _Judge(rules, bundles or {})
    remaining, dropped = [], []
    counted: dict[str, Counter[tuple[str, str]]] = {}
    causes: dict[str, set[str]] = {rule: set() for rule in rules.rules}
    for episode in file.episodes:
        opinions = {rule: judge.opinion(rule, episode) for rule in rules.rules}
        against = {rule: o.reason for rule, o in opinions.items() if o.reason}
        able = sum(not opinion.unable for opinion in opinions.values())
        needed = 1 if rules.combine == ANY else max(able, 1)
        out = len(against) >= needed
        path = (episode.scene_id, str(episode.trajectory_id))
        if out and rules.climber_radius_m is not None:
            if reason := judge.not_climbable(episode):
                against["climbable"] = f"not climbable: {reason}"
            else:
                out = False
                counted.setdefault("climbable", Counter())[path] += 1
        counted.setdefault("dropped" if out else "kept", Counter())[path] += 1
        for rule, opinion in opinions.items():
            if opinion.unable:
                causes[rule].add(opinion.unable)
                counted.setdefault(f"{rule}: {opinion.unable}", Counter())[path] += 1
            elif opinion.reason:
                counted.setdefault(f"by {rule}", Counter())[path] += 1
        if out:
            dropped.append(DroppedEpisode(episode.episode_id, against))
        else:
            remaining.append(episode)

    def both(name: str) -> tuple[int, int]:
        paths = counted.get(name, Counter())
        return paths.total(), len(paths)

    counts = StairCounts(
        both("kept"),
        both("dropped"),
        {rule: both(f"by {rule}") for rule in rules.rules},
        {
            rule: {cause: both(f"{rule}: {cause}") for cause in sorted(rule_causes)}
            for rule, rule_causes in causes.items()
            if rule_causes
        },
        both("climbable"),
    )
    return StairResult(replace(file, episodes=tuple(remaining)), tuple(dropped), counts)


@dataclass(frozen=True)
class _Opinion:
    """The reason why a rule drops an episode, or cannot judge it; both may be empty."""

    reason: str = ""
    unable: str = ""


@dataclass(frozen=True)
class _Judge:
    """Judges episodes; the geometric verdict of a path is computed once for its episodes."""

    rules: StairRules
    bundles: Mapping[str, SceneBundle]
    freemaps: dict[str, list[Freemap]] = field(default_factory=dict)
    seen: dict[tuple[str, bytes], str] = field(default_factory=dict)
    climbs: dict[tuple[str, bytes], str] = field(default_factory=dict)

    def opinion(self, rule: str, episode: VlnceEpisode) -> _Opinion:
        """Return what `rule` says of an episode."""
        if rule == TEXT:
            return _text(episode)
        if not len(episode.reference_path_habitat_m):
            return _Opinion(unable="without a reference path")
        if rule == STEP:
            return _Opinion(self._step(episode))
        scene = episode.scene_stem
        if scene not in self.bundles:
            return _Opinion(unable="without a repaired scene")
        key = (scene, episode.reference_path_habitat_m.tobytes())
        if key not in self.seen:
            self.seen[key] = self._leaves_level(episode, self.bundles[scene])
        return _Opinion(self.seen[key])

    def _step(self, episode: VlnceEpisode) -> str:
        heights = episode.reference_path_habitat_m[:, 1]  # Habitat's y is up
        step = steep_step(heights, self.rules.max_step_m)
        if step is None:
            return ""
        height = float(heights[step + 1] - heights[step])
        return (
            f"reference path {'climbs' if height > 0 else 'descends'} {abs(height):.2f} m "
            f"between points {step} and {step + 1}; at most {self.rules.max_step_m:g} m is allowed"
        )

    def not_climbable(self, episode: VlnceEpisode) -> str:
        """Return why a robot of the rules' radius cannot walk an episode over stairs; "" if not."""
        scene = episode.scene_stem
        if scene not in self.bundles:
            return f"scene {episode.scene_id!r} is not repaired"
        if not episode.goals or not len(episode.reference_path_habitat_m):
            return "it has no goal or no reference path"
        bundle, rules = self.bundles[scene], self.rules
        points = points_of(episode, bundle)
        key = (scene, points.tobytes())
        if key not in self.climbs:
            climb = climb_of(
                bundle,
                self._freemaps(bundle, scene),
                points,
                radius_m=rules.climber_radius_m or 0.0,
                free_height_m=rules.free_height_m,
                climb_height_m=rules.climb_height_m,
            )
            self.climbs[key] = climb if isinstance(climb, str) else ""
        return self.climbs[key]

    def _leaves_level(self, episode: VlnceEpisode, bundle: SceneBundle) -> str:
        path = transform_points(world_from(episode, bundle), episode.reference_path_habitat_m)
        return _leaving(self._freemaps(bundle, episode.scene_stem), path)

    def _freemaps(self, bundle: SceneBundle, scene: str) -> list[Freemap]:
        if scene not in self.freemaps:
            levels = range(len(bundle.level_floor_z_m))
            self.freemaps[scene] = [bundle.freemap(k) for k in levels]
        return self.freemaps[scene]


def _text(episode: VlnceEpisode) -> _Opinion:
    text = episode.instruction_text
    if word := stair_word(text):
        return _Opinion(f"the instruction says {word!r}")
    given = (episode.unknown_keys | episode.extra).get("source_instruction")
    declared = given.get("language") if isinstance(given, dict) else ""
    language = unknown_language(text, declared if isinstance(declared, str) else "")
    return _Opinion(unable=f"with instructions in {language}" if language else "")


def _leaving(freemaps: Sequence[Freemap], path_m: np.ndarray) -> str:
    """Return why the way along a path (P, 3) [m] leaves the level of its start.

    "" if it does not.
    """
    gaps = np.abs(level_gaps(freemaps, path_m))
    level = np.argmin(gaps, axis=0)
    floating = np.flatnonzero(gaps.min(axis=0) > _ABOVE_FLOOR_M)
    if len(floating):
        return f"point {floating[0]} of the reference path lies on no level's floor"
    other = np.flatnonzero(level != level[0])
    if len(other):
        k = other[0]
        return f"the path leaves level {level[0]} for level {level[k]} at point {k}"
    reach = distance_field(freemaps[level[0]], path_m[-1, :2], AGENT_RADIUS_M)
    if not np.isfinite(reach.at(path_m[0, :2])):
        return f"no way leads from start to goal on level {level[0]} alone"
    return ""
