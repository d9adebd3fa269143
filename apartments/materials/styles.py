"""Floors and walls of rooms, chosen so that the rooms of a building differ at a glance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from . import floors, walls
from .palette import Color, Painter, Palette

WALL_COLORS: dict[str, Color] = {
    "white": (232, 229, 222),
    "cream": (232, 219, 190),
    "sage": (186, 199, 170),
    "sky": (184, 204, 218),
    "blush": (228, 199, 186),
    "sand": (214, 196, 164),
    "mint": (196, 218, 204),
    "lilac": (206, 198, 218),
    "grey": (198, 200, 202),
    "butter": (238, 222, 160),
    "clay": (206, 158, 128),
}
ACCENTS: dict[str, Color] = {
    "petrol": (54, 92, 104),
    "olive": (112, 118, 76),
    "terracotta": (178, 98, 70),
    "navy": (62, 76, 112),
    "ochre": (206, 158, 74),
    "burgundy": (116, 54, 62),
    "fir": (64, 92, 76),
}
WOOD_TONES: dict[str, Color] = {
    "light oak": (196, 160, 116),
    "honey": (184, 132, 80),
    "walnut": (112, 78, 54),
    "grey oak": (158, 146, 130),
    "cherry": (150, 88, 56),
    "bleached": (208, 188, 158),
}
TILE_COLORS = ((206, 198, 184), (168, 164, 158), (222, 218, 210), (150, 120, 98))
WALL_TILES = ((222, 226, 226), (150, 184, 190), (176, 200, 182), (216, 206, 190), (92, 122, 140))


@dataclass(frozen=True)
class RoomStyle:
    """Materials of a room's shell.

    Attributes:
        floor, ceiling, trim: material indices; trim is baseboards and door frames.
        wall: material of plain walls.
        accent: material of the accent wall.
        accent_side: 0–3, index into the plan's sides; −1 = none.
        lower: material of the lower part of the walls (tiles, panelling); −1 = none.
        lower_m: its height.
    """

    floor: int
    ceiling: int
    trim: int
    wall: int
    accent: int
    accent_side: int
    lower: int = -1
    lower_m: float = 0.0


class Stylist:
    """Draws a style per room without repeating floors or wall colours if it can."""

    def __init__(self, rng: np.random.Generator, palette: Palette):
        self.rng, self.palette = rng, palette
        self.wall_names = self._shuffle(list(WALL_COLORS))
        self.accent_names = self._shuffle(list(ACCENTS))
        self.wood_names = self._shuffle(list(WOOD_TONES))
        trims = ((238, 236, 230), (238, 236, 230), (150, 106, 68), (84, 66, 52))
        self.trim_color: Color = trims[int(rng.integers(4))]
        self.used = 0
        self.bedrooms = 0

    def _shuffle(self, names: list[str]) -> list[str]:
        return [names[k] for k in self.rng.permutation(len(names))]

    def style(self, kind: str) -> RoomStyle:
        """Return the next room's style."""
        rng, k = self.rng, self.used
        self.used += 1
        name = self.wall_names[k % len(self.wall_names)]
        wall = self._plaster(name, WALL_COLORS[name])
        accent, side = wall, -1
        lower, lower_m = -1, 0.0
        if kind == "bathroom":
            lower, lower_m = self._wall_tiles(), float(rng.choice([1.25, 2.05]))
        elif kind != "hallway" and rng.random() < 0.75:
            accent, side = self._accent(k, WALL_COLORS[name]), int(rng.integers(4))
        if kind in ("dining room", "hallway") and rng.random() < 0.5:
            lower, lower_m = self._panels(), 0.95
        floor, square, white = self._floor(kind), (2.5, 2.5), (236, 235, 231)
        ceiling = self.palette.get("ceiling", walls.plaster, square, white, 0.0, pixels_per_m=200.0)
        trim = self.palette.get(
            "trim", walls.paint, (1.0, 1.0), self.trim_color, pixels_per_m=120.0
        )
        return RoomStyle(floor, ceiling, trim, wall, accent, side, lower, lower_m)

    def _plaster(self, name: str, color: Color) -> int:
        return self.palette.get(
            f"plaster {name}", walls.plaster, (2.5, 2.5), color, pixels_per_m=200.0
        )

    def _accent(self, k: int, base: Color) -> int:
        name = self.accent_names[k % len(self.accent_names)]
        color = ACCENTS[name]
        soft = tuple(int(0.6 * b + 0.4 * c) for b, c in zip(base, color, strict=True))
        kind, size_m = int(self.rng.integers(5)), (1.6, 1.6)
        if kind == 0:
            brick = [(164, 92, 70), (196, 186, 174), (140, 104, 86)][k % 3]
            return self.palette.get(
                f"brick {brick}", walls.bricks, (1.5, 1.5), brick, pixels_per_m=330.0
            )
        if kind == 1:
            return self.palette.get(f"stripes {name}", walls.stripes, size_m, base, soft, 10)
        if kind == 2:
            return self.palette.get(f"damask {name}", walls.damask, size_m, base, soft, 5)
        return self._plaster(name, color)

    def _panels(self) -> int:
        color = self.trim_color if self.rng.random() < 0.5 else (214, 218, 212)
        return self.palette.get(f"panelling {color}", walls.panelling, (1.2, 1.2), color, 12)

    def _wall_tiles(self) -> int:
        color = WALL_TILES[int(self.rng.integers(5))]
        brick = bool(self.rng.random() < 0.5)
        count = (12, 6) if brick else (6, 6)
        joints = {"grout": (236, 236, 232), "offset": brick, "grout_px": 1.3}
        return self.palette.get(
            f"wall tiles {color}", floors.tiles, (1.2, 1.2), count, color, **joints
        )

    def _floor(self, kind: str) -> int:
        if kind == "bathroom":
            return self._floor_tiles(0.2 if self.rng.random() < 0.5 else 0.33)
        if kind == "kitchen":
            draw = self.rng.random()
            if draw < 0.25:
                return self._covering("terrazzo", floors.terrazzo, 2.0, (206, 201, 192))
            return self._floor_tiles(0.4, checker=draw < 0.55)
        if kind in ("living room", "hallway", "dining room", "stairwell"):
            return self._wood(0 if kind != "dining room" else 1)
        self.bedrooms += 1
        if self.rng.random() < 0.4:
            name = self.wall_names[-1 - self.bedrooms % len(self.wall_names)]
            base = tuple(int(0.72 * c) for c in WALL_COLORS[name])
            return self._covering(f"carpet {name}", floors.carpet, 2.0, base)
        if self.rng.random() < 0.2:
            return self._covering("concrete", floors.concrete, 3.0, (158, 155, 150), 256.0)
        return self._wood(self.bedrooms)

    def _covering(
        self, name: str, paint: Painter, side_m: float, color: Sequence[int], density: float = 320.0
    ) -> int:
        return self.palette.get(name, paint, (side_m, side_m), color, pixels_per_m=density)

    def _wood(self, k: int) -> int:
        name = self.wood_names[k % len(self.wood_names)]
        if (len(name) + k) % 3 == 0:
            return self._covering(f"herringbone {name}", floors.herringbone, 2.4, WOOD_TONES[name])
        return self.palette.get(
            f"planks {name}", floors.planks, (3.2, 2.4), 16, 3, WOOD_TONES[name], pixels_per_m=320.0
        )

    def _floor_tiles(self, side_m: float, checker: bool = False) -> int:
        color = TILE_COLORS[int(self.rng.integers(len(TILE_COLORS)))]
        other: Color | None = None
        if checker:
            others = ((66, 68, 72), (110, 128, 118), (150, 96, 74))
            color, other = (220, 216, 206), others[int(self.rng.integers(3))]
        veins = 0.12 if self.rng.random() < 0.5 else 0.0
        name, size = f"floor tiles {color} {other} {side_m}", 6 * side_m
        density, options = min(320.0, 768 / size), {"other": other, "veins": veins}
        return self.palette.get(
            name, floors.tiles, (size, size), (6, 6), color, pixels_per_m=density, **options
        )
