"""Slabs that run on over complete flights are opened; low ceilings and galleries stay."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.scenes import scans
from tests.support.scenes.repairs import repaired
from tests.support.scenes.stair_halls import SLAB_M, StairHall, stair_hall
from vlnpe.formats.core.geometry import triangle_normals
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.formats.scene.staircase import Treads
from vlnpe.scene_repair.storeys.levels import ScannedFloor
from vlnpe.scene_repair.storeys.slabs import Slab, with_levels_of

pytestmark = pytest.mark.chain


def record(bundle: SceneBundle) -> dict[str, Any]:
    return json.loads((bundle.root / "repair.json").read_text())


def level_faces_over(bundle: SceneBundle, truth: StairHall, tread: int) -> np.ndarray:
    """Heights of level faces above the middle of a tread, up to the upper floor."""
    mesh = bundle.visual()
    corners = mesh.vertices[mesh.faces].astype(float)
    flat = np.abs(triangle_normals(corners)[:, 2]) > 0.98
    middle = truth.treads[tread].mean(axis=0)
    a, b, c = (corners[:, k, :2] - middle for k in range(3))
    pairs = ((a, b), (b, c), (c, a))
    crosses = np.stack([p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in pairs])
    inside = (crosses > 0).all(axis=0) | (crosses < 0).all(axis=0)
    z = corners[flat & inside].mean(axis=1)[:, 2]
    return z[(z > truth.top_m[tread] + 0.05) & (z < truth.rise_m + 0.05)]


type Measures = tuple[float, float, float]


@pytest.fixture(
    scope="module",
    params=[
        ("straight", (0.17, 0.28, 1.0), 0.03),
        ("L", (0.17, 0.28, 1.0), 0.03),
        ("U", (0.18, 0.26, 0.95), 0.0),
        # Each shape and each measure is above.
        pytest.param(("U", (0.17, 0.28, 1.0), 0.03), marks=pytest.mark.slow),
        pytest.param(("straight", (0.18, 0.26, 0.95), 0.0), marks=pytest.mark.slow),
    ],
    ids=str,
)
def opened(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[StairHall, SceneBundle, Measures, float]:
    """A hall under a closed slab, its scene, its riser, going and width [m], its nosings [m]."""
    shape, measures, nosing_m = request.param
    hall = stair_hall(shape, *measures, closed=True, nosing_m=nosing_m)
    return hall, repaired(hall.parts, tmp_path_factory.mktemp("hall")), measures, nosing_m


def test_a_slab_over_complete_stairs_is_opened(
    opened: tuple[StairHall, SceneBundle, Measures, float],
) -> None:
    truth, bundle, (riser_m, _, _), _ = opened
    (staircase,) = bundle.staircases
    assert staircase.problem == "" and staircase.riser_m == pytest.approx(riser_m, abs=0.005)
    (slab,) = record(bundle)["opened_slabs"]
    assert slab["levels"] == [0, 1]
    sizes = (truth.treads[:, 1] - truth.treads[:, 0]).prod(axis=1)
    shut = truth.top_m + 2.0 > truth.rise_m - SLAB_M
    assert sizes[shut].sum() - 0.3 < slab["area_m2"] < sizes.sum() + 0.3
    (doubt,) = record(bundle)["doubts"]
    assert doubt.startswith("slab opened over flight: the stairs from level 0 to 1 at x ")
    # In what one sees, too, and nowhere else: the hall's upper floor is whole around the stairs.
    for tread in np.flatnonzero(shut):
        assert not len(level_faces_over(bundle, truth, int(tread)))
    floor = bundle.floor(1)
    area = floor.covered.sum() * floor.grid.cell_m**2
    assert area == pytest.approx(49.0 - slab["area_m2"], abs=1.5)


def test_treads_keep_their_nosings_where_a_slab_is_opened(
    opened: tuple[StairHall, SceneBundle, Measures, float],
) -> None:
    truth, bundle, (_, going_m, width_m), nosing_m = opened
    mesh = bundle.visual()
    corners = mesh.vertices[mesh.faces].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle = corners.mean(axis=1)[:, :2]
    for (low, high), height in zip(truth.treads[-4:], truth.top_m[-4:], strict=True):
        own = (np.abs(corners[..., 2] - height) < 0.005).all(axis=1) & (normals[:, 2] > 0)
        # A handrail further down ends at the height of a tread where risers are 0.18 m.
        own &= ((middle > low - nosing_m) & (middle < high + nosing_m)).all(axis=1)
        assert normals[own, 2].sum() / 2 == pytest.approx(width_m * (going_m + nosing_m), abs=1e-4)


def test_levels_of_slabs_are_matched_by_height() -> None:
    grid, none = GridSpec((0.0, 0.0), 0.05, 1, 1), np.zeros((0, 3))
    before, after = (
        [ScannedFloor(grid, np.full((1, 1), z), z) for z in heights]
        for heights in ((0.0, 2.7, 5.4), (-2.6, 0.01, 1.4, 2.69, 5.4))
    )
    boxes = Treads(none, none, np.zeros(0))
    slabs = [Slab((k, k + 1), before[k + 1].floor_z_m, boxes, boxes) for k in (0, 1)]
    assert [s.levels for s in with_levels_of(slabs, before, after)] == [(1, 3), (3, 4)]


def low_ceiling() -> StairHall:
    """A ceiling at half the height of the room over the upper half of the stairs."""
    hall = stair_hall("straight")
    low, high = hall.treads[8][0], hall.treads[14][1]
    return StairHall(**{**vars(hall), "parts": [*hall.parts, scans.box(
        (*low, hall.rise_m + 0.9), (*high, hall.rise_m + 1.0))]})  # fmt: skip


def gallery() -> StairHall:
    """Floor over the middle of the stairs, whose head lies open."""
    hall = stair_hall("straight")
    low, high = hall.treads[4][0], hall.treads[11][1]
    return StairHall(**{**vars(hall), "parts": [*hall.parts, scans.box(
        (*low, hall.rise_m - SLAB_M), (*high, hall.rise_m))]})  # fmt: skip


def wall_on_top() -> StairHall:
    """A closed slab with a wall on it, across the head of the stairs."""
    hall = stair_hall("straight", closed=True)
    low, high = hall.treads[12][0], hall.treads[14][1]
    return StairHall(**{**vars(hall), "parts": [*hall.parts, scans.box(
        (low[0], low[1], hall.rise_m), (*high, hall.rise_m + 2.4))]})  # fmt: skip


@pytest.mark.parametrize("hall", [low_ceiling, gallery, wall_on_top])
def test_what_is_no_fault_of_the_model_stays(hall: Any, tmp_path: Path) -> None:
    bundle = repaired(hall().parts, tmp_path)
    assert record(bundle)["opened_slabs"] == []
    assert all(s.problem for s in bundle.staircases)
