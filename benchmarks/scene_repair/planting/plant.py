"""Planting holes into a scene: where they fit, and what the scan looks like afterwards."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from vlnpe.formats.core.arrays import Array, Mask
from vlnpe.formats.core.geometry import triangle_cross

from ..site import FLOOR_BAND_M, Site
from ..vertical import Surfaces, heights_near
from .cut import cut_exactly, cut_whole
from .decoys import DECOYS, Decoy
from .free_space import TRIES, ceiling_z_m, free_rectangle
from .glb import Part
from .shapes import KINDS, Outline, log_uniform, ragged

# Holes keep this far from each other, so that each remains separate.
APART_M = 0.15
# At least this share of a hole's outline must be floor that the scan has.
ON_FLOOR = {"at a wall": 0.5, "under furniture": 0.35, "threshold": 0.3}
ON_FLOOR_ELSEWHERE = 0.97
# A scan of smaller triangles loses whole ones at ragged holes.
FINE_TRIANGLES_M = 0.08
CUT_BAND_M = 0.04
# What is still at the same height was not cut.
SAME_SURFACE_M = 0.001


@dataclass(frozen=True)
class PlantedHole:
    """A hole that was cut, or an opening that belongs there.

    Attributes:
        name: unique in its scene.
        kind: of `KINDS` or `DECOYS`.
        outline: where, in the scene's plan; for a decoy the opening's inside.
        size_m: its longest side.
        floor_z_m: of the floor around it.
        ragged: whether its rim was torn instead of cut.
        decoy: whether it must stay open.
    """

    name: str
    kind: str
    outline: Outline
    size_m: float
    floor_z_m: float
    ragged: bool = False
    decoy: bool = False


@dataclass(frozen=True)
class Planted:
    """A scene with holes.

    Attributes:
        site: the scene as it was.
        parts: its meshes with the holes cut, only those that changed differ.
        decoys: geometry that was added.
        holes: what was planted.
    """

    site: Site
    parts: list[Part]
    decoys: list[Decoy]
    holes: list[PlantedHole]


def plant(
    site: Site,
    rng: np.random.Generator,
    holes: int = 24,
    decoys: Sequence[str] = (),
    kinds: Sequence[str] = tuple(KINDS),
    sizes_m: tuple[float, float] | None = None,
    within: Mask | None = None,
) -> Planted:
    """Cut holes and build decoys where they fit.

    Args:
        site: the scene.
        rng: decides everything.
        holes: how many to try for, cycling through `kinds`.
        decoys: names from `DECOYS`, each built once if there is room.
        kinds: names from `KINDS`.
        sizes_m: least and greatest longer side; None = as the kind has it.
        within: (rows, columns) cells in which their middles must lie; None = anywhere.
    """
    taken = np.zeros(site.grid.shape, dtype=bool)
    fine = _fine(site)
    built: list[Decoy] = []
    planted: list[PlantedHole] = []
    parts = list(site.parts)
    for name in decoys:
        place = free_rectangle(site, rng, taken, DECOYS[name].sizes_m)
        if place is None:
            continue
        lower, upper = place
        decoy = DECOYS[name].build(
            lower, upper, site.floor_z_m, ceiling_z_m(site, lower, upper), rng
        )
        parts = [_opened(part, decoy, site.floor_z_m) for part in parts]
        built.append(decoy)
        planted.append(
            PlantedHole(
                f"{name} {len(planted)}",
                name,
                decoy.inside,
                decoy.inside.size_m(),
                site.floor_z_m,
                decoy=True,
            )
        )
        taken |= _near_box(site, lower - 0.3, upper + 0.3)
    for k in range(holes):
        kind = kinds[k % len(kinds)]
        outline = _placed(site, rng, kind, taken, sizes_m, within)
        if outline is None:
            continue
        torn = bool(rng.random() < 0.35)
        if torn and not fine:
            outline = ragged(outline, rng)
        before = parts
        parts = [_cut(part, outline, site.floor_z_m, torn and fine) for part in parts]
        if all(new is old for new, old in zip(parts, before, strict=True)):
            # Too small to take a whole triangle out.
            continue
        name = f"{kind} {len(planted)}"
        planted.append(
            PlantedHole(name, kind, outline, outline.size_m(), site.floor_z_m, ragged=torn)
        )
        taken |= _near(site, outline, APART_M)
    return Planted(site, parts, built, planted)


def floor_faces(part: Part, floor_z_m: float, band_m: float = CUT_BAND_M) -> Mask:
    """Return (F,) nearly level faces at the floor's height."""
    corners = part.points_m[part.faces]
    near = np.abs(corners[..., 2] - floor_z_m).max(axis=1) <= band_m
    cross = triangle_cross(corners)
    length = np.linalg.norm(cross, axis=1)
    return near & (np.abs(cross[:, 2]) > 0.6 * length) & (length > 0)


def _fine(site: Site) -> bool:
    """Return whether most of the floor consists of small triangles."""
    corners = [p.points_m[p.faces[floor_faces(p, site.floor_z_m)]] for p in site.parts]
    joint = np.concatenate(corners)
    sides = np.roll(joint, -1, axis=1) - joint
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return float(area[longest < FINE_TRIANGLES_M].sum()) > 0.5 * float(area.sum())


def _cut(part: Part, outline: Outline, floor_z_m: float, whole: bool) -> Part:
    chosen = floor_faces(part, floor_z_m)
    if not chosen.any():
        return part
    return (cut_whole if whole else cut_exactly)(part, chosen, outline)


def _opened(part: Part, decoy: Decoy, floor_z_m: float) -> Part:
    """Return the part without the floor, and if need be the ceiling, of a decoy's opening."""
    part = cut_exactly(part, floor_faces(part, floor_z_m, 0.07), decoy.opening)
    if decoy.open_above:
        high = part.points_m[part.faces][..., 2].min(axis=1) > floor_z_m + 1.7
        part = cut_exactly(part, high, decoy.opening)
    return part


def _placed(
    site: Site,
    rng: np.random.Generator,
    kind: str,
    taken: Mask,
    sizes_m: tuple[float, float] | None,
    within: Mask | None,
) -> Outline | None:
    """Return an outline of a kind at a place that suits it; None if none is found."""
    floor = site.true_floor & site.scanned
    where = _usual_cells(site, kind, floor) & ~taken
    if within is not None:
        where &= within
    cells = np.argwhere(where)
    if not len(site.doors if kind == "threshold" else cells):
        return None
    least, most = sizes_m or KINDS[kind].sizes_m
    for trial in range(TRIES):
        # The longer it takes, the smaller it has to be.
        size = log_uniform(rng, least, max(most * 0.97**trial, least * 1.2))
        outline = KINDS[kind].draw(rng, size)
        if kind == "threshold":
            lower, upper = site.doors[int(rng.integers(len(site.doors)))]
            across = 1 if upper[0] - lower[0] > upper[1] - lower[1] else 0
            turn = 0.0 if across else np.pi / 2
            spot = (lower + upper) / 2 + rng.normal(0, 0.05, 2)
        else:
            spot = site.grid.center_of(cells[int(rng.integers(len(cells)))])
            spot = spot + rng.uniform(-0.5, 0.5, 2) * site.grid.cell_m
            turn = rng.uniform(0, 2 * np.pi)
        outline = outline.moved(spot, turn)
        covered = _near(site, outline, 0.0)
        if (covered & taken).any() or not covered.any():
            continue
        if (covered & floor).sum() < ON_FLOOR.get(kind, ON_FLOOR_ELSEWHERE) * covered.sum():
            continue
        return outline
    return None


def _usual_cells(site: Site, kind: str, floor: Mask) -> Mask:
    """Return the cells in whose neighbourhood holes of a kind lie."""
    if kind == "at a wall":
        near = np.asarray(ndimage.distance_transform_edt(~site.wall)) * site.grid.cell_m
        return floor & (near < 0.12)
    if kind == "under furniture":
        return floor & site.furniture & ~site.wall
    return floor & ~site.wall


def _near(site: Site, outline: Outline, within_m: float) -> Mask:
    """Return the cells whose centre lies inside an outline or near it; never none."""
    lower, upper = outline.bounds_m()
    mask = np.zeros(site.grid.shape, dtype=bool)
    first = np.maximum(site.grid.cell_of(lower) - 2, 0)
    last = np.minimum(site.grid.cell_of(upper) + 3, site.grid.shape)
    if np.any(first >= last):
        return mask
    rows, columns = np.meshgrid(
        *(np.arange(a, b) for a, b in zip(first, last, strict=True)), indexing="ij"
    )
    centers = site.grid.center_of(np.stack([rows, columns], axis=-1)).reshape(-1, 2)
    mask[first[0] : last[0], first[1] : last[1]] = outline.contains(centers).reshape(rows.shape)
    # Thin outlines may miss all centres.
    cells = site.grid.cell_of(np.concatenate(outline.rings))
    cells = cells[site.grid.inside(cells)]
    mask[cells[:, 0], cells[:, 1]] = True
    if within_m > 0:
        mask = ndimage.binary_dilation(mask, iterations=round(within_m / site.grid.cell_m))
    return mask


def _near_box(site: Site, lower: Array, upper: Array) -> Mask:
    x0, y0, x1, y1 = *lower, *upper
    return _near(site, Outline([np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])]), 0.0)


def removed_floor(site: Site, before: Surfaces, after: Surfaces, points: Array) -> Array:
    """Return (N,) height of the true floor that was cut away at points (N, 2), NaN where none was.

    Args:
        site: the scene.
        before, after: what lay near its floor before and after cutting.
        points: where.
    """
    had = heights_near(before, points, site.floor_z_m, FLOOR_BAND_M)
    gone = np.isnan(heights_near(after, points, np.nan_to_num(had), SAME_SURFACE_M))
    cells = site.grid.cell_of(points)
    # No floor is expected beneath walls.
    true = site.grid.inside(cells)
    true[true] = site.true_floor[tuple(cells[true].T)]
    height = np.where(true & gone, had, np.nan)
    if not site.exact:
        return height
    # A fused scan rounds the corner between floor and wall, and wavers; the truth does not.
    on_rug = np.zeros(len(points), dtype=bool)
    for lower, upper in site.rugs:
        on_rug |= np.all((points > lower) & (points < upper), axis=1)
    return np.where(np.isfinite(height) & ~on_rug, site.floor_z_m, height)


def replaced(planted: Planted) -> list[Part]:
    """Return the parts that were cut."""
    pairs = zip(planted.parts, planted.site.parts, strict=True)
    return [new for new, old in pairs if new is not old]
