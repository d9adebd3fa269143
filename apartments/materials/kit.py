"""The furniture materials of one home: its woods, cloths, metals and stone."""

import numpy as np

from . import fabrics, pictures
from .palette import Palette
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


class Kit:
    """Chooses materials by purpose; every choice is drawn once per home."""

    def __init__(self, rng: np.random.Generator, palette: Palette):
        self.rng = rng
        self.palette = palette
        woods, cloths = list(WOODS), list(CLOTHS)
        self.wood_names = [woods[k] for k in rng.permutation(len(woods))[:3]]
        self.cloth_names = [cloths[k] for k in rng.permutation(len(cloths))]
        fronts = list(FRONTS)
        self.front_names = [fronts[k] for k in rng.permutation(len(fronts))]

    def wood(self, k: int = 0) -> int:
        """Return one of the home's three woods."""
        name = self.wood_names[k % 3]
        return self.palette.get(
            f"wood {name}", lambda r, s: fabrics.board(r, s, WOODS[name]), (2.0, 1.0)
        )

    def wood_color(self, k: int = 0) -> tuple[int, int, int]:
        """Return its mean colour (0–255)."""
        return WOODS[self.wood_names[k % 3]]

    def cloth(self, k: int = 0) -> int:
        """Return one of the home's cloths; neighbouring k differ."""
        name = self.cloth_names[k % len(self.cloth_names)]
        return self.palette.get(
            f"cloth {name}", lambda r, s: fabrics.weave(r, s, CLOTHS[name]), (1.0, 1.0)
        )

    def cloth_color(self, k: int = 0) -> tuple[int, int, int]:
        """Return its mean colour (0–255)."""
        return CLOTHS[self.cloth_names[k % len(self.cloth_names)]]

    def blanket(self, k: int) -> int:
        """Return a plaid in two of the home's cloth colours."""
        a, b = self.cloth_color(k), self.cloth_color(k + 3)
        return self.palette.get(
            f"plaid {a} {b}", lambda r, s: fabrics.plaid(r, s, a, b, 5), (1.2, 1.2)
        )

    def linen(self, k: int, style: int) -> int:
        """Return bed linen in a cloth colour on off-white."""
        color = self.cloth_color(k)
        return self.palette.get(
            f"linen {color} {style}",
            lambda r, s: fabrics.quilt(r, s, (228, 226, 220), color, style),
            (1.6, 1.6),
        )

    def plain(self, name: str, color: tuple[int, int, int]) -> int:
        """Return lacquer of a given colour."""
        return self.palette.get(
            f"lacquer {name}", lambda r, s: lacquer(s, r, color), (1.0, 1.0), 120.0
        )

    @property
    def white(self) -> int:
        """White lacquer."""
        return self.plain("white", (232, 231, 226))

    @property
    def black(self) -> int:
        """Black lacquer."""
        return self.plain("black", (36, 36, 38))

    @property
    def ceramic(self) -> int:
        """Sanitary ceramic."""
        return self.plain("ceramic", (240, 241, 241))

    @property
    def metal(self) -> int:
        """Brushed steel."""
        return self.palette.get(
            "steel", lambda r, s: fabrics.brushed(r, s, (176, 178, 181)), (1.0, 1.0)
        )

    @property
    def brass(self) -> int:
        """Brass."""
        return self.palette.get(
            "brass", lambda r, s: fabrics.brushed(r, s, (182, 148, 84)), (0.6, 0.6)
        )

    @property
    def foliage(self) -> int:
        """Leaves."""
        return self.palette.get(
            "leaves", lambda r, s: fabrics.leaves(r, s, (74, 116, 58)), (0.8, 0.8)
        )

    @property
    def wicker(self) -> int:
        """Basket weave."""
        return self.palette.get(
            "wicker", lambda r, s: fabrics.wicker(r, s, (184, 146, 96)), (0.8, 0.8)
        )

    @property
    def shade(self) -> int:
        """A lit lampshade."""
        return self.palette.get(
            "lampshade",
            lambda r, s: lacquer(s, r, (250, 232, 196)),
            (0.6, 0.6),
            120.0,
            emissive=True,
        )

    @property
    def stone(self) -> int:
        """Worktop."""
        base, vein = [((224, 221, 216), 0.2), ((64, 64, 68), -0.5), ((188, 172, 150), 0.15)][
            len(self.front_names[0]) % 3
        ]
        return self.palette.get(
            "worktop", lambda r, s: fabrics.marble(r, s, base, vein), (2.0, 1.0)
        )

    def front(
        self, width_m: float, height_m: float, rows: int, columns: int, k: int, wood: bool = False
    ) -> int:
        """Return the doors or drawers exactly `width_m` × `height_m`."""
        framed = len(self.front_names[0]) % 2 == 0
        name = self.front_names[k % len(self.front_names)]
        base = self.wood_color(k) if wood else FRONTS[name]

        def draw(r: np.random.Generator, s: tuple[int, int]) -> np.ndarray:
            texture = fabrics.board(r, (256, 384), base) if wood else None
            return pictures.front(r, s, base, rows, columns, framed=framed, wood=texture)

        return self.palette.unique("front", draw, (width_m, height_m))

    def front_color(self, k: int) -> int:
        """Return lacquer that matches `front` without wood."""
        name = self.front_names[k % len(self.front_names)]
        return self.plain(f"front {name}", FRONTS[name])
