"""Settings of level physics."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LevelModelConfig:
    """Parameters of a level's physics.

    Attributes:
        flat_within_m: a floor whose reachable part varies by less is a plane, which is faster.
        floor_error_m: a height field may be this much coarser than the floor record.
        void_depth_m: how far the floor drops where there is none.
        friction: sliding friction of floor and obstacles; feet bring their own, with priority.
        headroom_m: how far the robot may rise above its standing height and still be stopped.
    """

    flat_within_m: float = 0.002
    floor_error_m: float = 0.001
    void_depth_m: float = 1.0
    friction: float = 0.8
    headroom_m: float = 0.15
