"""Holes of known shape are found and filled; openings that belong there stay open."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from tests.support.scenes import scans
from tests.support.scenes.repairs import repaired
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.scene_repair.grid.columns import sample_columns
from vlnpe.wayfinding.distance import distance_field

pytestmark = pytest.mark.chain


def floor_seen(
    bundle: SceneBundle, lower: tuple[float, float], upper: tuple[float, float], z: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """Points (N, 2), whether the exported mesh has floor there, and its height."""
    visual = bundle.visual()
    grid = GridSpec.covering(lower, upper, 0.013)
    columns = sample_columns(
        visual.vertices.astype(np.float64), visual.faces.astype(np.int64), grid
    )
    height = np.full(grid.rows * grid.columns, np.nan)
    near = np.abs(columns.z - z) < 0.05
    height[columns.cell[near]] = columns.z[near]
    i, j = np.indices(grid.shape)
    points = grid.center_of(np.stack([i, j], axis=-1)).reshape(-1, 2)
    inside = np.all((points > lower) & (points < upper), axis=1)
    return points[inside], np.isfinite(height[inside]), height[inside]


TABLE = scans.table(2.0, 1.5)
HOLES = {
    "pinhole": (scans.disc(2.5, 2.0, 0.04), ()),
    "round": (scans.disc(2.5, 2.0, 0.4), ()),
    "large": (scans.disc(2.5, 2.0, 1.0), ()),
    "crack": (scans.rectangle((1.0, 1.99), (3.5, 2.06)), ()),
    "U": (
        scans.either(
            scans.rectangle((1.0, 1.0), (1.5, 3.0)),
            scans.rectangle((1.0, 1.0), (3.0, 1.4)),
            scans.rectangle((2.6, 1.0), (3.0, 3.0)),
        ),
        (),
    ),
    "ring": (scans.ring(2.5, 2.0, 0.4, 0.9), ()),
    "at a wall": (scans.rectangle((0.0, 1.0), (0.7, 2.5)), ()),
    "in a corner": (scans.rectangle((4.2, 3.2), (5.0, 4.0)), ()),
    "along a wall": (scans.rectangle((0.0, 0.0), (5.0, 0.12)), ()),
    "under a table": (scans.rectangle((1.9, 1.4), (3.1, 2.6)), TABLE),
    "under a cupboard": (
        scans.rectangle((3.0, 3.4), (4.5, 4.0)),
        (scans.box((3.0, 3.4, 0.002), (4.5, 4.0, 1.9)),),
    ),
}


@pytest.mark.parametrize(
    ("name", "ceiling"),
    [(name, True) for name in HOLES]
    + [(name, False) for name in ("round", "ring", "at a wall", "under a cupboard")],
)
def test_planted_hole_is_filled(name: str, ceiling: bool, tmp_path: Path) -> None:
    without, more = HOLES[name]
    parts = scans.room(without, ceiling, more=more)
    bundle = repaired(parts, tmp_path)
    points, seen, height = floor_seen(bundle, (0.03, 0.03), (4.97, 3.97))
    planted = without(points)
    assert planted.any()
    assert seen[planted].mean() >= 0.99
    assert seen.mean() >= 0.999
    assert np.nanmax(np.abs(height)) < 0.005
    # Nothing is added outside the walls.
    for lower, upper in (((-0.6, -0.6), (-0.12, 4.6)), ((-0.6, 4.12), (5.6, 4.6))):
        assert not floor_seen(bundle, lower, upper)[1].any()
    record = json.loads((bundle.root / "repair.json").read_text())["levels"][0]
    assert record["floor_area_after_m2"] == pytest.approx(20.0, rel=0.02)
    assert record["probes"]["fell_through"] == 0


@pytest.mark.parametrize("bottom", [False, True], ids=["crater", "pit"])
def test_hole_whose_rim_slopes_away_is_closed_level(bottom: bool, tmp_path: Path) -> None:
    """Scanners melt rims; a patch that ended on the slope would leave a slit above it."""
    parts = scans.room(None if bottom else scans.disc(2.5, 2.0, 0.3))
    vertices = np.array(parts[0].vertices)
    distance = np.hypot(vertices[:, 0] - 2.5, vertices[:, 1] - 2.0)
    vertices[:, 2] -= np.clip(0.5 - distance, 0.0, 0.13)
    parts[0].vertices = vertices
    bundle = repaired(parts, tmp_path)
    record = json.loads((bundle.root / "repair.json").read_text())
    assert record["verification"]["problems"] == []
    if not bottom:
        _, seen, height = floor_seen(bundle, (1.9, 1.4), (3.1, 2.6))
        assert seen.all()
        assert np.nanmin(height) > -0.031


def test_hole_across_a_threshold_is_filled(tmp_path: Path) -> None:
    without = scans.rectangle((3.8, 1.3), (4.3, 2.7))
    bundle = repaired(scans.two_rooms(1.0, without), tmp_path)
    points, seen, _ = floor_seen(bundle, (3.8, 1.52), (4.3, 2.48))
    assert seen[without(points)].mean() >= 0.99
    free = distance_field(bundle.freemap(0), (1.0, 2.0), radius_m=0.25)
    assert np.isfinite(free.at((7.0, 2.0))).all()


def test_untouched_vertices_stay_where_they_were(tmp_path: Path) -> None:
    parts = scans.room(scans.disc(2.5, 2.0, 0.4), more=scans.table(0.5, 0.5))
    bundle = repaired(parts, tmp_path)
    expected = np.concatenate([np.asarray(p.vertices) for p in parts]).astype(np.float32)
    kept = {tuple(v) for v in bundle.visual().vertices.round(5).tolist()}
    assert all(tuple(v) in kept for v in expected.round(5).tolist())


def test_patch_joins_the_rim_vertex_by_vertex(tmp_path: Path) -> None:
    """Every open edge left inside the room would be a seam to fall into."""
    bundle = repaired(scans.room(scans.disc(2.5, 2.0, 0.6)), tmp_path)
    visual = bundle.visual()
    flat = np.abs(visual.vertices[visual.faces][..., 2]).max(axis=1) < 0.02
    faces = visual.faces[flat]
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    middle = visual.vertices[unique[count == 1]].mean(axis=1)[:, :2]
    inside = np.all((middle > 0.02) & (middle < (4.98, 3.98)), axis=1)
    assert not inside.any()
    assert (count <= 2).all()


def stairwell() -> list[trimesh.Trimesh]:
    """An upper floor at z = 0 with a stairwell 1 × 2.5 m down to a lower floor at −2.8 m."""
    gap = scans.rectangle((1.0, 1.0), (2.0, 3.5))
    steps = [
        scans.box((1.0, 1.0 + 0.25 * k, -2.8), (2.0, 1.25 + 0.25 * k, -2.8 + 0.25 * (10 - k)))
        for k in range(10)
    ]
    lower_walls = [w.apply_translation((0, 0, -2.8)) for w in scans.walls((0, 0), (5, 4), 2.5)]
    return [
        *scans.room(gap),
        *lower_walls,
        scans.sheet((0, 0), (5, 4), z=-2.8),
        scans.sheet((0, 0), (5, 4), z=-0.3, without=gap, facing_up=False),
        *steps,
    ]


def test_stairwell_stays_open(tmp_path: Path) -> None:
    bundle = repaired(stairwell(), tmp_path)
    assert bundle.level_floor_z_m == pytest.approx((-2.8, 0.0), abs=0.01)
    _, seen, _ = floor_seen(bundle, (1.1, 1.3), (1.9, 3.4))
    assert not seen.any()
    record = json.loads((bundle.root / "repair.json").read_text())["levels"][1]
    left = [h for h in record["holes"] if h["action"] == "left"]
    assert any(h["cause"] == "opening" and h["area_m2"] > 1.5 for h in left)


def test_hole_in_an_upper_floor_is_filled(tmp_path: Path) -> None:
    """The lower storey's ceiling lies right under it: no stairwell."""
    without = scans.disc(3.5, 2.0, 0.4)
    lower_walls = [w.apply_translation((0, 0, -2.8)) for w in scans.walls((0, 0), (5, 4), 2.5)]
    parts = [
        *scans.room(without),
        *lower_walls,
        scans.sheet((0, 0), (5, 4), z=-2.8),
        scans.sheet((0, 0), (5, 4), z=-0.3, facing_up=False),
    ]
    bundle = repaired(parts, tmp_path)
    points, seen, _ = floor_seen(bundle, (3.0, 1.5), (4.0, 2.5))
    assert seen[without(points)].mean() >= 0.99


def courtyard(ceiling: bool) -> list[trimesh.Trimesh]:
    """A ring of floor around a walled court of 1.5 × 1.5 m without floor or roof."""
    court = scans.rectangle((2.0, 2.0), (3.5, 3.5))
    inner = scans.walls((2.1, 2.1), (3.4, 3.4), thick=0.1)
    parts = [
        scans.sheet((0, 0), (5.5, 5.5), without=court),
        *scans.walls((0, 0), (5.5, 5.5)),
        *inner,
    ]
    if ceiling:
        parts.append(scans.sheet((0, 0), (5.5, 5.5), z=2.6, without=court, facing_up=False))
    return parts


@pytest.mark.parametrize("ceiling", [True, False], ids=["ceiling", "open top"])
def test_courtyard_stays_open(ceiling: bool, tmp_path: Path) -> None:
    bundle = repaired(courtyard(ceiling), tmp_path)
    _, seen, _ = floor_seen(bundle, (2.2, 2.2), (3.3, 3.3))
    assert not seen.any()


@pytest.mark.parametrize(
    ("height", "radius", "flattened"),
    [(0.05, 0.15, True), (-0.04, 0.1, True), (0.045, 0.9, False), (0.012, 0.1, False)],
    ids=["bump", "dent", "wide", "slight"],
)
def test_small_bumps_are_flattened(
    height: float, radius: float, flattened: bool, tmp_path: Path
) -> None:
    parts = scans.room()
    floor = parts[0]
    vertices = np.array(floor.vertices)
    distance = np.hypot(vertices[:, 0] - 2.5, vertices[:, 1] - 2.0)
    vertices[:, 2] += height * np.clip(2 * (1 - distance / radius), 0, 1)
    floor.vertices = vertices
    bundle = repaired(parts, tmp_path)
    _, _, z = floor_seen(bundle, (2.45, 1.95), (2.55, 2.05))
    assert np.nanmax(np.abs(z)) == pytest.approx(0.0 if flattened else abs(height), abs=0.004)
    record = json.loads((bundle.root / "repair.json").read_text())["levels"][0]
    assert len(record["bumps"]) == (1 if flattened else 0)


def test_patch_continues_the_pattern(tmp_path: Path) -> None:
    hole = scans.rectangle((2.0, 1.5), (2.8, 2.3))
    parts = {f"Wall_{k}": w for k, w in enumerate(scans.walls((0, 0), (5, 4)))}
    parts["Floor_1"] = scans.sheet((0, 0), (5, 4), without=hole)
    bundle = repaired(scans.write_named_glb(parts, tmp_path / "scan.glb"), tmp_path)
    index = next(k for k, m in enumerate(bundle.materials) if m.name == "floor_patch_0")
    texture = bundle.materials[index].texture
    assert texture is not None
    from PIL import Image

    pixels = np.asarray(Image.open(bundle.root / texture).convert("L")).astype(float)
    visual = bundle.visual()
    patch = visual.face_material == index
    uv = visual.corner_uv[patch].mean(axis=1)
    xy = visual.vertices[visual.faces[patch]].mean(axis=1)[:, :2]
    row = ((1 - uv[:, 1]) * pixels.shape[0]).astype(int)
    column = (uv[:, 0] * pixels.shape[1]).astype(int)
    painted = pixels[row, column]
    # The checker's squares are 25 cm wide; rows count from the top of the picture.
    square = np.floor(xy / 0.25).astype(int)
    truth = np.where((square[:, 0] + (7 - square[:, 1])) % 2, 200, 90)
    edge = np.abs(xy / 0.25 - np.rint(xy / 0.25)).min(axis=1) < 0.1
    assert np.mean(np.abs(painted - truth)[~edge] < 30) > 0.95
