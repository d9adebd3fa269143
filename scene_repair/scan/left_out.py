"""Leave out parts of a scan: those that the user names, and skies and grounds around a building."""

import shlex
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
from scipy import sparse
from trimesh.triangles import closest_point

from ...formats.core.arrays import I32, I64, Array, Mask
from ...formats.core.errors import InputError, check_name
from ...formats.core.geometry import triangle_normals, triangle_normals_and_areas
from .record import Scan

# What is so many times as long as all the rest together dwarfs it.
DWARF = 8.0
# What is left as the building has at least so many faces, and this share of all.
LEAST_FACES, LEAST_SHARE = 12, 0.01
# Parts are named as the cause of a scan's size if it is so much shorter without them.
SHORTER, MOST_NAMED = 1.5, 4
# As many parts at most make a sky and its ground.
MOST_PARTS = 50
# A room's walls lie this near to the rest, in its lengths; a ground has no more than this share of
# steep faces there. Floor and ceiling lie so far apart; a ground is thinner, a sky further away.
NEAR, STEEP_SHARE = 2.5, 0.05
THINNEST, HIGHEST = 0.2, 6.0


def without_parts(scan: Scan, names: tuple[str, ...]) -> Scan:
    """Return the scan without what dwarfs the rest, and without parts named, also by pattern.

    Raises:
        UnknownNameError: a name fits no part; lists them.
        InputError: nothing would be left.
    """
    drop = np.zeros(len(scan.parts), dtype=bool)
    for name in names:
        # Whole names, or the last piece of a path.
        fits = np.array(
            [any(fnmatchcase(t, name) for t in (p, p.rpartition("/")[2])) for p in scan.parts]
        )
        if not fits.any():
            check_name("part to exclude", name, scan.parts)
        drop |= fits
    if names:
        scan = _selected(scan, ~drop[scan.face_part], "left out by --exclude: " + ", ".join(names))
    piece, labels = _pieces(scan)
    large = _dwarfing(scan, piece, len(labels))
    if not len(large):
        return scan
    shown = ", ".join(dict.fromkeys(labels[k] for k in large))
    line = (
        f"left out {shown}: more than {DWARF:g} times as long as all the rest, and without rooms, "
        "like a sky or a ground around a building"
    )
    return _selected(scan, ~np.isin(piece, large), line)


def _selected(scan: Scan, keep: Mask, line: str) -> Scan:
    if not keep.any():
        raise InputError(f"{line}: nothing is left")
    return replace(scan.take_faces(keep), warnings=(*scan.warnings, line))


def _pieces(scan: Scan) -> tuple[I64, list[str]]:
    """Return the piece (F,) of each face, and what to call it.

    The file's parts are the pieces; in a file of a single part what hangs together is one.
    """
    if len(set(scan.face_part.tolist())) > 1:
        return scan.face_part.astype(np.int64), [part or "a part" for part in scan.parts]
    a, b, c = scan.faces.T
    ends = (np.concatenate([a, b]), np.concatenate([b, c]))
    count = len(scan.vertices)
    links = sparse.coo_matrix((np.ones(len(ends[0]), dtype=bool), ends), shape=(count, count))
    components: Any = sparse.csgraph.connected_components(links, directed=False)
    return components[1][a].astype(np.int64), ["a separate surface"] * components[0]


def _dwarfing(scan: Scan, piece: I64, count: int) -> I64:
    """Return the pieces that dwarf all others together and have no rooms."""
    corners = scan.vertices[scan.faces]
    lower, upper = _bounds(corners, piece, count)
    size = (upper - lower).max(axis=1)
    order = np.argsort(-size)
    order = order[size[order] > 0]
    low = np.minimum.accumulate(lower[order][::-1])[::-1]
    high = np.maximum.accumulate(upper[order][::-1])[::-1]
    rest = (high - low).max(axis=1)
    cuts = np.flatnonzero(size[order][:-1] > DWARF * rest[1:])[:MOST_PARTS] + 1
    for cut in cuts[::-1]:
        middle = 0.5 * (low[cut] + high[cut])
        large = np.isin(piece, order[:cut])
        # Crumbs of a scan are no building.
        if (~large).sum() < max(LEAST_FACES, LEAST_SHARE * len(large)):
            continue
        # A sky or a ground lies around a building, not beside it as a stray piece does.
        first, last = lower[order[:cut]].min(axis=0), upper[order[:cut]].max(axis=0)
        across = np.argsort(last - first)[1:]  # a ground is thin in the third direction
        if ((middle < first) | (middle > last))[across].any():
            continue
        if not _has_rooms(corners[large], middle, float(rest[cut])):
            return order[:cut]
    return np.empty(0, dtype=np.int64)


def _bounds(corners: Array, piece: I32 | I64, count: int) -> tuple[Array, Array]:
    """Return the lower and upper corners (count, 3) of all pieces; inf and -inf of empty ones."""
    lower, upper = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(lower, piece, corners.min(axis=1))
    np.maximum.at(upper, piece, corners.max(axis=1))
    return lower, upper


def advice(scan: Scan) -> str:
    """Return advice on parts without which a scan would be much shorter; empty if there are none.

    These are the part that reaches furthest out, or else the longest ones together.
    """
    lower, upper = _bounds(scan.vertices[scan.faces], scan.face_part, len(scan.parts))

    def length(dropped: list[int]) -> float:
        low, high = np.delete(lower, dropped, axis=0), np.delete(upper, dropped, axis=0)
        return float((high.max(axis=0) - low.min(axis=0)).max()) if len(low) else np.inf

    outermost = {int(k) for k in (*lower.argmin(axis=0), *upper.argmax(axis=0))}
    longest = np.argsort((lower - upper).min(axis=1)).tolist()
    dropped = min(([k] for k in sorted(outermost)), key=length)
    for count in range(2, MOST_NAMED + 1):
        if SHORTER * length(dropped) < length([]):
            break
        dropped = longest[:count]
    times = length([]) / length(dropped)
    if times < SHORTER:
        return ""
    names = " ".join(shlex.quote(scan.parts[k]) for k in dropped)
    return f"with {names} it is {times:.3g} times as long: --exclude {names}; "


def _has_rooms(corners: Array, middle: Array, size: float) -> bool:
    """Return whether triangles (F, 3, 3) enclose a place (3,) of that size as rooms do."""
    nearest = closest_point(corners, np.broadcast_to(middle, (len(corners), 3)))
    near = corners[np.linalg.norm(nearest - middle, axis=1) < NEAR * size]
    if not len(near):
        return False
    normals, areas = triangle_normals_and_areas(near)
    axis = np.linalg.eigh((normals * areas[:, None]).T @ normals)[1][:, -1]
    steep = np.abs(normals @ axis) < 0.5
    if areas[steep].sum() > STEEP_SHARE * areas.sum():
        return True
    across = np.linalg.svd(axis[None])[2][1:]
    flat = (corners - middle) @ across.T
    following = np.roll(flat, -1, axis=1)
    side = flat[..., 0] * following[..., 1] - flat[..., 1] * following[..., 0]
    over = (side >= 0).all(axis=1) | (side <= 0).all(axis=1)
    met = corners[over]
    normals = triangle_normals(met)
    # Where the planes of the faces meet the line through the middle.
    slope = normals @ axis
    met, normals, slope = met[slope != 0], normals[slope != 0], slope[slope != 0]
    heights = np.einsum("fi,fi->f", met[:, 0] - middle, normals) / slope
    gaps = np.diff(np.sort(heights)) / size
    return bool(((gaps > THINNEST) & (gaps < HIGHEST)).any())
