"""The back end for gsplat, against a stand-in that follows gsplat's documented conventions."""

import sys
from dataclasses import replace
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.geometry.splatting.test_draw import eye_at
from tests.support.scenes.splat_reference import psnr_db, reference_image
from tests.support.scenes.splats import random_cloud
from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.frames import matrix_to_quat, quat_to_matrix
from vlnpe.formats.splats.record import GaussianCloud
from vlnpe.geometry.splatting import backend
from vlnpe.geometry.splatting.backend import CpuDrawer, GsplatDrawer, make_drawer, why_no_gsplat
from vlnpe.geometry.splatting.draw import NEAR_M, Eye

torch = pytest.importorskip("torch")


def rasterization(
    *parts: Any, viewmats: Any, Ks: Any, width: int, height: int, **more: Any
) -> tuple[Any, Any, dict]:
    """Draw as gsplat says it does, with the plain reference; check what it is given."""
    means, quats, scales, opacities, colors = parts
    count = len(means)
    assert means.shape == scales.shape == (count, 3) and quats.shape == (count, 4)
    assert opacities.shape == (count,) and colors.shape[::2] == (count, 3)
    assert viewmats.shape == (1, 4, 4) and Ks.shape == (1, 3, 3)
    assert all(t.dtype == torch.float32 for t in (*parts, Ks))
    assert (more["sh_degree"] + 1) ** 2 == colors.shape[1]
    assert more["near_plane"] == NEAR_M and more["eps2d"] == pytest.approx(0.3)
    assert more["render_mode"] == "RGB+ED"
    view, lens = viewmats[0].numpy().astype(float), Ks[0].numpy()
    # Pixel centres lie at half numbers, so that the image's centre is at half its size.
    assert lens[:2, 2] == pytest.approx([width / 2, height / 2])
    cloud = GaussianCloud(*(t.numpy() for t in (means, scales, quats, opacities, colors)))
    camera = CameraModel("gsplat", width, height, 2 * np.degrees(np.arctan(width / 2 / lens[0, 0])))
    eye = Eye(camera, -view[:3, :3].T @ view[:3, 3], view[:3, :3].T)
    filtered = {"antialiased": True, "classic": False}[more["rasterize_mode"]]
    color, light = reference_image(cloud, eye, antialiased=filtered)
    depth = np.full((height, width, 1), np.mean(means.numpy() @ view[2, :3] + view[2, 3]))
    image = torch.from_numpy(np.concatenate([color, depth], axis=2)[None].astype(np.float32))
    return image, torch.from_numpy((1 - light)[None, ..., None].astype(np.float32)), {}


@pytest.fixture
def gsplat(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("gsplat")
    monkeypatch.setattr(module, "rasterization", rasterization, raising=False)
    monkeypatch.setitem(sys.modules, "gsplat", module)


def turned_eye() -> Eye:
    """Return an eye that looks at the origin from a corner."""
    quat = matrix_to_quat(eye_at(0.0).rotation_world)
    turn = quat_to_matrix([np.cos(0.3), 0, 0, np.sin(0.3)])
    rotation = turn @ quat_to_matrix(quat)
    return Eye(eye_at(0.0).camera, -3.0 * rotation[:, 2] + (0, 0, 0.2), rotation)


@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("degree", [0, 3])
@pytest.mark.usefixtures("gsplat")
def test_gsplat_is_asked_for_the_same_picture(degree: int, antialiased: bool) -> None:
    cloud = random_cloud(np.random.default_rng(1), 150, degree)
    cloud = replace(cloud, antialiased=antialiased)
    eye = turned_eye()
    drawn = GsplatDrawer(cloud, device="cpu").draw(eye, None, np.inf)
    ours = CpuDrawer(cloud).draw(eye, None, np.inf)
    assert drawn.color.dtype == drawn.light.dtype == np.float32
    assert psnr_db(drawn.color, ours.color) >= 45.0
    assert psnr_db(drawn.light, ours.light) >= 45.0
    deep = GsplatDrawer(cloud, device="cpu").draw(eye, None, np.inf, with_depth=True)
    seen = deep.light < 1
    assert seen.any() and not seen.all()
    # The stand-in returns one depth everywhere.
    assert (deep.depth_m[seen] > 2).all() and not deep.depth_m[~seen].any()
    assert not drawn.depth_m.size, "no depth unless wanted"


@pytest.mark.usefixtures("gsplat")
def test_bodies_and_cuts_hide_splats_there_too() -> None:
    cloud = random_cloud(np.random.default_rng(2), 150)
    drawer, eye = GsplatDrawer(cloud, device="cpu"), turned_eye()
    shape = eye.camera.height_px, eye.camera.width_px
    cover = np.full(shape, np.inf, np.float32)
    cover[:, :20] = 0.5  # in front of the cloud
    image = drawer.draw(eye, cover, np.inf)
    assert not image.color[:, :20].any() and (image.light[:, :20] == 1).all()
    assert np.array_equal(image.color[:, 20:], drawer.draw(eye, None, np.inf).color[:, 20:])
    cut = drawer.draw(eye, None, 0.1)
    low = GsplatDrawer(cloud.take(cloud.position[:, 2] <= 0.1), device="cpu")
    assert np.array_equal(cut.color, low.draw(eye, None, np.inf).color)


def test_gsplat_is_used_if_it_and_cuda_are_available(
    gsplat: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    cloud = random_cloud(np.random.default_rng(3), 10)
    monkeypatch.setattr(backend, "find_spec", lambda name: None if name == "gsplat" else object())
    assert why_no_gsplat() == "gsplat is not installed"
    assert make_drawer(cloud).name == "cpu"
    monkeypatch.setattr(backend, "find_spec", lambda name: object())
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert "no CUDA device" in why_no_gsplat()
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(backend, "GsplatDrawer", lambda cloud: SimpleNamespace(name="gsplat"))
    assert make_drawer(cloud).name == "gsplat"
