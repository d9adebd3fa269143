"""A piece of furniture and groups that are placed together."""

from dataclasses import dataclass, replace

import numpy as np

from ....formats.core.arrays import Array
from ..shapes import Triangles

# Robots pass beneath what hangs higher, and walk over what is flatter.
OVERHEAD_M = 2.0
FLAT_M = 0.04


@dataclass(frozen=True)
class Piece:
    """One labelled thing.

    Attributes:
        name: stem of its node name, e.g. `Sofa`.
        category: e.g. `sofa`.
    """

    name: str
    category: str
    shape: Triangles

    def moved(
        self, yaw_rad: float = 0.0, x_m: float = 0.0, y_m: float = 0.0, z_m: float = 0.0
    ) -> "Piece":
        """Return the same piece turned about z, then shifted."""
        return replace(self, shape=self.shape.moved(yaw_rad, (x_m, y_m, z_m)))

    def footprint(self) -> Array | None:
        """Return (2, 2) lower and upper corner of what a robot could hit.

        None for rugs and lamps.
        """
        (x0, y0, z0), (x1, y1, z1) = self.shape.bounds()
        if z0 >= OVERHEAD_M or z1 <= FLAT_M:
            return None
        return np.array([[x0, y0], [x1, y1]])


@dataclass(frozen=True)
class Arrangement:
    """Pieces placed as one, e.g. a table with its chairs.

    Attributes:
        pieces: in the common frame.
        front_m: space to keep free before it.
        wall: stands with its back to a wall; otherwise free in the room.
        on_window: may stand before a window.
    """

    pieces: tuple[Piece, ...]
    front_m: float = 0.4
    wall: bool = True
    on_window: bool = False

    def moved(self, yaw_rad: float, x_m: float, y_m: float) -> "Arrangement":
        """Return this turned about z, then shifted."""
        return replace(self, pieces=tuple(p.moved(yaw_rad, x_m, y_m) for p in self.pieces))

    def bounds(self) -> Array:
        """Return (2, 3) bounds of everything [m]."""
        all_bounds = np.array([p.shape.bounds() for p in self.pieces])
        return np.stack([all_bounds[:, 0].min(0), all_bounds[:, 1].max(0)])

    def footprints(self) -> list[Array]:
        """Return (2, 2) footprints of its pieces that a robot could hit."""
        return [f for p in self.pieces if (f := p.footprint()) is not None]


def alone(piece: Piece, front_m: float = 0.4, on_window: bool = False) -> Arrangement:
    """Return an arrangement of one piece at the wall."""
    return Arrangement((piece,), front_m, on_window=on_window)
