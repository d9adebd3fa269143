"""Materials and the palette that collects those a home uses."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ...formats.process.threads import in_order
from .noise import Image

Color = tuple[int, int, int]


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


# Paints an image of (rows, columns) from a random state, and further arguments.
Painter = Callable[..., Image]


class Palette:
    """Lists each material once, in the order of first use, to be made from its own random stream.

    If not `painted`, all images are plain grey: much faster where only the geometry matters.
    """

    def __init__(self, rng: np.random.Generator, painted: bool = True):
        self._rng, self._painted = rng, painted
        self._index: dict[str, int] = {}
        self._makers: list[Callable[[], Material]] = []

    def get(
        self,
        name: str,
        paint: Painter,
        size_m: tuple[float, float],
        *colors: Any,
        pixels_per_m: float = 250.0,
        emissive: bool = False,
        **options: Any,
    ) -> int:
        """Return the index of material `name`.

        It will be painted by `paint(rng, (rows, columns), *colors, **options)`.
        """
        if name not in self._index:
            rows, columns = (max(round(size * pixels_per_m), 8) for size in size_m[::-1])
            if self._painted:
                stream = self._rng.spawn(1)[0]
                draw = partial(paint, stream, (rows, columns), *colors, **options)
            else:
                draw = partial(np.full, (8, 8, 3), 128, dtype=np.uint8)
            self._index[name] = len(self._makers)
            self._makers.append(lambda: Material(name, draw(), size_m, emissive))
        return self._index[name]

    def unique(
        self, stem: str, paint: Painter, size_m: tuple[float, float], *colors: Any, **options: Any
    ) -> int:
        """Return a new material that nothing else shares (a painting, a front); see `get`."""
        return self.get(f"{stem} {len(self._makers)}", paint, size_m, *colors, **options)

    def make(self) -> tuple[Material, ...]:
        """Make all materials."""
        return tuple(in_order(lambda make: make(), self._makers))
