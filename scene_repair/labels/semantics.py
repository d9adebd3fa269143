"""Label faces with categories, and list the named objects."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ...formats.core.arrays import I32, Array, Mask
from ...formats.core.geometry import triangle_normals
from ...formats.scene.bundle import LabeledObject
from ..scan.record import Scan, ScanObject
from .categories import THINGS
from .files import LabelBox

# How far outside its labelled box a face may lie and still belong to it.
MARGIN_M = 0.03
# A box thinner than this may be the top of another one, grown by the margin.
FLAT_M, COPY_MARGIN_M = 0.06, 0.15
# From here on a tree of points is faster than looking at all of them.
MANY = 64
# A share of all points; with more of them near a box, the tree does not help.
MOST_OF_ALL = 0.1
# Level faces this near to a box's bottom are the floor it stands on.
FOOT_M, LEVEL_NORMAL = 0.06, 0.7
ROOM_PREFIX = "room:"
# What a robot walks on; everything else that has a name is not floor.
FLOOR_CATEGORIES = frozenset(
    {"floor", "carpet", "rug", "mat", "ground", "tile", "tiles", "threshold", "doormat", "ramp"}
)


def label_by_boxes(scan: Scan, boxes: list[LabelBox], source_to_world: Array) -> Scan:
    """Label faces by boxes: named parts by their name, others by the smallest box they lie in.

    A box stands on the floor but does not own it: level faces at its bottom stay without a label,
    unless it is a floor's or a rug's. Rooms are no things and left out. Scan and boxes are in
    source coordinates; `source_to_world` defines what is up.
    """
    things = [b for b in boxes if not b.category.startswith(ROOM_PREFIX) and b.category]
    things = [b for b, copied in zip(things, copies(things), strict=True) if not copied]
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
    tree = KDTree(centers) if len(things) > MANY and len(centers) else None
    for k in sorted(range(len(things)), key=lambda k: -float(np.prod(things[k].half))):
        near = _within(things[k], tree, centers, MARGIN_M / scale)
        if not FLOOR_CATEGORIES.intersection(things[k].category.split()[-1:]):
            bottom = float((things[k].corners() @ up).min())
            near = near[~(level[near] & (height[near] < bottom + FOOT_M / scale))]
        face_object[open_[near]] = len(objects) + k
    added = tuple(ScanObject(b.name, b.category) for b in things)
    return replace(scan, face_object=face_object, objects=(*objects, *added))


def _within(box: LabelBox, tree: KDTree | None, points: Array, margin: float) -> NDArray[np.intp]:
    """Return which of `points` (N, 3) lie in an enlarged box; a tree of them is for many boxes."""
    reach = float(np.linalg.norm(box.half + margin)) * (1 + 1e-9)
    count = 0 if tree is None else tree.query_ball_point(box.center, reach, return_length=True)
    if tree is None or count > MOST_OF_ALL * len(points):
        return np.flatnonzero(box.contains(points, margin))
    near = np.sort(np.asarray(tree.query_ball_point(box.center, reach), dtype=np.intp))
    return near[box.contains(points[near], margin)] if len(near) else near


def copies(boxes: Sequence[LabelBox]) -> Mask:
    """Return which boxes are flat and lie inside a larger one of their category: its top."""
    copied = np.zeros(len(boxes), dtype=bool)
    groups: dict[str, list[int]] = {}
    for k, box in enumerate(boxes):
        groups.setdefault(box.category, []).append(k)
    for members in groups.values():
        flat = np.array([k for k in members if float(boxes[k].half.min()) < FLAT_M], dtype=np.intp)
        if not len(flat) or len(members) < 2:
            continue
        centers = np.stack([boxes[k].center for k in flat])
        flat, centers = flat[order := np.argsort(centers[:, 0])], centers[order]
        volumes = np.array([float(np.prod(boxes[k].half)) for k in flat])
        left = np.ones(len(flat), dtype=bool)
        for k in members:
            reach = float(np.linalg.norm(boxes[k].half + COPY_MARGIN_M))
            middle = boxes[k].center[0]
            first, stop = np.searchsorted(centers[:, 0], [middle - reach, middle + reach])
            smaller = volumes[first:stop] < float(np.prod(boxes[k].half))
            near = first + np.flatnonzero(left[first:stop] & smaller)
            if len(near):
                # A flat box has no top: what hangs on the other side of its wall is no copy.
                margin = MARGIN_M if float(boxes[k].half.min()) < FLAT_M else COPY_MARGIN_M
                left[near[boxes[k].contains(centers[near], margin)]] = False
        copied[flat[~left]] = True
    return copied


def structural(scan: Scan) -> Mask:
    """Return (F,) whether a face's object is a wall or window by name."""
    named = [o.category.split()[-1:] in (["wall"], ["window"]) for o in scan.objects]
    return np.array([*named, False])[scan.face_object]


def not_floor(scan: Scan) -> Mask:
    """Return (F,) whether a face's object is certainly not floor by name.

    A node called after nothing known (`apartment`, `chunk_12`) may hold floor as well.
    """
    named = [bool(THINGS.intersection(o.category.split()[-1:])) for o in scan.objects]
    return np.array([*named, False])[scan.face_object]


def labelled_objects(
    scan: Scan,
    boxes: list[LabelBox],
    *,
    vertices_world_m: Array,
    source_to_world: Array,
    level_floor_z_m: tuple[float, ...],
) -> tuple[tuple[LabeledObject, ...], I32]:
    """Return named objects with world bounds: label boxes first, then named nodes.

    For each of `scan.objects` the index of its own is returned, too; −1 = none.
    """
    labelled: list[LabeledObject] = []
    names: set[str] = set()
    numbers: dict[str, int] = {}  # the last that each name was given
    boxed: dict[str, int] = {}
    index = np.full(len(scan.objects), -1, dtype=np.int32)

    def add(name: str, category: str, points: Array) -> None:
        unique, n = name, numbers.get(name, 1)
        while unique in names:
            n += 1
            unique = f"{name}_{n}"
        numbers[name] = n
        names.add(unique)
        low, high = points.min(axis=0), points.max(axis=0)
        labelled.append(
            LabeledObject(
                unique,
                category,
                (float(low[0]), float(low[1]), float(low[2])),
                (float(high[0]), float(high[1]), float(high[2])),
                # The highest level below its centre.
                sum(z <= 0.5 * float(low[2] + high[2]) + 0.05 for z in level_floor_z_m) - 1,
            )
        )

    for box, copied in zip(boxes, copies(boxes), strict=True):
        if not box.category or copied:
            continue
        corners = box.corners() @ source_to_world[:3, :3].T + source_to_world[:3, 3]
        boxed.setdefault(box.name, len(labelled))
        add(box.name, box.category, corners)
    passed_over = {b.name for b in boxes}
    for k, (obj, selected) in enumerate(zip(scan.objects, scan.object_faces(), strict=True)):
        if obj.name in passed_over:
            index[k] = boxed.get(obj.name, -1)
        elif len(selected):
            index[k] = len(labelled)
            add(obj.name, obj.category, vertices_world_m[scan.faces[selected].ravel()])
    return tuple(labelled), index
