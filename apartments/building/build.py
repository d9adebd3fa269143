"""Builds a whole building: plans of its storeys, shell, furniture."""

import numpy as np

from ..config import ApartmentConfig
from ..materials.kit import Kit
from ..materials.palette import Palette
from ..materials.styles import ACCENTS, RoomStyle, Stylist
from . import shell
from .decorate import ceiling_lamps, wall_hangings, windows
from .furnish import furnisher
from .furniture.piece import Piece
from .plan import FloorPlan
from .planner import draw_storeys
from .space import RoomSpace
from .stairs import staircase, stairwell_edges
from .true_scene import SceneBuilder, TrueScene

# Furniture keeps this much more than a robot's radius free: a scan is never exact.
_RADIUS_MARGIN_M = 0.06

Point = tuple[float, float, float]


def build_scene(
    rng: np.random.Generator, config: ApartmentConfig, painted: bool = True
) -> TrueScene:
    """Return a furnished building; the same state of `rng` gives the same building.

    With `painted`, the images of the materials are painted; see `Palette`.

    Raises:
        UnknownNameError: there is no such kind of building.
        ValueError: `config` admits no such building.
    """
    storeys = draw_storeys(rng, config)
    palette = Palette(rng.spawn(1)[0], painted)
    builder = SceneBuilder(palette)
    stylist, kit = Stylist(rng, palette), Kit(rng, palette)
    lamps: list[Point] = []
    for storey, plan in enumerate(storeys):
        styles = [stylist.style(room.kind) for room in plan.rooms]
        pieces = _shell(rng, plan, styles, palette)
        if storey:
            below = storeys[storey - 1]
            slab_m = plan.floor_z_m - below.floor_z_m - below.ceiling_m
            for void in (b for b in plan.blocks if b.kind == "void"):
                pieces += stairwell_edges(void, slab_m, styles[void.room].wall, kit.wood())
        for block in plan.blocks:
            if block.kind == "stairs":
                pieces += staircase(block, kit.wood(), styles[block.room].wall, kit.wood(1))
            elif block.kind == "column":
                pieces.append(shell.column(block, styles[block.room].wall))
        things, lights = _furniture(rng, plan, kit, config)
        for piece in pieces + things:
            builder.add(piece.moved(z_m=plan.floor_z_m) if plan.floor_z_m else piece)
        lamps += [(x, y, z + plan.floor_z_m) for x, y, z in lights]
    return builder.build(storeys, lamps)


def _shell(
    rng: np.random.Generator, plan: FloorPlan, styles: list[RoomStyle], palette: Palette
) -> list[Piece]:
    """Return the floors, ceilings, walls and what fills their openings."""
    accents = list(ACCENTS.values())
    pieces: list[Piece] = []
    for index, style in enumerate(styles):
        pieces += shell.floor_and_ceiling(plan, index, style)
        pieces += shell.walls(plan, index, style)
    for hole in plan.openings:
        trim = styles[hole.room].trim
        if hole.kind == "window":
            pieces.append(shell.window(plan, hole, trim, palette))
        elif hole.kind == "entry":
            color = accents[int(rng.integers(len(accents)))]
            pieces.append(shell.entry_door(plan, hole, trim, palette, color))
        elif hole.room < hole.other_room:
            if hole.kind == "passage":
                near, far = styles[hole.room].wall, styles[hole.other_room].wall
                pieces.append(shell.passage_lining(plan, hole, near, far))
            else:
                pieces.append(shell.door_frame(plan, hole, trim))
    return pieces


def _furniture(
    rng: np.random.Generator, plan: FloorPlan, kit: Kit, config: ApartmentConfig
) -> tuple[list[Piece], list[Point]]:
    """Return what stands and hangs in the rooms, and where the lamps shine."""
    pieces: list[Piece] = []
    lamps: list[Point] = []
    for index, room in enumerate(plan.rooms):
        space = RoomSpace(plan, index, config.robot_radius_m + _RADIUS_MARGIN_M)
        pieces += furnisher(config.kind, room.kind)(space, kit, rng)
        pieces += windows(space, kit, rng)
        pieces += wall_hangings(space, kit, rng)
        for lamp in ceiling_lamps(space, kit, rng):
            (x0, y0, z0), (x1, y1, _) = lamp.shape.bounds().tolist()
            lamps.append(((x0 + x1) / 2, (y0 + y1) / 2, z0 - 0.03))
            pieces.append(lamp)
    return pieces, lamps
