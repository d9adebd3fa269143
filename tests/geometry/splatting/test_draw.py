"""The CPU rasteriser against the published formula, and what it promises beside pictures."""

import numpy as np
import pytest

from tests.support.scenes.splat_reference import psnr_db, reference_image
from tests.support.scenes.splats import random_cloud
from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.frames import matrix_to_quat, quat_to_matrix, transform_points
from vlnpe.formats.splats.record import GaussianCloud, joined
from vlnpe.geometry.splatting import detail, draw
from vlnpe.geometry.splatting.blend import count_unfinished
from vlnpe.geometry.splatting.draw import Eye, draw_splats
from vlnpe.geometry.splatting.project import any_unfinished
from vlnpe.geometry.splatting.scene import SplatScene

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
    scene, eye = SplatScene.of(joined([wall, behind])), eye_at(-4.0)
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


def test_splats_above_the_cut_are_left_out_only_from_above() -> None:
    cloud = random_cloud(np.random.default_rng(3), 300)
    scene = SplatScene.of(cloud)
    down = Eye(CameraModel("top", 40, 40, 60.0), np.array([0, 0, 5.0]), np.diag([1.0, -1.0, -1.0]))
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
    position = transform_points(matrix, eye.position_world_m)
    moved = Eye(eye.camera, position, matrix[:3, :3] @ eye.rotation_world)
    first = draw_splats(SplatScene.of(cloud), eye).color
    second = draw_splats(SplatScene.of(cloud.transformed(matrix)), moved).color
    assert psnr_db(first, second) > 60


def surface(rng: np.random.Generator, count: int) -> GaussianCloud:
    """Return flat Gaussians on a wall at x = 0, 4 × 3 m, with a smooth pattern."""
    y, z = rng.uniform(-2, 2, count), rng.uniform(-1.5, 1.5, count)
    spacing = (12 / count) ** 0.5
    color = 0.5 + 0.4 * np.stack([np.sin(3 * y), np.cos(2 * z), np.sin(y + z)], axis=-1)
    return GaussianCloud(
        position=np.stack([0 * y, y, z], axis=-1).astype(np.float32),
        scale=np.tile(np.array([0.002, spacing, spacing], np.float32), (count, 1)),
        quat_wxyz=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        opacity=rng.uniform(0.4, 0.95, count).astype(np.float32),
        harmonics=((color[:, None] - 0.5) / 0.28209479).astype(np.float32),
    )


@pytest.mark.parametrize("antialiased", [False, True])
def test_merged_gaussians_look_alike_where_they_are_small(antialiased: bool) -> None:
    cloud = surface(np.random.default_rng(3), 120_000)
    scene = SplatScene.of(cloud, detail=True, antialiased=antialiased)
    assert scene.width.shape[0] == detail.LEVELS
    per_level = np.diff(scene.starts[:: scene.width.shape[1]])
    assert per_level[1] < 0.35 * per_level[0] and per_level[2] < 0.35 * per_level[1]
    far, close = eye_at(-3.0), eye_at(-0.2)
    whole = draw_splats(scene, far)
    coarse = draw_splats(scene, far, detail_px=0.3)
    assert psnr_db(coarse.color, whole.color) >= 40.0
    assert not np.array_equal(coarse.color, whole.color)
    inner = np.s_[8:-8, 8:-8]  # the outline is a little thinner
    assert psnr_db(coarse.light[inner], whole.light[inner]) >= 40.0
    # Nearby nothing is below the threshold.
    near = draw_splats(scene, close, detail_px=0.1)
    assert np.array_equal(near.color, draw_splats(scene, close).color)
    # The capture itself is drawn as without levels.
    plain = SplatScene.of(cloud, antialiased=antialiased)
    assert np.array_equal(draw_splats(plain, far).color, whole.color)


def test_merging_in_blocks_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    cloud = surface(np.random.default_rng(6), 5_000)
    whole = SplatScene.of(cloud, detail=True)
    monkeypatch.setattr(detail, "BLOCK", 3)
    blocks = SplatScene.of(cloud, detail=True)
    for name in ("position", "covariance", "opacity", "color", "starts", "width"):
        assert np.array_equal(getattr(blocks, name), getattr(whole, name)), name


def test_gaussians_across_a_gap_are_not_merged() -> None:
    rng = np.random.default_rng(4)
    cloud = random_cloud(rng, 512, sizes=(1e-4, 2e-4), spread=3.0)
    scene = SplatScene.of(cloud, detail=True)
    assert len(scene) == len(scene.width) * 512, "Gaussians metres apart are not one"


def test_finished_pixels_are_off_by_the_light_that_is_left() -> None:
    scene = SplatScene.of(random_cloud(np.random.default_rng(5), 3_000, spread=0.5))
    whole = draw_splats(scene, eye_at(-3.0))
    early = draw_splats(scene, eye_at(-3.0), least_light=0.01)
    assert np.abs(early.color - whole.color).max() <= 0.01 * whole.color.max() + 0.01
    assert not np.array_equal(early.color, whole.color)


def test_summed_area_table_tells_where_unfinished_pixels_are() -> None:
    """Rectangles at any place and of any size, also partly or wholly outside the image."""
    rng = np.random.default_rng(11)
    width, height = 37, 21
    columns, rows = 3, 2
    light = np.where(rng.random((rows * columns, 256)) < 0.03, 1.0, -1.0).astype(np.float32)
    tiles = light.reshape(rows, columns, 16, 16).swapaxes(1, 2).reshape(16 * rows, 16 * columns)
    open_ = tiles[:height, :width] > 0
    table = np.zeros((height + 1, width + 1), dtype=np.int32)
    count_unfinished(light, columns, table)
    v, u = np.mgrid[0:height, 0:width]
    unfinished = 0
    for x, y, half_x, half_y in rng.uniform((-5, -5, 0, 0), (42, 26, 6, 6), (500, 4)):
        x0, x1, y0, y1 = x - half_x, x + half_x, y - half_y, y + half_y
        true = (open_ & (u >= x0) & (u <= x1) & (v >= y0) & (v <= y1)).any()
        assert any_unfinished(table, x0, x1, y0, y1) == true
        unfinished += true
    assert 50 < unfinished < 450
