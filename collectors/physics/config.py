"""Settings of level physics."""

from dataclasses import dataclass, replace

from ...formats.core.episode import Episode
from ...formats.scene import FULL_HEIGHT_M


@dataclass(frozen=True)
class LevelModelConfig:
    """Parameters of a level's physics.

    Attributes:
        flat_within_m: a floor whose reachable part varies by less is a plane, which is faster.
        floor_error_m: a height field may be this much coarser than the floor record.
        void_depth_m: how far the floor drops where there is none.
        friction: sliding friction of floor and obstacles; feet bring their own, with priority.
        free_height_m: free height of the places that robots may walk to; see
            `Freemap.for_height` [m].
        climb_height_m: the same of treads and the floor at their ends [m].
        headroom_m: how far the robot may rise above its standing height and still be stopped.
    """

    flat_within_m: float = 0.002
    floor_error_m: float = 0.001
    void_depth_m: float = 1.0
    friction: float = 0.8
    free_height_m: float = FULL_HEIGHT_M
    climb_height_m: float = FULL_HEIGHT_M
    headroom_m: float = 0.15

    def for_episode(self, *episodes: Episode) -> "LevelModelConfig":
        """Return this with the least free heights that the episodes' paths were planned for."""
        climbs = [e.climb_height_m for e in episodes if e.staircases]
        return replace(
            self,
            free_height_m=min(e.free_height_m for e in episodes),
            climb_height_m=min(climbs, default=self.climb_height_m),
        )
