"""Measuring a repaired scene against the truth, on the triangles that it exports."""

import json
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.spatial import KDTree

from vlnpe.formats.core.arrays import Array, Mask
from vlnpe.formats.core.frames import habitat_to_world_position, world_to_habitat_position
from vlnpe.formats.scene.bundle import SceneBundle

from .planting.decoys import WALL_M
from .planting.plant import Planted, PlantedHole, removed_floor
from .planting.shapes import Outline
from .site import NEAR_FLOOR_M, cell_centers, soup_of
from .vertical import Surfaces, heights_near

# A point is filled when there is a surface this near to where the floor was.
FILLED_M = 0.025
# A hole is filled when so much of it is; a decoy counts as filled from so much on.
FILLED_SHARE, DECOY_SHARE = 0.98, 0.02
OPEN_BAND_M = 0.1
COUNTED_FROM_M = 0.05
# Rays stand no nearer to each other.
FINEST_M = 0.001
# Exported positions are 32-bit floats.
SAME_M = 2e-5
# Around a bump that was flattened its foot may move, too.
BUMP_MARGIN_M = 0.12


@dataclass(frozen=True)
class HoleScore:
    """Outcome of one planted hole.

    Attributes:
        hole: which.
        area_m2: of floor that was cut away (of the whole inside, for a decoy).
        filled_m2: of it where there is floor again.
        errors_m: height errors of the patch, a sample.
        reason: what the repair's record says about it, if it is not filled.
    """

    hole: PlantedHole
    area_m2: float
    filled_m2: float
    errors_m: Array
    reason: str

    @property
    def share(self) -> float:
        """Filled share of the area."""
        return self.filled_m2 / self.area_m2 if self.area_m2 > 0 else 1.0

    @property
    def filled(self) -> bool:
        """Whether it counts as filled."""
        return self.share >= (DECOY_SHARE if self.hole.decoy else FILLED_SHARE)


@dataclass(frozen=True)
class Score:
    """Outcome of one scene.

    Attributes:
        scene: its name.
        holes: the planted ones, and decoys.
        floor_m2: true floor.
        outside_m2: floor added outside the building.
        in_walls_m2: floor added inside the building where walls stand.
        before, after: share of the true floor that the scan with holes, and the repaired scene,
            have; only where all the floor is known.
        natural_errors_m: height errors where the scan itself had gaps; likewise.
        moved: vertices of the scan that moved, flattened bumps apart.
        moved_most_m: how far.
        vertices: vertices of the scan.
    """

    scene: str
    holes: list[HoleScore]
    floor_m2: float
    outside_m2: float
    in_walls_m2: float
    before: float
    after: float
    natural_errors_m: Array
    moved: int
    moved_most_m: float
    vertices: int


@dataclass(frozen=True)
class Truth:
    """The planted holes, and the surfaces near the floor before and after cutting."""

    planted: Planted
    before: Surfaces
    after: Surfaces


def truth_of(planted: Planted) -> Truth:
    """Look at the floor with and without its holes."""
    site = planted.site
    return Truth(planted, site.near_floor(site.parts), site.near_floor(planted.parts))


def score(planted: Planted, bundle: SceneBundle) -> Score:
    """Compare a repaired scene with what was planted.

    Everything is measured in the source's own frame, turned z up; the transform that the bundle
    records is inverted.
    """
    visual = bundle.visual()
    vertices = in_plan(visual.vertices.astype(np.float64), bundle)
    faces = visual.faces.astype(np.int64)
    record = json.loads((bundle.root / "repair.json").read_text())
    site = planted.site
    z = site.floor_z_m
    truth = truth_of(planted)
    repaired = Surfaces.between(vertices, faces, z - NEAR_FLOOR_M, z + NEAR_FLOOR_M)
    holes = [
        _explained(score_hole(truth, hole, repaired), truth, repaired, record, bundle)
        for hole in planted.holes
    ]
    centers = cell_centers(site.grid)
    cut = soup_of(planted.parts)
    cell_m2 = site.grid.cell_m**2
    had = np.isfinite(heights_near(truth.after, centers, z, FILLED_M))
    after = heights_near(repaired, centers, z, FILLED_M)
    has = np.isfinite(after)
    added = has & ~had
    closed_up = _decoy_cells(planted)
    floor = site.true_floor.ravel() & ~closed_up
    moved = _moved(cut[0][np.unique(cut[1])], vertices, record, bundle)
    no_floor = ~floor if site.exact else site.wall.ravel()
    natural = floor & added & ~site.scanned.ravel()
    return Score(
        scene=site.name,
        holes=holes,
        floor_m2=float(floor.sum()) * cell_m2,
        outside_m2=float((added & ~site.building.ravel()).sum()) * cell_m2,
        in_walls_m2=float((added & site.building.ravel() & no_floor & ~closed_up).sum()) * cell_m2,
        before=float(had[floor].mean()),
        after=float(has[floor].mean()),
        natural_errors_m=after[natural] - z if site.exact else np.empty(0),
        moved=len(moved),
        moved_most_m=float(moved.max(initial=0.0)),
        vertices=len(np.unique(cut[1])),
    )


def _decoy_cells(planted: Planted) -> Mask:
    """Return (cells,) in decoys and under the walls around them."""
    site = planted.site
    mask = np.zeros(site.grid.shape, dtype=bool)
    centers = cell_centers(site.grid)
    for hole in planted.holes:
        if hole.decoy:
            mask |= hole.outline.contains(centers).reshape(site.grid.shape)
    around = round((WALL_M + 0.04) / site.grid.cell_m)
    return ndimage.binary_dilation(mask, np.ones((3, 3)), iterations=around).ravel()


def in_plan(points_world_m: Array, bundle: SceneBundle) -> Array:
    """Convert world points of a bundle to the source's frame, z up."""
    inverse = np.linalg.inv(bundle.source_to_world)
    source = points_world_m @ inverse[:3, :3].T + inverse[:3, 3]
    return habitat_to_world_position(source)


def in_world(points_m: Array, bundle: SceneBundle) -> Array:
    """Return the way back."""
    source = world_to_habitat_position(points_m)
    return source @ bundle.source_to_world[:3, :3].T + bundle.source_to_world[:3, 3]


def sample_inside(outline: Outline, count: int = 1500) -> tuple[Array, float]:
    """Return the points (N, 2) on a regular raster inside an outline, and the area [m²] of each."""
    lower, upper = outline.bounds_m()
    step = float(np.sqrt(np.prod(upper - lower) / count))
    while True:
        x, y = (np.arange(a + step / 2, b, step) for a, b in zip(lower, upper, strict=True))
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        inside = points[outline.contains(points)]
        # Thin shapes fill little of their box.
        if len(inside) >= count / 5 or step < FINEST_M:
            return inside, step * step
        step /= 2


def score_hole(scene: Truth, hole: PlantedHole, repaired: Surfaces) -> HoleScore:
    """Return how much of a planted hole or decoy there is floor in."""
    points, truth, each_m2 = _rays(scene, hole)
    heights = heights_near(repaired, points, truth, OPEN_BAND_M if hole.decoy else FILLED_M)
    present = np.isfinite(heights)
    errors = np.empty(0) if hole.decoy else (heights - truth)[present]
    return HoleScore(hole, len(points) * each_m2, float(present.sum()) * each_m2, errors, "")


def _rays(scene: Truth, hole: PlantedHole) -> tuple[Array, Array, float]:
    """Return points (N, 2) in a hole that had floor, its heights (N,), and the area of each."""
    points, each_m2 = sample_inside(hole.outline)
    if hole.decoy:
        return points, np.full(len(points), hole.floor_z_m), each_m2
    truth = removed_floor(scene.planted.site, scene.before, scene.after, points)
    present = np.isfinite(truth)
    return points[present], truth[present], each_m2


def _explained(
    result: HoleScore,
    scene: Truth,
    repaired: Surfaces,
    record: dict[str, Any],
    bundle: SceneBundle,
) -> HoleScore:
    """Return the same with the record's reason, if it is not as it should be."""
    hole = result.hole
    if result.filled != hole.decoy:
        return result
    points, truth, _ = _rays(scene, hole)
    heights = heights_near(repaired, points, truth, OPEN_BAND_M if hole.decoy else FILLED_M)
    wrong = points[np.isfinite(heights) == hole.decoy]
    return replace(result, reason=_reason(wrong, record, bundle, hole))


def _reason(points: Array, record: dict[str, Any], bundle: SceneBundle, hole: PlantedHole) -> str:
    """Return what `repair.json` says where points (N, 2) lie."""
    high = np.column_stack([points, np.full(len(points), hole.floor_z_m)])
    where = in_world(high, bundle)[:, :2]
    shares: dict[str, float] = {}
    for level in record["levels"]:
        for entry in level["holes"]:
            inside = Outline([np.array(ring) for ring in entry["polygons_xy_m"]]).contains(where)
            if inside.any():
                text = f"{entry['action']}, {entry['cause']}: {entry['reason']}"
                shares[text] = shares.get(text, 0.0) + float(inside.mean())
    if not shares:
        return "no entry in repair.json"
    best = max(shares, key=lambda text: shares[text])
    return f"{best} ({100 * shares[best]:.0f} % of it)"


def _moved(
    before: Array,
    after: Array,
    record: dict[str, Any],
    bundle: SceneBundle,
) -> Array:
    """Return how far vertices of the scan moved [m], of those that did outside flattened bumps."""
    gap, _ = KDTree(after).query(before, distance_upper_bound=0.2)
    far = np.flatnonzero(gap > SAME_M)
    if not len(far):
        return np.empty(0)
    world = in_world(before[far], bundle)
    excused = np.zeros(len(far), dtype=bool)
    for level in record["levels"]:
        for bump in level["bumps"]:
            apart = np.abs(world[:, :2] - bump["center_xy_m"]).max(axis=1)
            near_floor = np.abs(world[:, 2] - level["floor_z_m"]) < 0.3
            excused |= (apart <= bump["width_m"] + BUMP_MARGIN_M) & near_floor
    return np.minimum(gap[far][~excused], 0.2)
