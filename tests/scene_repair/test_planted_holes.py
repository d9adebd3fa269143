"""Planted holes are filled, decoys stay open; and the measure itself is sound."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import example, given, settings
from hypothesis import strategies as st

from benchmarks.scene_repair.cases import Result, load, save
from benchmarks.scene_repair.planting.cut import cut_exactly
from benchmarks.scene_repair.planting.decoys import DECOYS
from benchmarks.scene_repair.planting.glb import Glb, Part
from benchmarks.scene_repair.planting.plant import Planted, floor_faces, plant
from benchmarks.scene_repair.planting.shapes import KINDS, Outline, ragged
from benchmarks.scene_repair.report import by_kind, counted, missed, summary
from benchmarks.scene_repair.scenes import Source, write_planted
from benchmarks.scene_repair.score import score, score_hole, truth_of
from benchmarks.scene_repair.site import survey
from benchmarks.scene_repair.speed import Run, fit
from tests.support.scenes import scans
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.repair import repair_scene

pytestmark = pytest.mark.chain


def flat(step: float = 0.5) -> Part:
    """A floor of 4 × 4 m as one part, with a texture coordinate that is its position."""
    sheet = scans.sheet((0, 0), (4, 4), step=step)
    points = np.asarray(sheet.vertices)
    uv = {"TEXCOORD_0": points[:, :2].astype(np.float32)}
    return Part("Floor", 0, 0, 0, points, np.asarray(sheet.faces, dtype=np.int64), uv)


def area_of(part: Part) -> float:
    return float(trimesh.Trimesh(part.points_m, part.faces, process=False).area)


def section_area(outline: Outline) -> float:
    """By the shoelace formula; rings that lie in others count negative."""
    total = 0.0
    for k, ring in enumerate(outline.rings):
        x, y = ring.T
        doubled = abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))
        total += (1 if k == 0 else -1) * doubled / 2
    return total


@settings(max_examples=25, deadline=None)
@example(kind="at a wall", seed=2724, step=0.05)
@given(
    kind=st.sampled_from([k for k in KINDS if k != "crack"]),
    seed=st.integers(0, 10_000),
    step=st.sampled_from([0.05, 0.5, 4.0]),
)
def test_cutting_takes_the_outline_out_and_opens_no_seams(
    kind: str, seed: int, step: float
) -> None:
    rng = np.random.default_rng(seed)
    outline = KINDS[kind].draw(rng, rng.uniform(0.3, 1.0)).moved(np.array([2.1, 1.9]), 0.7)
    part = flat(step)
    cut = cut_exactly(part, np.ones(len(part.faces), dtype=bool), outline)
    assert area_of(cut) == pytest.approx(16.0 - section_area(outline), abs=1e-4)
    # In the file's precision every edge is shared, or lies on the hole's rim or the sheet's border.
    points = cut.points_m.astype(np.float32)
    _, index = np.unique(points, axis=0, return_inverse=True)
    faces = index.ravel()[cut.faces]
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    first, count = np.unique(edges, axis=0, return_counts=True)
    at = np.zeros((index.max() + 1, 2))
    at[index.ravel()] = cut.points_m[:, :2]
    middle = at[first[count == 1]].mean(axis=1)
    inner = np.all((middle > 1e-6) & (middle < 4 - 1e-6), axis=1)
    # Where the outline passes a vertex by some micrometres the triangle between is left out; what
    # lies on its two sides must still meet within that distance.
    alone = at[first[count == 1][inner][_distance(outline, middle[inner]) >= 1e-4]]
    for number, edge in enumerate(alone):
        rest = np.delete(alone, number, axis=0)
        apart = [np.abs(other - edge).max(axis=(1, 2)) for other in (rest, rest[:, ::-1])]
        assert np.min(apart, initial=np.inf) < 3e-5
    assert np.abs(cut.others["TEXCOORD_0"] - cut.points_m[:, :2]).max() < 1e-5


def _distance(outline: Outline, points: np.ndarray) -> np.ndarray:
    best = np.full(len(points), np.inf)
    for ring in outline.rings:
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            along = np.clip((points - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-18), 0, 1)
            best = np.minimum(best, np.linalg.norm(points - a - along[:, None] * (b - a), axis=1))
    return best


def test_torn_rims_keep_to_the_outline() -> None:
    rng = np.random.default_rng(0)
    outline = KINDS["round"].draw(rng, 0.8)
    torn = ragged(outline, rng)
    assert section_area(torn) == pytest.approx(section_area(outline), rel=0.1)
    assert len(torn.rings[0]) > len(outline.rings[0])


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Source:
    """Two furnished rooms; the floor is not quite plane."""
    folder = tmp_path_factory.mktemp("planted")
    low, walls_and_more = scans.two_rooms(0.9)[0], scans.two_rooms(0.9)[1:]
    vertices = np.array(low.vertices)
    vertices[:, 2] = 0.004 * np.sin(vertices[:, 0] * 2.0) * np.cos(vertices[:, 1] * 1.5)
    low.vertices = vertices
    parts = {"Floor_1": low}
    parts |= {f"Wall_{k}": w for k, w in enumerate(walls_and_more[:-1])}
    parts["Ceiling_1"] = walls_and_more[-1]
    parts |= {f"Table_{k}": t for k, t in enumerate(scans.table(0.5, 0.6))}
    parts["Cupboard_1"] = scans.box((6.2, 3.4, 0.08), (7.6, 4.0, 1.5))
    path = scans.write_named_glb(parts, folder / "scan.glb")
    door = (np.array([3.95, 1.55]), np.array([4.15, 2.45]))
    return Source(path, survey("two rooms", Glb(path).parts(), 0.0, exact=False, doors=[door]))


def test_a_changed_glb_differs_by_the_change_alone(scene: Source, tmp_path: Path) -> None:
    before = Glb(scene.path)
    planted = plant(scene.site, np.random.default_rng(1), holes=3)
    after = Glb(write_planted(planted, scene, tmp_path))
    assert after.body.startswith(before.body)
    changed = [
        new.name
        for old, new in zip(before.parts(), after.parts(), strict=True)
        if not np.array_equal(old.points_m, new.points_m)
    ]
    assert changed == ["Floor_1"]


def test_the_measure_distinguishes_open_from_filled(scene: Source) -> None:
    site = scene.site
    planted: Planted = plant(site, np.random.default_rng(2), 16, ("shaft",))
    truth = truth_of(planted)
    decoys = [h for h in planted.holes if h.decoy]
    assert len(decoys) == 1
    for hole in planted.holes:
        open_, closed = score_hole(truth, hole, truth.after), score_hole(truth, hole, truth.before)
        assert open_.area_m2 > 0
        assert open_.share == 0
        assert closed.share == 1
        assert closed.filled
    cut_away = sum(score_hole(truth, h, truth.after).area_m2 for h in planted.holes)
    floor = next(k for k, p in enumerate(site.parts) if p.name == "Floor_1")
    lost = area_of(site.parts[floor]) - area_of(planted.parts[floor])
    # A shaft's walls stand on floor that is gone as well; beneath walls nothing is counted.
    assert cut_away == pytest.approx(lost, rel=0.25)


@pytest.mark.parametrize("name", list(DECOYS))
def test_decoys_reach_through_the_floor(name: str) -> None:
    rng = np.random.default_rng(3)
    decoy = DECOYS[name].build(np.array([1.0, 1.0]), np.array([2.5, 3.0]), 0.0, 2.6, rng)
    z = decoy.triangles_m[..., 2]
    assert z.min() < -0.05
    corners = decoy.triangles_m
    part = Part(
        "x", 0, 0, 0, corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), {}
    )
    assert not floor_faces(part, 0.0).any()


def test_planted_holes_are_filled_and_the_decoy_is_not(scene: Source, tmp_path: Path) -> None:
    planted = plant(scene.site, np.random.default_rng(4), 20, ("stairwell",))
    assert {h.kind for h in planted.holes} >= {*KINDS, "stairwell"}
    (tmp_path / "bundle").mkdir()
    scan = write_planted(planted, scene, tmp_path)
    result = score(planted, repair_scene(scan, tmp_path / "bundle", RepairConfig(picture_px=200)))
    holes = counted([result])
    assert missed([result]) == ["None."]
    assert len(holes) >= 15
    assert sum(h.filled_m2 for h in holes) >= 0.99 * sum(h.area_m2 for h in holes)
    assert not any(h.filled for h in result.holes if h.hole.decoy)
    errors = np.abs(np.concatenate([h.errors_m for h in holes]))
    assert np.median(errors) < 0.005
    assert np.percentile(errors, 99) < 0.02
    assert result.outside_m2 < 0.001 * result.floor_m2
    assert result.moved == 0
    text = "\n".join([*summary([result]), *by_kind([result])])
    assert "planted holes filled | 100.00 %" in text
    kept = Result("code", result, 1.0)
    save(tmp_path / "result.json", kept)
    again = load(tmp_path / "result.json")
    assert again is not None
    assert again.code == "code"
    assert [h.hole.name for h in again.score.holes] == [h.hole.name for h in result.holes]
    assert summary([again.score])[:7] == summary([result])[:7]


def test_growth_is_fitted() -> None:
    runs = [Run(n, 3e-5 * n**1.1, 0.0, 1.0) for n in (100_000, 500_000, 2_000_000)]
    exponent, seconds = fit(runs)
    assert exponent == pytest.approx(1.1)
    assert seconds == pytest.approx(3e-5 * 1_000_000**1.1)
