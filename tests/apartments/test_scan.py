"""The virtual scan of the built-in apartment, as files."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from vlnpe.apartments import ApartmentConfig, ScanConfig, build_scene, generate_scan
from vlnpe.apartments.output import scan_pose
from vlnpe.apartments.scanner import atlas
from vlnpe.apartments.scanner.depth import DepthCamera
from vlnpe.apartments.scanner.stations import look
from vlnpe.apartments.scanner.tracing import Tracer
from vlnpe.formats.process.threads import allow_threads
from vlnpe.formats.scene.arrays import grid_of

pytestmark = pytest.mark.chain

SEED = 3
# Coarser than the default in everything but what is tested: quick.
COARSE = ApartmentConfig(
    scan=ScanConfig(
        voxel_m=0.045,
        view_px=(160, 120),
        station_spacing_m=1.8,
        target_faces=80_000,
        texel_m=0.0095,
        floor_texel_m=0.009,
        light_rays=6,
    )
)
# For what holds at any resolution.
COARSEST = ApartmentConfig(
    scan=ScanConfig(
        voxel_m=0.1,
        view_px=(80, 60),
        station_spacing_m=3.0,
        target_faces=15_000,
        texel_m=0.04,
        floor_texel_m=0.04,
        light_rays=2,
    )
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("scan")
    assert generate_scan(SEED, out, COARSE) == out / "scan.glb"
    return out


@pytest.fixture(scope="module")
def loaded(folder: Path) -> dict[str, Any]:
    scene = trimesh.load_scene(folder / "scan.glb", process=False)
    return {node: scene.geometry[str(scene.graph[node][1])] for node in scene.graph.nodes_geometry}


@pytest.fixture(scope="module")
def labels(folder: Path) -> list[dict]:
    content = json.loads((folder / "scan.labels.json").read_text())
    assert content["frame"] == "source"
    return content["objects"]


def floors(loaded: dict[str, Any]) -> list[Any]:
    return [mesh for name, mesh in loaded.items() if name.split("_")[:-1] == ["Floor"]]


def test_nodes_are_the_labelled_objects(loaded: dict[str, Any], labels: list[dict]) -> None:
    boxes = {o["name"]: o for o in labels}
    assert set(loaded) <= set(boxes)
    for kind in ("Sofa_1", "Floor_1", "Ceiling_1", "Wall_3", "Bed_1", "Door_frame_1", "Window_1"):
        assert kind in loaded, kind
    for name, mesh in loaded.items():
        # Scanner noise and the voxel's size blur the border between neighbours.
        lower, upper = np.array(boxes[name]["lower"]), np.array(boxes[name]["upper"])
        outside = np.maximum(lower - mesh.vertices, mesh.vertices - upper).max(1)
        assert np.mean(outside > 0.1) < 0.12, name
    rooms = [o["category"] for o in labels if o["category"].startswith("room:")]
    assert len(rooms) >= 4 and "room:kitchen" in rooms


def test_scan_is_complete_but_light(loaded: dict[str, Any], folder: Path) -> None:
    faces = sum(len(mesh.faces) for mesh in loaded.values())
    assert 40_000 < faces <= 80_000
    assert (folder / "scan.glb").stat().st_size < 40e6


def test_texels_are_at_most_a_centimetre(loaded: dict[str, Any]) -> None:
    coarsest = []
    for mesh in loaded.values():
        image = mesh.visual.material.baseColorTexture
        uv = mesh.visual.uv[mesh.faces] * image.size
        first, second = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
        texels = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
        big = mesh.area_faces > 1e-5
        coarsest.append(np.sqrt(mesh.area_faces[big] / np.maximum(texels[big], 1e-9)))
    sizes = np.concatenate(coarsest)
    assert np.quantile(sizes, 0.999) < 0.0101
    assert sizes.max() < 0.03


def test_pages_show_the_rooms_colours(loaded: dict[str, Any], labels: list[dict]) -> None:
    """Floors of different rooms differ, and every page is far from one flat colour."""
    means = []
    for mesh in floors(loaded):
        image = np.asarray(mesh.visual.material.baseColorTexture.convert("RGB"))
        x = (mesh.visual.uv[:, 0] * image.shape[1]).astype(int).clip(0, image.shape[1] - 1)
        y = ((1 - mesh.visual.uv[:, 1]) * image.shape[0]).astype(int).clip(0, image.shape[0] - 1)
        means.append(image[y, x].mean(0))
        assert image[y, x].std() > 6
    spread = np.linalg.norm(np.array(means)[:, None] - np.array(means)[None], axis=-1)
    assert spread.max() > 40


def test_floor_has_holes_that_the_truth_covers(folder: Path) -> None:
    truth = np.load(folder / "truth.npz")
    grid = grid_of(truth)
    floor, seen = truth["floor_mask"], truth["seen_mask"]
    assert floor.shape == seen.shape == grid.shape
    assert not np.any(seen & ~floor)
    assert 0.5 < seen.sum() / floor.sum() < 0.97
    assert np.all(truth["floor_z_m"][floor] == 0) and np.all(np.isnan(truth["floor_z_m"][~floor]))
    area = floor.sum() * grid.cell_m**2
    assert 80 < area < 155


def test_floor_is_bumpy_but_walkable(loaded: dict[str, Any]) -> None:
    height = np.concatenate([mesh.vertices[:, 1] for mesh in floors(loaded)])
    assert 0.001 < np.percentile(np.abs(height), 68) < 0.02
    assert np.percentile(np.abs(height), 98) < 0.05


def test_nothing_is_hallucinated(loaded: dict[str, Any]) -> None:
    """Every scanned vertex is near the exact surface."""
    home = build_scene(np.random.default_rng(SEED), COARSE, painted=False)
    corners = home.shape.corners.reshape(-1, 3)
    soup = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
    exact = KDTree(trimesh.sample.sample_surface(soup, 900_000, seed=0)[0])
    points = np.concatenate([m.vertices for m in loaded.values()])[::7]
    world = np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=-1)
    distance = exact.query(world)[0]
    assert np.quantile(distance, 0.95) < 0.05
    assert distance.max() < 0.2


def test_welding_joins_the_nodes_again(loaded: dict[str, Any]) -> None:
    merged: Any = trimesh.util.concatenate(
        [trimesh.Trimesh(m.vertices, m.faces, process=False) for m in loaded.values()]
    )
    count = len(merged.vertices)
    merged.merge_vertices(digits_vertex=7)
    assert len(merged.vertices) < 0.8 * count
    pieces = trimesh.graph.connected_component_labels(merged.edges, len(merged.vertices))
    assert np.bincount(pieces).max() > 0.8 * len(merged.vertices)


def test_same_seed_gives_the_same_bytes_with_any_number_of_threads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(atlas, "_COARSEST_M", 0.1)
    first, second = tmp_path / "first", tmp_path / "second"
    for threads, folder in ((1, first), (3, second)):
        folder.mkdir()
        with allow_threads(threads):
            generate_scan(SEED, folder, COARSEST)
    for name in ("scan.glb", "scan.labels.json", "truth.npz"):
        assert (first / name).read_bytes() == (second / name).read_bytes(), name


def test_scan_pose_moves_by_offset_and_tilt() -> None:
    pose = scan_pose(ApartmentConfig(scan_tilt_deg=2.0, scan_offset_m=(1.0, 2.0, 0.5)))
    np.testing.assert_allclose(pose @ (1.0, 2.0, 0.5, 1.0), (0, 0, 0, 1), atol=1e-12)
    up = pose[:3, :3] @ (0, 0, 1)
    assert np.rad2deg(np.arccos(up[2])) == pytest.approx(2.0)
    np.testing.assert_allclose(scan_pose(ApartmentConfig()), np.eye(4))


def test_tracer_measures_a_wall() -> None:
    wall = np.array([[[2, -9, -9], [2, 9, -9], [2, 0, 18]]], dtype=float)
    tracer = Tracer(wall)
    start = np.zeros((3, 3), np.float32)
    rays = np.array([[1, 0, 0], [-1, 0, 0], [0.8, 0.6, 0]], np.float32)
    hits = tracer.first(start, rays, 10.0)
    assert hits.prim.tolist() == [0, -1, 0]
    assert hits.depth[[0, 2]] == pytest.approx([2.0, 2.5])
    reach = np.array([1.9, 9, 3], np.float32)
    assert tracer.blocked(start, rays, reach).tolist() == [False, False, True]
    assert tracer.distance(start, rays, 5.0) == pytest.approx([2.0, 5.0, 2.5])


def test_camera_looks_where_it_should() -> None:
    view = look(np.zeros(3), np.pi / 2, np.deg2rad(-30))
    np.testing.assert_allclose(view.rotation[:, 2], (0, np.sqrt(0.75), -0.5), atol=1e-12)
    assert view.rotation[2, 1] < 0 and np.linalg.det(view.rotation) == pytest.approx(1)
    camera = DepthCamera.of(ScanConfig())
    assert camera.cosine.max() == pytest.approx(1, abs=1e-4)
