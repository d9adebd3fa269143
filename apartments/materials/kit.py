"""The furniture materials of one building: its woods, cloths, metals and stone."""

from typing import Any

import numpy as np

from . import fabrics, pictures
from .palette import Color, Painter, Palette
from .walls import paint as lacquer

WOODS = {
    "oak": (186, 146, 100),
    "walnut": (104, 70, 48),
    "pine": (206, 168, 118),
    "cherry": (146, 84, 52),
    "ash": (196, 178, 152),
    "black oak": (62, 54, 48),
}
CLOTHS = {
    "navy": (52, 70, 108),
    "sage": (128, 144, 112),
    "rust": (168, 86, 54),
    "mustard": (200, 156, 60),
    "grey": (128, 130, 134),
    "cream": (214, 204, 184),
    "teal": (44, 112, 116),
    "plum": (104, 58, 84),
    "charcoal": (72, 74, 78),
    "blush": (206, 158, 146),
}
FRONTS = {
    "white": (226, 226, 222),
    "forest": (62, 88, 72),
    "blue": (70, 96, 124),
    "cream": (222, 210, 184),
    "graphite": (82, 84, 88),
    "sand": (190, 172, 146),
}


def _finish(name: str, paint: Painter, side_m: float, color: Color, **options: Any) -> property:
    """Return a property of `Kit`: a square material that its first use makes."""
    size_m = side_m, side_m
    return property(lambda self: self.palette.get(name, paint, size_m, color, **options))


class Kit:
    """Chooses materials by purpose; every choice is drawn once per building."""

    def __init__(self, rng: np.random.Generator, palette: Palette):
        self.rng, self.palette = rng, palette
        self.wood_names = self._drawn(WOODS)[:3]
        self.cloth_names = self._drawn(CLOTHS)
        self.front_names = self._drawn(FRONTS)

    def _drawn(self, colors: dict[str, Color]) -> list[str]:
        names = list(colors)
        return [names[k] for k in self.rng.permutation(len(names))]

    def wood(self, k: int = 0) -> int:
        """Return one of the building's three woods."""
        name = self.wood_names[k % 3]
        return self.palette.get(f"wood {name}", fabrics.board, (2.0, 1.0), WOODS[name])

    def cloth(self, k: int = 0) -> int:
        """Return one of the building's cloths; neighbouring k differ."""
        name = self.cloth_names[k % len(self.cloth_names)]
        return self.palette.get(f"cloth {name}", fabrics.weave, (1.0, 1.0), CLOTHS[name])

    def cloth_color(self, k: int = 0) -> Color:
        """Return its mean colour (0–255)."""
        return CLOTHS[self.cloth_names[k % len(self.cloth_names)]]

    def blanket(self, k: int) -> int:
        """Return a plaid in two of the building's cloth colours."""
        a, b = self.cloth_color(k), self.cloth_color(k + 3)
        return self.palette.get(f"plaid {a} {b}", fabrics.plaid, (1.2, 1.2), a, b, 5)

    def linen(self, k: int, style: int) -> int:
        """Return bed linen in a cloth colour on off-white."""
        color, name = self.cloth_color(k), f"linen {self.cloth_color(k)} {style}"
        return self.palette.get(name, fabrics.quilt, (1.6, 1.6), (228, 226, 220), color, style)

    def plain(self, name: str, color: Color) -> int:
        """Return lacquer of a given colour."""
        return self.palette.get(f"lacquer {name}", lacquer, (1.0, 1.0), color, pixels_per_m=120.0)

    white = property(lambda self: self.plain("white", (232, 231, 226)))
    black = property(lambda self: self.plain("black", (36, 36, 38)))
    ceramic = property(lambda self: self.plain("ceramic", (240, 241, 241)))
    metal = _finish("steel", fabrics.brushed, 1.0, (176, 178, 181))
    brass = _finish("brass", fabrics.brushed, 0.6, (182, 148, 84))
    foliage = _finish("leaves", fabrics.leaves, 0.8, (74, 116, 58))
    wicker = _finish("wicker", fabrics.wicker, 0.8, (184, 146, 96))
    shade = _finish("lampshade", lacquer, 0.6, (250, 232, 196), pixels_per_m=120.0, emissive=True)

    @property
    def stone(self) -> int:
        """Worktop."""
        kinds = (((224, 221, 216), 0.2), ((64, 64, 68), -0.5), ((188, 172, 150), 0.15))
        base, vein = kinds[len(self.front_names[0]) % 3]
        return self.palette.get("worktop", fabrics.marble, (2.0, 1.0), base, vein)

    def front(
        self, width_m: float, height_m: float, rows: int, columns: int, k: int, wood: bool = False
    ) -> int:
        """Return the doors or drawers exactly `width_m` × `height_m`."""
        framed = len(self.front_names[0]) % 2 == 0
        name = self.front_names[k % len(self.front_names)]
        base = WOODS[self.wood_names[k % 3]] if wood else FRONTS[name]

        def draw(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
            texture = fabrics.board(rng, (256, 384), base) if wood else None
            return pictures.front(rng, shape, base, rows, columns, framed=framed, wood=texture)

        return self.palette.unique("front", draw, (width_m, height_m))

    def front_color(self, k: int) -> int:
        """Return lacquer that matches `front` without wood."""
        name = self.front_names[k % len(self.front_names)]
        return self.plain(f"front {name}", FRONTS[name])
