"""Materials and the palette that collects those a home uses."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...formats.core.threads import in_order
from .noise import Image


@dataclass(frozen=True)
class Material:
    """An image and how large it is on the surface; it repeats beyond that.

    Attributes:
        name: unique.
        image: (rows, columns, 3) uint8 sRGB.
        size_m: width and height that the image covers.
        emissive: shines by itself (a window, a lamp): shading is not applied.
    """

    name: str
    image: Image
    size_m: tuple[float, float]
    emissive: bool = False


PAINTER = Callable[[np.random.Generator, tuple[int, int]], Image]


class Palette:
    """Lists each material once, in the order of first use, to be made from its own random stream.

    Args:
        painted: paint the images; without them all are plain grey, which is much faster where only
            the geometry matters.
    """

    def __init__(self, rng: np.random.Generator, painted: bool = True):
        self._rng = rng
        self._painted = painted
        self._index: dict[str, int] = {}
        self._makers: list[Callable[[], Material]] = []

    def get(
        self,
        name: str,
        paint: PAINTER,
        size_m: tuple[float, float],
        pixels_per_m: float = 250.0,
        emissive: bool = False,
    ) -> int:
        """Return the index of material `name`, to be painted by `paint(rng, (rows, columns))`."""
        if name not in self._index:
            shape = (
                max(round(size_m[1] * pixels_per_m), 8),
                max(round(size_m[0] * pixels_per_m), 8),
            )
            if self._painted:
                draw = partial(paint, self._rng.spawn(1)[0], shape)
            else:
                draw = partial(np.full, (8, 8, 3), 128, dtype=np.uint8)
            self._index[name] = len(self._makers)
            self._makers.append(lambda: Material(name, draw(), size_m, emissive))
        return self._index[name]

    def make(self) -> tuple[Material, ...]:
        """Make all materials."""
        return tuple(in_order(lambda make: make(), self._makers))

    def unique(
        self, stem: str, paint: PAINTER, size_m: tuple[float, float], emissive: bool = False
    ) -> int:
        """Return a new material that nothing else shares (a painting, a front)."""
        return self.get(f"{stem} {len(self._makers)}", paint, size_m, emissive=emissive)
