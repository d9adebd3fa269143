"""The search for distinct paths in a scene: what is open, what is accepted, what was dropped."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..formats.core.episode import Episode
from ..formats.core.errors import SceneError
from ..formats.scene.bundle import SceneBundle
from .candidates import AcceptedPaths, Candidate, from_one_start
from .config import CROSS_SHARE, SampleConfig
from .ground import Ground
from .joined import Joined, open_joined
from .level import Level, open_level, regions_of
from .similarity import PathIndex, stations
from .view import SceneView

# Paths nearer to each other than this are the same, however small the room is.
LEAST_GAP_M = 0.4


@dataclass
class Search:
    """The search in one scene: what is open, what is accepted, what was dropped."""

    bundle: SceneBundle
    config: SampleConfig
    rng: np.random.Generator
    accepted: list[Candidate] = field(default_factory=list)
    dropped: Counter[str] = field(default_factory=Counter)

    def __post_init__(self):
        self.regions = regions_of(self.bundle)
        self.view = SceneView(self.bundle)
        reach_m = max(self.config.min_gap_m, self.config.family_gap_m)
        measure = self.config.similarity
        grounds = len(self.regions) + len(self.bundle.staircases)
        self.by_ground = [AcceptedPaths(PathIndex(reach_m, measure)) for _ in range(grounds)]
        self.opened: dict[float, list[Level]] = {}
        self.joined: dict[float, list[Joined]] = {}
        self.closed: dict[int, str] = {}  # why no path takes a staircase

    def avoid(self, episode: Episode) -> None:
        """Keep away from an episode."""
        path, staircases = episode.reference_path_world_m, episode.staircases
        ground = len(self.regions) + staircases[0] if staircases else episode.level
        self.by_ground[ground].avoid(stations(path, 3 if staircases else 2))

    def complete(self, requested: Mapping[str, int]) -> bool:
        """Return whether every split has what it wants."""
        return len(self.accepted) == sum(requested.values())

    def levels(self, radius_m: float) -> list[Level]:
        """Return the levels on which an episode may start, for paths with so much clearance."""
        if radius_m not in self.opened:
            opened = [
                open_level(self.bundle, k, radius_m, self.config, regions, self.view)
                for k, regions in enumerate(self.regions)
            ]
            self.opened[radius_m] = [level for level in opened if len(level.cells)]
        return self.opened[radius_m]

    def staircases(self, radius_m: float) -> list[Joined]:
        """Return the staircases that paths with so much clearance can take."""
        if radius_m not in self.joined:
            self.joined[radius_m] = []
            for k, staircase in enumerate(self.bundle.staircases):
                self.closed[k] = staircase.problem
                if staircase.problem:
                    continue
                settings = (radius_m, self.config, self.regions, self.view)
                try:
                    self.joined[radius_m].append(open_joined(self.bundle, k, *settings))
                except SceneError as error:
                    self.closed[k] = str(error)
        return self.joined[radius_m]

    def fill(
        self, requested: Mapping[str, int], radius_m: float, gap_m: float, view_m: float
    ) -> None:
        """Add paths split by split until there are enough, or patience runs out."""
        share = CROSS_SHARE[self.config.storeys]
        grounds = {
            False: self.levels(radius_m) if share < 1.0 else [],
            True: self.staircases(radius_m) if share > 0.0 else [],
        }
        config = replace(self.config, min_view_m=view_m)
        for split, count in requested.items():
            own = [c for c in self.accepted if c.split == split]
            have, over_stairs = len(own), sum(bool(c.staircases) for c in own)
            starts, failed = Counter[bool](), Counter[bool]()

            def open_to(cross: bool, failed: Counter[bool] = failed) -> bool:
                patience = self.config.patience * len(grounds[cross])
                return failed[cross] < patience

            while have < count:
                cross = over_stairs < round(share * (have + 1))
                if not open_to(cross):
                    # Levels take the place of stairs once tighter paths are tried; stairs never
                    # take theirs, which would exceed the share.
                    if not cross or radius_m > self.config.robot_radius_m or not open_to(False):
                        break
                    cross = False
                ground = grounds[cross][starts[cross] % len(grounds[cross])]
                starts[cross] += 1
                added = self._one(ground, split, gap_m, config)
                have += added
                over_stairs += added and cross
                failed[cross] = 0 if added else failed[cross] + 1

    def _one(self, ground: Ground, split: str, gap_m: float, config: SampleConfig) -> bool:
        here = self.by_ground[ground.index]
        for outcome in from_one_start(ground, here, split, gap_m, config, self.rng):
            if isinstance(outcome, str):
                self.dropped[outcome] += 1
                continue
            here.add(outcome)
            self.accepted.append(outcome)
            return True
        return False


def attempts(config: SampleConfig) -> list[tuple[float, float, float]]:
    """Return clearances, gaps between paths and depths at their ends [m] to try in turn."""
    roomy = max(config.roomy_radius_m, config.robot_radius_m)
    radii = sorted({roomy, config.robot_radius_m}, reverse=True)
    gaps = [config.min_gap_m]
    # In a small room all paths lie near each other.
    while gaps[-1] > LEAST_GAP_M:
        gaps.append(max(round(0.75 * gaps[-1], 2), LEAST_GAP_M))
    result = [(radius, config.min_gap_m, config.min_view_m) for radius in radii]
    result += [(config.robot_radius_m, gap, config.min_view_m) for gap in gaps[1:]]
    # In a tiny one all ends lie near a wall.
    if config.min_view_m and config.relax:
        result += [(config.robot_radius_m, gap, 0.0) for gap in gaps]
    return result
