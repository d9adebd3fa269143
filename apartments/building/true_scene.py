"""The exact building as labelled, textured triangles."""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import I32, Array
from ..materials.palette import Material, Palette
from .furniture.piece import Piece
from .plan import FloorPlan
from .shapes import Triangles, join


@dataclass(frozen=True)
class TrueObject:
    """A labelled object.

    Attributes:
        name: unique, e.g. `Sofa_1`.
        category: e.g. `sofa`, `wall`.
        lower_m, upper_m: (3,) bounds, world z up [m].
    """

    name: str
    category: str
    lower_m: tuple[float, float, float]
    upper_m: tuple[float, float, float]


@dataclass(frozen=True)
class TrueScene:
    """The exact geometry of a building, and the names of its parts.

    Attributes:
        storeys: rooms and openings of each storey, lowest first.
        shape: all triangles, world z up [m].
        face_object: (F,) int32 index into `objects`.
        objects: everything that has a name.
        materials: what `shape.material` refers to.
        lamps_m: (L, 3) centres of the ceiling lamps.
    """

    storeys: tuple[FloorPlan, ...]
    shape: Triangles
    face_object: I32
    objects: tuple[TrueObject, ...]
    materials: tuple[Material, ...]
    lamps_m: Array

    @property
    def plan(self) -> FloorPlan:
        """The lowest storey."""
        return self.storeys[0]

    def bounds(self) -> Array:
        """Return (2, 3) lower and upper corner of all rooms [m]."""
        ends = [storey.bounds() for storey in self.storeys]
        low, high = np.min([e[0] for e in ends], axis=0), np.max([e[1] for e in ends], axis=0)
        top = max(storey.floor_z_m + storey.ceiling_m for storey in self.storeys)
        return np.array([[*low, self.plan.floor_z_m], [*high, top]])


class SceneBuilder:
    """Collects pieces under unique names."""

    def __init__(self, palette: Palette):
        self.palette = palette
        self._shapes: list[Triangles] = []
        self._objects: list[TrueObject] = []
        self._counts: dict[str, int] = {}

    def add(self, piece: Piece) -> None:
        """Add a piece as the next object of its name."""
        number = self._counts[piece.name] = self._counts.get(piece.name, 0) + 1
        (x0, y0, z0), (x1, y1, z1) = piece.shape.bounds().tolist()
        name = f"{piece.name}_{number}"
        self._objects.append(TrueObject(name, piece.category, (x0, y0, z0), (x1, y1, z1)))
        self._shapes.append(piece.shape)

    def build(
        self, storeys: tuple[FloorPlan, ...], lamps_m: list[tuple[float, float, float]]
    ) -> TrueScene:
        """Return the finished scene."""
        counts = [len(s.material) for s in self._shapes]
        return TrueScene(
            storeys,
            join(self._shapes),
            np.repeat(np.arange(len(counts)), counts).astype(np.int32),
            tuple(self._objects),
            self.palette.make(),
            np.asarray(lamps_m, dtype=np.float64).reshape(-1, 3),
        )
