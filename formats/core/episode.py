"""The Episode record: one instruction-following task in one scene, in the world frame."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..scene import FULL_HEIGHT_M
from .arrays import I64, Array
from .errors import InputError
from .geometry import path_length

# Of episodes written before they stated it: the Aliengo's, the only robot that climbed.
UNSTATED_CLIMB_HEIGHT_M = 0.65


@dataclass(frozen=True)
class Episode:
    """One episode: start, goal, reference path and instruction.

    All positions are in the repaired scene's world frame (z up, metres) and lie on the floor.

    Attributes:
        episode_id: unique within its file.
        trajectory_id: episodes of one path with different instructions share it.
        scene_id: as in VLN-CE, e.g. `mp3d/<id>/<id>.glb`, or the scene's name.
        split: `train`, `val_unseen`, …
        level: index of the scene level the path starts on, and lies on if it takes no stairs.
        start_position_world_m: (3,) [m].
        start_yaw_rad: heading, 0 = +x.
        goal_position_world_m: (3,) [m].
        reference_path_world_m: (P, 3) float64 [m], from start to goal.
        geodesic_distance_m: length of the shortest collision-free path.
        instruction: the instruction text; empty before the instruct stage.
        goal_radius_m: VLN-CE's success radius.
        extra: further keys of the source file, kept as they are; over storeys also
            `staircases`, `levels` and `climb_height_m`, see the properties of these names.

    Raises:
        ValueError: the staircases and levels are no indices, or not one level more than staircases.
    """

    episode_id: str
    trajectory_id: str
    scene_id: str
    split: str
    level: int
    start_position_world_m: Array
    start_yaw_rad: float
    goal_position_world_m: Array
    reference_path_world_m: Array
    geodesic_distance_m: float
    instruction: str = ""
    goal_radius_m: float = 3.0
    extra: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not {"staircases", "levels"} & self.extra.keys():
            return
        staircases, levels = self.staircases, self.levels
        whole = all(isinstance(k, int) and k >= 0 for k in (*staircases, *levels))
        if not whole or len(levels) != len(staircases) + 1 or levels[0] != self.level:
            raise ValueError(
                f"staircases {staircases!r} and levels {levels!r}; valid: indices, one level more "
                f"than staircases, the first of them {self.level!r}"
            )

    @property
    def free_height_m(self) -> float:
        """Return the free height [m] above the path; `FULL_HEIGHT_M` suits every robot."""
        return self.extra.get("free_height_m") or FULL_HEIGHT_M

    @property
    def climb_height_m(self) -> float:
        """Return the free height [m] over the treads of its path, for the robots that climb it."""
        return self.extra.get("climb_height_m") or UNSTATED_CLIMB_HEIGHT_M

    @property
    def staircases(self) -> tuple[int, ...]:
        """Return the scene's staircases that the path takes, in order; none on a single level."""
        return tuple(self.extra.get("staircases", ()))

    @property
    def staircase(self) -> int | None:
        """Return the staircase that the path takes; None on a single level.

        Raises:
            InputError: it takes more than one, which is too many for one physical world.
        """
        if len(self.staircases) > 1:
            raise InputError(
                f"episode {self.episode_id} of {self.scene_id} takes staircases "
                f"{', '.join(map(str, self.staircases))}; valid: at most one"
            )
        return next(iter(self.staircases), None)

    @property
    def levels(self) -> tuple[int, ...]:
        """Return the levels that the path takes, in order."""
        return tuple(self.extra.get("levels", (self.level,)))

    @property
    def world(self) -> tuple[str, int, tuple[int, ...], tuple[float, float]]:
        """Return what episodes that share one physical world have in common."""
        heights = (self.free_height_m, self.climb_height_m if self.staircases else 0.0)
        return self.scene_id, self.level, self.staircases, heights

    def levels_along(self, track_m: Array) -> I64:
        """Return the level (N,) of each point of a track (N, 3) [m] that begins over the start.

        A staircase is divided at half its height.
        """
        rise_m = self.goal_position_world_m[2] - self.start_position_world_m[2]
        above_m = (track_m[:, 2] - track_m[0, 2]) * np.sign(rise_m)
        return np.where(above_m > 0.5 * abs(rise_m), self.levels[-1], self.levels[0])

    @property
    def reference_length_m(self) -> float:
        """Return the length of the reference path [m]."""
        return path_length(self.reference_path_world_m)
