"""The CPU rasteriser against the published formula, and what it promises beside pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.scenes.splat_reference import psnr_db, reference_image
from tests.support.scenes.splats import random_cloud
from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.frames import matrix_to_quat, quat_to_matrix
from vlnpe.formats.splats.record import GaussianCloud
from vlnpe.formats.splatting import draw
from vlnpe.formats.splatting.draw import Eye, draw_splats
from vlnpe.formats.splatting.scene import SplatScene

LEVEL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
LEAST_PSNR_DB = 45.0


def eye_at(x: float, width: int = 70, height: int = 52, hfov: float = 70.0) -> Eye:
    """Return an eye on the x axis that looks along +x, z up."""
    return Eye(CameraModel("test", width, height, hfov), np.array([x, 0.0, 0.0]), LEVEL)


CASES = {
    "many small": (400, 0, 1.0, (0.005, 0.05), -3.0),
    "few large": (60, 0, 1.0, (0.2, 1.5), -3.0),
    "around the camera": (300, 0, 2.0, (0.02, 0.4), 0.0),
    "degree 1": (150, 1, 1.0, (0.02, 0.3), -3.0),
    "degree 2": (150, 2, 1.0, (0.02, 0.3), -3.0),
    "degree 3": (150, 3, 1.0, (0.02, 0.3), -3.0),
    "needles": (200, 0, 1.0, (0.001, 1.0), -3.0),
}


@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("name", CASES)
def test_pictures_are_those_of_the_published_formula(name: str, antialiased: bool) -> None:
    count, degree, spread, sizes, x = CASES[name]
    cloud = random_cloud(np.random.default_rng(7), count, degree, spread=spread, sizes=sizes)
    scene = SplatScene.of(cloud, antialiased=antialiased)
    image = draw_splats(scene, eye_at(x))
    color, light = reference_image(cloud, eye_at(x), antialiased=antialiased)
    assert psnr_db(image.color, color) >= LEAST_PSNR_DB
    assert psnr_db(image.light, light) >= LEAST_PSNR_DB


@pytest.mark.parametrize("group", [256, 1024])
def test_groups_and_skipped_chunks_change_nothing(
    group: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A wall hides most of 20,000 Gaussians; drawing them by groups must not show."""
    rng = np.random.default_rng(8)
    behind = random_cloud(rng, 20_000, spread=2.0, sizes=(0.01, 0.1))
    wall = random_cloud(rng, 4_000, spread=0.6, sizes=(0.05, 0.1))
    wall.position[:, 0] = -3 + 0.01 * wall.position[:, 0]
    wall.opacity[:] = 0.99
    both = GaussianCloud(
        np.concatenate([wall.position, behind.position]),
        np.concatenate([wall.scale, behind.scale]),
        np.concatenate([wall.quat_wxyz, behind.quat_wxyz]),
        np.concatenate([wall.opacity, behind.opacity]),
        np.concatenate([wall.harmonics, behind.harmonics]),
    )
    scene, eye = SplatScene.of(both), eye_at(-4.0)
    monkeypatch.setattr(draw, "GROUP", 1 << 20)
    whole = draw_splats(scene, eye, with_depth=True)
    monkeypatch.setattr(draw, "GROUP", group)
    parts = draw_splats(scene, eye, with_depth=True)
    assert np.array_equal(parts.color, whole.color)
    assert np.array_equal(parts.median_m, whole.median_m)


def test_order_of_the_file_does_not_matter() -> None:
    rng = np.random.default_rng(9)
    cloud = random_cloud(rng, 500, 1)
    shuffled = cloud.take(rng.permutation(500))
    first, second = (draw_splats(SplatScene.of(c), eye_at(-3)).color for c in (cloud, shuffled))
    assert first == pytest.approx(second, abs=1e-5)


def slab(distance_m: float, normal: tuple[float, float, float]) -> GaussianCloud:
    """Return flat opaque Gaussians that tile a plane through (distance_m, 0, 0)."""
    n = np.array(normal) / np.linalg.norm(normal)
    across = np.cross(n, (0.0, 0.3, 1.0))
    across /= np.linalg.norm(across)
    beside = np.cross(n, across)
    u, v = np.meshgrid(np.arange(-2, 2, 0.02), np.arange(-2, 2, 0.02))
    points = np.outer(u.ravel(), across) + np.outer(v.ravel(), beside) + (distance_m, 0, 0)
    quat = matrix_to_quat(np.stack([across, beside, n], axis=1))
    count = len(points)
    return GaussianCloud(
        position=points.astype(np.float32),
        scale=np.tile(np.array([0.015, 0.015, 0.001], np.float32), (count, 1)),
        quat_wxyz=np.tile(quat, (count, 1)).astype(np.float32),
        opacity=np.full(count, 0.95, np.float32),
        harmonics=np.zeros((count, 1, 3), np.float32),
    )


@pytest.mark.parametrize("normal", [(-1, 0, 0), (-1, 0, 1), (-1, 1, 2), (-0.4, 0, 1)])
def test_depth_of_a_slanted_plane(normal: tuple[float, float, float]) -> None:
    """Depth follows the plane within a pixel, though the Gaussians' centres are 2 cm apart."""
    eye = eye_at(0.0, 60, 40, 30.0)
    image = draw_splats(SplatScene.of(slab(2.0, normal)), eye, with_depth=True)
    v, u = np.mgrid[0:40, 0:60]
    rays = np.stack([(u - 29.5), (v - 19.5), np.full(u.shape, eye.camera.focal_px)], -1)
    rays = rays / eye.camera.focal_px @ LEVEL.T
    true = 2.0 * normal[0] / (rays @ np.array(normal, dtype=float))
    seen = image.light < 0.01
    assert seen.mean() > 0.9
    per_px = np.abs(np.gradient(true)).max(0)
    for depth in (image.depth_m, image.median_m):
        error = np.abs(depth - true)
        assert np.quantile((error / (0.002 + per_px))[seen], 0.95) < 1


def test_a_body_hides_what_is_behind_it() -> None:
    cloud = slab(2.0, (-1, 0, 0))
    cover = np.full((52, 70), np.inf, dtype=np.float32)
    cover[:, :35] = 1.0
    cover[:26, 35:] = 3.0
    image = draw_splats(SplatScene.of(cloud), eye_at(0.0, hfov=40), cover_m=cover)
    assert (image.light[:, :35] == 1).all()
    assert (image.light[:, 35:] < 0.01).all()


def test_what_is_above_the_cut_is_left_out_only_from_above() -> None:
    cloud = random_cloud(np.random.default_rng(3), 300)
    scene = SplatScene.of(cloud)
    down = Eye(
        CameraModel("top", 40, 40, 60.0),
        np.array([0.0, 0.0, 5.0]),
        np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]]),
    )
    low = cloud.take(cloud.position[:, 2] <= 0.2)
    cut = draw_splats(scene, down, cut_above_m=0.2).color
    assert cut == pytest.approx(draw_splats(SplatScene.of(low), down).color, abs=1e-5)
    whole = draw_splats(scene, eye_at(-3)).color
    assert np.array_equal(draw_splats(scene, eye_at(-3), cut_above_m=0.2).color, whole)


def test_nothing_in_view_is_black() -> None:
    cloud = random_cloud(np.random.default_rng(4), 50, spread=0.2)
    image = draw_splats(SplatScene.of(cloud), eye_at(5.0), with_depth=True)
    assert not image.color.any()
    assert (image.light == 1).all()
    empty = SplatScene.of(cloud.take(np.zeros(50, dtype=bool)))
    assert not draw_splats(empty, eye_at(0.0)).color.any()


def test_turning_scene_and_camera_together_changes_nothing() -> None:
    rng = np.random.default_rng(5)
    cloud = random_cloud(rng, 200, 3)
    matrix = np.eye(4)
    matrix[:3, :3] = quat_to_matrix(rng.standard_normal(4))
    matrix[:3, 3] = 1, 2, 3
    eye = eye_at(-3)
    moved = replace(
        eye,
        position_world_m=matrix[:3, :3] @ eye.position_world_m + matrix[:3, 3],
        rotation_world=matrix[:3, :3] @ eye.rotation_world,
    )
    first = draw_splats(SplatScene.of(cloud), eye).color
    second = draw_splats(SplatScene.of(cloud.transformed(matrix)), moved).color
    assert psnr_db(first, second) > 60
