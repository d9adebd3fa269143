"""Builds a whole home: plan, shell, furniture."""

from __future__ import annotations

import numpy as np

from ..config import ApartmentConfig
from ..looks.kit import Kit
from ..looks.palette import Palette
from ..looks.styles import ACCENTS, Stylist
from . import shell
from .decorate import ceiling_lamps, wall_hangings, windows
from .furnish import FURNISHERS
from .planner import draw_plan
from .space import RoomSpace
from .true_scene import SceneBuilder, TrueScene

# Furniture keeps this much more than a robot's radius free: a scan is never exact.
_RADIUS_MARGIN_M = 0.06


def build_apartment(rng: np.random.Generator, config: ApartmentConfig) -> TrueScene:
    """A furnished home; the same state of `rng` gives the same home.

    Raises:
        ValueError: `config` admits no home.
    """
    plan = draw_plan(rng, config)
    palette = Palette(rng.spawn(1)[0])
    builder = SceneBuilder(palette)
    stylist, kit = Stylist(rng, palette), Kit(rng, palette)
    styles = [stylist.style(room.kind) for room in plan.rooms]
    accents = list(ACCENTS.values())
    for index, style in enumerate(styles):
        for piece in shell.floor_and_ceiling(plan, index, style):
            builder.add(piece)
        for piece in shell.walls(plan, index, style):
            builder.add(piece)
    for hole in plan.openings:
        trim = styles[hole.room].trim
        if hole.kind == "window":
            builder.add(shell.window(plan, hole, trim, palette))
        elif hole.kind == "entry":
            color = accents[int(rng.integers(len(accents)))]
            builder.add(shell.entry_door(plan, hole, trim, palette, color))
        elif hole.room < hole.other_room:
            builder.add(shell.door_frame(plan, hole, trim))
    lamps: list[tuple[float, float, float]] = []
    for index, room in enumerate(plan.rooms):
        space = RoomSpace(plan, index, config.robot_radius_m + _RADIUS_MARGIN_M)
        pieces = FURNISHERS[room.kind](space, kit, rng)
        pieces += windows(space, kit, rng)
        pieces += wall_hangings(space, kit, rng)
        for lamp in ceiling_lamps(space, kit, rng):
            (x0, y0, z0), (x1, y1, _) = lamp.shape.bounds().tolist()
            lamps.append(((x0 + x1) / 2, (y0 + y1) / 2, z0 - 0.03))
            pieces.append(lamp)
        for piece in pieces:
            builder.add(piece)
    return builder.build(plan, lamps)
