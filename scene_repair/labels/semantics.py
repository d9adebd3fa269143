"""Label faces with categories, and list the named objects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...formats.core.geometry import triangle_normals
from ...formats.scene.bundle import LabeledObject
from ..scan.record import Scan, ScanObject
from .categories import THINGS
from .files import LabelBox

# How far outside its labelled box a face may lie and still belong to it.
MARGIN_M = 0.03
# Level faces this near to a box's bottom are the floor it stands on.
FOOT_M, LEVEL_NORMAL = 0.06, 0.7
ROOM_PREFIX = "room:"
# What a robot walks on; everything else that carries a name is no floor.
FLOOR_CATEGORIES = frozenset(
    {"floor", "carpet", "rug", "mat", "ground", "tile", "tiles", "threshold", "doormat", "ramp"}
)


def label_by_boxes(scan: Scan, boxes: list[LabelBox], source_to_world: NDArray[np.float64]) -> Scan:
    """Label faces by boxes: named parts by their name, others by the smallest box they lie in.

    A box stands on the floor but does not own it: level faces at its bottom stay without a label,
    unless it is a floor's or a rug's.

    Args:
        scan: in source coordinates.
        boxes: in source coordinates; rooms are no things and left out.
        source_to_world: (4, 4) similarity, which tells what is up.
    """
    things = [b for b in boxes if not b.category.startswith(ROOM_PREFIX) and b.category]
    things = [b for b in things if not _is_copy(b, things)]
    if not things:
        return scan
    category = {b.name: b.category for b in things}
    objects = tuple(ScanObject(o.name, category.get(o.name, o.category)) for o in scan.objects)
    scale = float(np.linalg.norm(source_to_world[2, :3]))
    up = source_to_world[2, :3] / scale
    open_ = np.flatnonzero(scan.face_object < 0)
    corners = scan.vertices[scan.faces[open_]]
    centers = corners.mean(axis=1)
    level = np.abs(triangle_normals(corners) @ up) > LEVEL_NORMAL
    height = (corners @ up).max(axis=1)
    face_object = scan.face_object.copy()
    for k in sorted(range(len(things)), key=lambda k: -float(np.prod(things[k].half))):
        selected = things[k].contains(centers, MARGIN_M / scale)
        if not _floor_like(things[k].category):
            bottom = float((things[k].corners() @ up).min())
            selected &= ~(level & (height < bottom + FOOT_M / scale))
        face_object[open_[selected]] = len(objects) + k
    added = tuple(ScanObject(b.name, b.category) for b in things)
    return replace(scan, face_object=face_object, objects=(*objects, *added))


def _is_copy(box: LabelBox, boxes: list[LabelBox]) -> bool:
    """Return whether a flat box lies inside one of the same category: its top surface."""
    return any(
        other is not box
        and other.category == box.category
        and np.prod(other.half) > np.prod(box.half)
        and bool(other.contains(box.center[None], 0.15)[0])
        and float(box.half.min()) < 0.06
        for other in boxes
    )


def structural(scan: Scan) -> NDArray[np.bool_]:
    """Return (F,) whether a face's object is a wall or window by name."""
    named = [o.category.split()[-1:] in (["wall"], ["window"]) for o in scan.objects]
    return np.array([*named, False])[scan.face_object]


def not_floor(scan: Scan) -> NDArray[np.bool_]:
    """Return (F,) whether a face's object is certainly not floor by name.

    A node called after nothing known (`apartment`, `chunk_12`) may hold floor as well.
    """
    named = [bool(THINGS.intersection(o.category.split()[-1:])) for o in scan.objects]
    return np.array([*named, False])[scan.face_object]


def _floor_like(category: str) -> bool:
    """Return whether the category ends in a word for floor: a tile floor, not a floor lamp."""
    return bool(FLOOR_CATEGORIES.intersection(category.split()[-1:]))


def labelled_objects(
    scan: Scan,
    boxes: list[LabelBox],
    *,
    vertices_world_m: NDArray[np.float64],
    source_to_world: NDArray[np.float64],
    level_floor_z_m: tuple[float, ...],
) -> tuple[tuple[LabeledObject, ...], NDArray[np.int32]]:
    """Return named objects with world bounds: label boxes first, then named nodes.

    Returns:
        The objects, and for each of `scan.objects` the index of its own, −1 = none.
    """
    found: list[LabeledObject] = []
    names: set[str] = set()
    boxed: dict[str, int] = {}
    index = np.full(len(scan.objects), -1, dtype=np.int32)

    def add(name: str, category: str, points: NDArray[np.float64]) -> None:
        unique, n = name, 1
        while unique in names:
            n += 1
            unique = f"{name}_{n}"
        names.add(unique)
        low, high = points.min(axis=0), points.max(axis=0)
        found.append(
            LabeledObject(
                unique,
                category,
                (float(low[0]), float(low[1]), float(low[2])),
                (float(high[0]), float(high[1]), float(high[2])),
                _level_of(float(low[2]), float(high[2]), level_floor_z_m),
            )
        )

    for box in boxes:
        if not box.category or _is_copy(box, boxes):
            continue
        corners = box.corners() @ source_to_world[:3, :3].T + source_to_world[:3, 3]
        boxed.setdefault(box.name, len(found))
        add(box.name, box.category, corners)
    passed_over = {b.name for b in boxes}
    for k, (obj, selected) in enumerate(zip(scan.objects, scan.object_faces(), strict=True)):
        if obj.name in passed_over:
            index[k] = boxed.get(obj.name, -1)
        elif len(selected):
            index[k] = len(found)
            add(obj.name, obj.category, vertices_world_m[scan.faces[selected].ravel()])
    return tuple(found), index


def _level_of(low: float, high: float, level_floor_z_m: tuple[float, ...]) -> int:
    """Return the highest level below the object's centre."""
    middle = 0.5 * (low + high)
    below = [k for k, z in enumerate(level_floor_z_m) if z <= middle + 0.05]
    return below[-1] if below else -1
