"""What the drawing of paths needs of the floor: a level, or two that a staircase joins."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from ..formats.core.arrays import I32, I64, Array
from ..formats.scene.freemap import Freemap
from ..wayfinding.crossings import Crossing
from ..wayfinding.planning import PlanConfig, plan_path, simplify_path
from .config import SampleConfig
from .view import SceneView


class Reach(Protocol):
    """Geodesic distances from one start."""

    @property
    def start_m(self) -> Array:
        """(D,) the start [m]."""
        ...

    @property
    def to_cells_m(self) -> Array:
        """(N,) distances to the cells of the ground [m]; inf where no path may end."""
        ...

    def to(self, goal_m: Array) -> float:
        """Return the distance to a goal (D,) [m]."""
        ...


@dataclass(frozen=True)
class Visits:
    """The rooms of a path.

    Attributes:
        ends: room indices of its start and goal.
        rooms: those that it visits, in order.
        crossed: its steps from room to room of a level, in order.
        steps: how often it passes from room to room, over stairs too, not counting a room that it
            only begins or ends in the doorway of.
    """

    ends: tuple[int, int]
    rooms: tuple[int, ...]
    crossed: tuple[Crossing, ...]
    steps: int


class Ground(Protocol):
    """Floor that paths are drawn on."""

    @property
    def index(self) -> int:
        """Number of the ground in its scene: levels first, then staircases."""
        ...

    @property
    def cells_m(self) -> Array:
        """(N, D) places where an episode may start or end [m]; D is 3 where levels change."""
        ...

    @property
    def rooms(self) -> I32:
        """(N,) room index of each of them."""
        ...

    @property
    def room_names(self) -> Sequence[str]:
        """Name of every room; "" if unknown."""
        ...

    @property
    def hops(self) -> I64:
        """(R, R) fewest steps from room to room."""
        ...

    @property
    def radius_m(self) -> float:
        """Clearance that every point of a path has [m]."""
        ...

    @property
    def min_crossings(self) -> int:
        """How many times a path must pass between rooms."""
        ...

    @property
    def stairs_m(self) -> float:
        """Length of the stairs that each path takes; on top of the lengths of a config [m]."""
        ...

    @property
    def view(self) -> SceneView:
        """What cameras see in the scene."""
        ...

    def route(self, path_m: Array) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return the levels and the staircases that a path (P, 3) [m] takes, in order."""
        ...

    def reach(self, start_m: Array, radius_m: float) -> Reach:
        """Return the distances from a start (D,) [m] for a disc of `radius_m`."""
        ...

    def reference(self, start_m: Array, goal_m: Array, config: SampleConfig) -> Array | None:
        """Return waypoints (P, 3) [m] from start to goal (D,); None if no way leads there."""
        ...

    def may_end_at(self, position_m: Array) -> bool:
        """Return whether an episode may start or end in the cell of a position (3,) [m]."""
        ...

    def visits(self, reference_m: Array) -> Visits:
        """Return the rooms that a path (P, 3) [m] visits."""
        ...

    def is_free(self, reference_m: Array) -> bool:
        """Return whether every segment of a path (P, 3) [m] keeps the ground's clearance."""
        ...


def dimensions(ground: Ground) -> int:
    """Return how many coordinates the places of a ground have."""
    return ground.cells_m.shape[1]


def waypoints(
    freemap: Freemap, start_xy_m: Array, goal_xy_m: Array, radius_m: float, config: SampleConfig
) -> Array | None:
    """Return a planned path (P, 3) [m] on one level, thinned to waypoints; None if there is no way.

    Args:
        start_xy_m, goal_xy_m: (2,) [m].
    """
    plan = PlanConfig(comfort_m=config.comfort_m, comfort_weight=config.clearance_preference)
    path = plan_path(freemap, start_xy_m, goal_xy_m, radius_m, plan)
    if path is None:
        return None
    spacing_m = config.waypoint_spacing_m
    return simplify_path(freemap, path, radius_m=radius_m, spacing_m=spacing_m, tolerance_m=0.03)
