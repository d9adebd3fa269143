"""Generated splat captures: on the exact surfaces, with the faults of real ones."""

import json
from pathlib import Path

import numpy as np
import pytest

from vlnpe.apartments import build_scene
from vlnpe.apartments.building.true_scene import TrueScene
from vlnpe.apartments.config import ApartmentConfig
from vlnpe.apartments.generate_splats import generate_splats
from vlnpe.apartments.scanner.splat_faults import BACKGROUND, FLOATERS_PER_M2
from vlnpe.apartments.scanner.tracing import Tracer
from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.frames import HABITAT_TO_WORLD
from vlnpe.formats.splats.kind import splat_kind
from vlnpe.formats.splats.read import read_splats
from vlnpe.formats.splats.record import GaussianCloud
from vlnpe.geometry.splatting.draw import Eye, draw_splats
from vlnpe.geometry.splatting.scene import SplatScene

pytestmark = pytest.mark.chain

COUNT = 60_000
SEED = 5


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("capture")
    generate_splats(SEED, folder, count=COUNT)
    return folder


@pytest.fixture(scope="module")
def cloud(capture: Path) -> GaussianCloud:
    return read_splats(capture / "scan.ply").transformed(HABITAT_TO_WORLD)


@pytest.fixture(scope="module")
def truth() -> TrueScene:
    return build_scene(np.random.default_rng(SEED), ApartmentConfig(), painted=False)


def test_it_is_a_splat_file_with_labels_and_truth(capture: Path) -> None:
    assert splat_kind(capture / "scan.ply") == "PLY of 3D Gaussian splatting"
    assert "Apache-2.0" in read_splats(capture / "scan.ply").licence
    labels = json.loads((capture / "scan.labels.json").read_text())["objects"]
    assert {"floor", "wall"} <= {o["category"] for o in labels}
    with np.load(capture / "truth.npz") as data:
        seen, floor = data["seen_mask"], data["floor_mask"]
    assert 0.6 < seen.sum() / floor.sum() < 0.99  # furniture hides some


def test_gaussians_lie_on_the_exact_surfaces_facing_along_them(
    cloud: GaussianCloud, truth: TrueScene
) -> None:
    floor_m2 = sum(float(np.prod(r.size_m)) for plan in truth.storeys for r in plan.rooms)
    strays = BACKGROUND + round(FLOATERS_PER_M2 * floor_m2)
    on_surfaces = cloud.take(np.arange(len(cloud) - strays))
    assert 0.75 * COUNT < len(on_surfaces) < 1.15 * COUNT
    tracer = Tracer(truth.shape.corners)
    near = np.full(len(on_surfaces), np.inf)
    for axis in range(3):
        for sign in (-1.0, 1.0):
            direction = np.zeros((len(near), 3), dtype=np.float32)
            direction[:, axis] = sign
            start = on_surfaces.position - np.float32(0.02) * direction
            near = np.minimum(near, np.abs(tracer.distance(start, direction, 0.05) - 0.02))
    assert np.quantile(near, 0.9) < 0.008
    assert np.median(on_surfaces.scale[:, 2]) < 0.1 * np.median(on_surfaces.scale[:, 0])


def test_a_room_looks_closed_and_its_depth_is_exact(cloud: GaussianCloud, truth: TrueScene) -> None:
    room = max(truth.plan.rooms, key=lambda r: float(np.prod(r.size_m)))
    center = (np.asarray(room.lower_m) + np.asarray(room.upper_m)) / 2
    eye_m = np.array([*center, 1.9])
    down = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]])
    eye = Eye(CameraModel("down", 40, 40, 70.0), eye_m, down)
    image = draw_splats(SplatScene.of(cloud), eye, with_depth=True)
    v, u = np.mgrid[0:40, 0:40]
    rays = np.stack([u - 19.5, v - 19.5, np.full(u.shape, eye.camera.focal_px)], -1).reshape(-1, 3)
    length = np.linalg.norm(rays, axis=1)
    rays = (rays / length[:, None]) @ down.T
    hits = Tracer(truth.shape.corners).first(np.tile(eye_m, (1600, 1)), rays, 9.0)
    true = (hits.depth * eye.camera.focal_px / length).reshape(40, 40)
    assert np.median(image.light) < 0.05
    assert np.median(np.abs(image.median_m - true)) < 0.006


def test_the_same_seed_gives_the_same_capture(capture: Path, tmp_path: Path) -> None:
    generate_splats(SEED, tmp_path, count=COUNT)
    assert (tmp_path / "scan.ply").read_bytes() == (capture / "scan.ply").read_bytes()
