"""The renderer against analytic truth: geometry, colours, filtering."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.scenes.render_scenes import SQUARE, facing, write_wall
from tests.support.scenes.rooms import PARTS
from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.errors import FileFormatError, UnknownNameError
from vlnpe.formats.core.frames import matrix_to_quat, quat_to_matrix
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.rendering.interface import Renderer
from vlnpe.rendering.kernels.srgb import to_linear, to_srgb
from vlnpe.rendering.registry import make_renderer
from vlnpe.rendering.scene.textures import load_materials, mip_pyramid

LOWER = np.array([p[2] for p in PARTS])
UPPER = np.array([p[3] for p in PARTS])


@pytest.fixture(scope="module")
def renderer(two_rooms: SceneBundle) -> Renderer:
    return make_renderer(two_rooms)


def pixel_rays(camera: CameraModel, quat: np.ndarray) -> np.ndarray:
    """(H, W, 3) world directions with unit length along the optical axis."""
    rows, columns = np.indices((camera.height_px, camera.width_px), dtype=float)
    pixels = np.stack([columns, rows, np.ones_like(rows)], -1)
    return pixels @ np.linalg.inv(camera.intrinsics).T @ quat_to_matrix(quat).T


def room_depth(camera: CameraModel, position: np.ndarray, quat: np.ndarray) -> np.ndarray:
    """Analytic planar depth of the two-room scene, 0 = nothing: boxes by slabs, and the floor."""
    rays = pixel_rays(camera, quat)
    depth = np.full(rays.shape[:2], np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for low, high in zip(LOWER, UPPER, strict=True):
            a, b = (low - position) / rays, (high - position) / rays
            near, far = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
            depth = np.where((near <= far) & (near > 0), np.minimum(depth, near), depth)
        t = -position[2] / rays[..., 2]
    hit = position + t[..., None] * rays
    on_floor = (t > 0) & (hit[..., :2] > 0).all(-1) & (hit[..., :2] < (8, 4)).all(-1)
    depth = np.where(on_floor, np.minimum(depth, t), depth)
    return np.where(np.isinf(depth), 0.0, depth)


@settings(max_examples=20, deadline=None)
@given(
    x=st.floats(0.5, 3.5), y=st.floats(0.4, 2.6), yaw=st.floats(-3.1, 3.1), pitch=st.floats(-0.3, 1)
)
def test_depth_is_planar_z_of_the_known_boxes(
    renderer: Renderer, x: float, y: float, yaw: float, pitch: float
) -> None:
    camera = CameraModel("depth", 96, 64, 80.0)
    position, quat = np.array([x, y, 0.45]), facing(yaw, pitch)
    _, depth = renderer.render(camera, position, quat)
    wrong = np.abs(depth - room_depth(camera, position, quat)) > 1e-3
    # A ray that grazes an edge may pass on either side of it.
    assert wrong.mean() < 2e-3


def test_a_wall_ahead_has_one_depth_everywhere(renderer: Renderer) -> None:
    _, depth = renderer.render(SQUARE, [6.0, 2.5, 1.3], facing(0.0))
    assert np.abs(depth[40:88, 40:88] - 2.0).max() < 1e-4


@pytest.mark.parametrize(("width", "height", "hfov"), [(128, 128, 90.0), (160, 120, 60.0)])
def test_known_points_project_where_the_intrinsics_say(
    renderer: Renderer, width: int, height: int, hfov: float
) -> None:
    camera = CameraModel("project", width, height, hfov)
    position, quat = np.array([5.0, 3.0, 1.2]), facing(-0.7, 0.3)
    rgb, _ = renderer.render(camera, position, quat)
    blue = rgb[..., 2].astype(int) - rgb[..., 0] > 40  # the sofa alone is blue
    low, high = LOWER[-1], UPPER[-1]
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1])
                        for z in (low[2], high[2])])  # fmt: skip
    seen = (corners - position) @ quat_to_matrix(quat) @ camera.intrinsics.T
    seen = seen[:, :2] / seen[:, 2:]
    expected_low = np.clip(seen.min(0), 0, (width - 1, height - 1))
    expected_high = np.clip(seen.max(0), 0, (width - 1, height - 1))
    rows, columns = np.nonzero(blue)
    # The first pixel centre inside is up to one pixel from the edge.
    assert np.abs([columns.min() - 0.5, rows.min() - 0.5] - expected_low).max() <= 1.0
    assert np.abs([columns.max() + 0.5, rows.max() + 0.5] - expected_high).max() <= 1.0


@pytest.mark.parametrize(("part", "color"), [("Table_1", (0.55, 0.35, 0.2)),
                                             ("Sofa_1", (0.2, 0.3, 0.6))])  # fmt: skip
def test_plain_materials_keep_their_hue_and_show_their_shape(
    renderer: Renderer, part: str, color: tuple[float, float, float]
) -> None:
    low, high = next((np.array(p[2]), np.array(p[3])) for p in PARTS if p[0] == part)
    center = 0.5 * (low + high)
    tones = []
    for eye, yaw, pitch in (
        (center + np.array([0, 0, 1.5]), 0.0, 1.57),
        ([center[0] - 1.2 if part == "Sofa_1" else high[0] + 1.2, center[1], center[2]],
         0.0 if part == "Sofa_1" else np.pi, 0.0),
    ):  # fmt: skip
        rgb, _ = renderer.render(SQUARE, eye, facing(yaw, pitch))
        tone = to_linear(rgb[60:68, 60:68].reshape(-1, 3).mean(0) / 255.0)
        assert np.allclose(tone / tone.sum(), to_linear(color) / to_linear(color).sum(), atol=0.01)
        tones.append(tone.sum())
    assert abs(tones[0] - tones[1]) > 0.05 * max(tones)  # top and side differ


QUADRANTS = np.zeros((64, 64, 3), dtype=np.uint8)
QUADRANTS[:32, :32] = (255, 0, 0)  # upper left
QUADRANTS[:32, 32:] = (0, 255, 0)
QUADRANTS[32:, :32] = (0, 0, 255)
QUADRANTS[32:, 32:] = (255, 255, 0)  # lower right


def test_textures_are_upright_and_not_mirrored(tmp_path: Path) -> None:
    rgb, _ = make_renderer(write_wall(tmp_path, QUADRANTS)).render(SQUARE, [0, 0, 1], facing(0.0))
    seen = [tuple(int(c) for c in rgb[r, c]) for r, c in ((50, 50), (50, 77), (77, 50), (77, 77))]
    assert seen == [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)]


def test_walls_are_double_sided(tmp_path: Path) -> None:
    renderer = make_renderer(write_wall(tmp_path, QUADRANTS))
    rgb, depth = renderer.render(SQUARE, [4, 0, 1], facing(np.pi))
    assert tuple(rgb[50, 77]) == (255, 0, 0)  # from behind, left and right change places
    assert abs(depth[64, 64] - 2.0) < 1e-5


@pytest.mark.parametrize("level", [0, 1, 12, 77, 128, 200, 254, 255])
def test_a_scan_shows_its_texture_as_it_is(tmp_path: Path, level: int) -> None:
    rng = np.random.default_rng(level)
    image = rng.integers(0, 256, (64, 64, 3), dtype=np.uint8)
    image[16:48, 16:48] = level
    rgb, _ = make_renderer(write_wall(tmp_path, image)).render(SQUARE, [1.5, 0, 1], facing(0.0))
    assert (rgb[48:80, 48:80] == level).all()


def test_repeated_textures_are_lit_as_bare_colours(tmp_path: Path) -> None:
    image = np.full((64, 64, 3), 200, dtype=np.uint8)
    image[:32] = 100
    once = make_renderer(write_wall(tmp_path / "a", image))
    tiled = make_renderer(write_wall(tmp_path / "b", image, repeat=4.0))
    eye, quat = [0.5, 0.0, 1.0], facing(0.0)
    assert set(np.unique(once.render(SQUARE, eye, quat)[0][30:50, 30:90])) == {100}
    assert not {100, 200} & set(np.unique(tiled.render(SQUARE, eye, quat)[0][30:50, 30:90]))


def fine_checker() -> np.ndarray:
    return np.repeat(((np.indices((1024, 1024)).sum(0) % 2) * 255)[..., None], 3, -1).astype(
        np.uint8
    )


def test_a_far_checker_turns_into_its_mean_light_and_does_not_shimmer(tmp_path: Path) -> None:
    renderer = make_renderer(write_wall(tmp_path, fine_checker()))
    inside = np.s_[56:72, 56:72]
    first, _ = renderer.render(SQUARE, [-2.0, 0.0, 1.0], facing(0.0))
    moved, _ = renderer.render(SQUARE, [-2.0, 0.001, 1.001], facing(0.0))
    # Half of the light, not half of the bytes.
    assert np.abs(first[inside].astype(int) - int(to_srgb(0.5) * 255)).max() <= 2
    assert np.abs(first[inside].astype(int) - moved[inside]).max() <= 2


@pytest.mark.parametrize("tilt", [0.0, 1.2, 1.45])
def test_filtering_holds_at_flat_angles(tmp_path: Path, tilt: float) -> None:
    image = np.repeat(np.repeat(fine_checker()[:128, :128], 8, 0), 8, 1)  # 64 × 8 px squares
    renderer = make_renderer(write_wall(tmp_path, image))
    # Look along the wall from the side; its far end is seen almost edge-on.
    distance = 3.0
    position = np.array([2.0 - distance * np.cos(tilt), -distance * np.sin(tilt), 1.0])
    quat = facing(float(np.arctan2(-position[1], 2.0 - position[0])))
    a, depth = renderer.render(SQUARE, position, quat)
    b, _ = renderer.render(SQUARE, position + np.array([0, 0, 0.001]), quat)
    seen = depth > 0
    assert np.abs(a.astype(int) - b)[seen].mean() < 6.0


def test_edges_are_smooth_in_colour_and_sharp_in_depth(tmp_path: Path) -> None:
    renderer = make_renderer(write_wall(tmp_path, np.full((8, 8, 3), 255, dtype=np.uint8)))
    camera = CameraModel("tilted", 128, 128, 90.0)
    c, s = np.cos(0.15), np.sin(0.15)
    roll = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    quat = matrix_to_quat(roll @ quat_to_matrix(facing(0.0)))
    rgb, depth = renderer.render(camera, [0.0, 0.0, 1.0], quat)
    assert set(np.unique(np.round(depth, 4))) == {0.0, 2.0}
    levels = len(np.unique(rgb[..., 0]))
    assert levels >= 5  # wall, background, and at least three mixtures along the slanted edge


def test_the_cut_takes_off_what_is_above_it(renderer: Renderer) -> None:
    down, eye = facing(0.0, np.pi / 2), [0.9, 3.35, 3.0]
    _, whole = renderer.render(SQUARE, eye, down)
    _, cut = renderer.render(SQUARE, eye, down, cut_above_m=0.5)
    assert abs(whole[64, 64] - 2.25) < 1e-4  # the table's top
    assert abs(cut[64, 64] - 3.0) < 1e-4  # its inside, down to the floor


def test_rendering_is_deterministic(two_rooms: SceneBundle, renderer: Renderer) -> None:
    pose = ([1.0, 2.0, 0.45], facing(0.2, 0.1))
    first = renderer.render(SQUARE, *pose)
    renderer.render(SQUARE, [3.0, 2.0, 1.0], facing(2.0))
    for again in (renderer.render(SQUARE, *pose), make_renderer(two_rooms).render(SQUARE, *pose)):
        assert np.array_equal(first[0], again[0])
        assert np.array_equal(first[1], again[1])


def test_frames_do_not_share_memory(renderer: Renderer) -> None:
    rgb, depth = renderer.render(SQUARE, [1.0, 2.0, 0.45], facing(0.0))
    before = rgb.copy(), depth.copy()
    renderer.render(SQUARE, [1.0, 2.0, 0.45], facing(3.0))
    assert np.array_equal(rgb, before[0])
    assert np.array_equal(depth, before[1])


def test_unknown_names_list_the_valid_ones(two_rooms: SceneBundle) -> None:
    with pytest.raises(UnknownNameError, match="renderer 'vulkan'; valid: embree"):
        make_renderer(two_rooms, "vulkan")
    with pytest.raises(UnknownNameError, match="light 'disco'; valid: CL, DL300, DL5000, baked"):
        make_renderer(two_rooms, light="disco")


@pytest.mark.parametrize("limit", [10**9, 40_000, 10_000, 700])
def test_textures_are_halved_until_they_fit(tmp_path: Path, limit: int) -> None:
    image = np.full((128, 256, 3), 90, dtype=np.uint8)
    bundle = write_wall(tmp_path, image)
    pack = load_materials(bundle, limit).pack
    width, height = pack.size_px[0, 0]
    assert width * height <= limit
    assert width * height * 4 > min(limit, 128 * 256)  # not smaller than needed
    assert width == 2 * height


def test_mip_levels_keep_the_light(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    image = rng.integers(0, 256, (64, 128, 3), dtype=np.uint8)
    mean = to_linear(image / 255.0).mean((0, 1))
    for mip in mip_pyramid(image):
        roots = np.stack([(mip >> shift) & 1023 for shift in (0, 10, 20)], axis=-1) / 1023.0
        assert np.allclose((roots**2).mean((0, 1)), mean, atol=2e-3)


@pytest.mark.parametrize("content", [None, b"no picture"])
def test_a_bad_texture_is_named(tmp_path: Path, content: bytes | None) -> None:
    bundle = write_wall(tmp_path, QUADRANTS)
    texture = tmp_path / "textures" / "wall.png"
    texture.unlink()
    if content is not None:
        texture.write_bytes(content)
    with pytest.raises(FileFormatError, match=r"wall\.png"):
        make_renderer(bundle)
