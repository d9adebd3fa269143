"""Draw splats on the CPU, or with gsplat on CUDA where both are there; one interface.

Facts about gsplat are those of its documentation (1.5.3): quaternions wxyz, opacities and scales
activated, world-to-camera matrices with z forward, harmonics as 3DGS has them, pixel centres at
half numbers. No machine with CUDA has run this module yet.
"""

import importlib
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np

from ...formats.core.arrays import F32
from ...formats.splats.record import GaussianCloud
from .draw import NEAR_M, Eye, SplatImage, draw_splats
from .project import BLUR_PX2
from .scene import SplatScene

# On the CPU Gaussians are merged where they are narrower than this [px], and a pixel is finished
# when what follows would change it by less than half a step of 8 bits.
DETAIL_PX, LEAST_LIGHT = 0.3, 1 / 512


class SplatDrawer(Protocol):
    """Draws one cloud from any eye; its name is `cpu` or `gsplat`."""

    name: str

    def draw(
        self, eye: Eye, cover_m: F32 | None, cut_above_m: float, *, with_depth: bool = False
    ) -> SplatImage:
        """Draw colour and light, and the mean depth if wanted; see `draw_splats`."""
        ...


class CpuDrawer:
    """The CPU rasteriser."""

    name = "cpu"

    def __init__(self, cloud: GaussianCloud):
        self._scene = SplatScene.of(cloud, detail=True)

    def draw(
        self, eye: Eye, cover_m: F32 | None, cut_above_m: float, *, with_depth: bool = False
    ) -> SplatImage:
        """Draw colour and light, and the mean depth if wanted; see `draw_splats`."""
        options = {"cover_m": cover_m, "cut_above_m": cut_above_m, "with_depth": with_depth}
        return draw_splats(
            self._scene, eye, **options, detail_px=DETAIL_PX, least_light=LEAST_LIGHT
        )


class GsplatDrawer:
    """gsplat on a CUDA device.

    A body in front of the scene hides a pixel's splats as a whole where it is nearer than their
    expected depth, and not Gaussian by Gaussian as on the CPU: gsplat knows no such limit.
    """

    name = "gsplat"

    def __init__(self, cloud: GaussianCloud, device: str = "cuda"):
        self._torch: Any = importlib.import_module("torch")
        self._gsplat: Any = importlib.import_module("gsplat")
        self._device = device
        arrays = (cloud.position, cloud.quat_wxyz, cloud.scale, cloud.opacity, cloud.harmonics)
        self._parts = [self._tensor(array) for array in arrays]
        self._degree = cloud.degree
        self._mode = "antialiased" if cloud.antialiased else "classic"

    def draw(
        self, eye: Eye, cover_m: F32 | None, cut_above_m: float, *, with_depth: bool = False
    ) -> SplatImage:
        """Draw colour and light, and the mean depth if wanted; see `draw_splats`."""
        camera = eye.camera
        width, height, focal = camera.width_px, camera.height_px, camera.focal_px
        view = np.eye(4)
        view[:3, :3] = np.asarray(eye.rotation_world).T
        view[:3, 3] = -view[:3, :3] @ np.asarray(eye.position_world_m)
        # Our pixel centres lie at whole numbers.
        lens = np.array([[focal, 0, 0.5 * width], [0, focal, 0.5 * height], [0, 0, 1]])
        parts = self._parts
        if eye.position_world_m[2] > cut_above_m:
            low = parts[0][:, 2] <= cut_above_m
            parts = [part[low] for part in parts]
        with self._torch.no_grad():
            image, alpha, _ = self._gsplat.rasterization(
                *parts,
                viewmats=self._tensor(view[None]),
                Ks=self._tensor(lens[None]),
                width=width,
                height=height,
                near_plane=NEAR_M,
                eps2d=BLUR_PX2,
                sh_degree=self._degree,
                packed=True,
                render_mode="RGB+ED",
                rasterize_mode=self._mode,
            )
        pixels = image[0].cpu().numpy().astype(np.float32)
        light = 1 - alpha[0, ..., 0].cpu().numpy().astype(np.float32)
        color, depth = pixels[..., :3], pixels[..., 3]
        if cover_m is not None:
            hidden = (cover_m < depth) | (light >= 1)
            color, light = np.where(hidden[..., None], 0, color), np.where(hidden, 1, light)
        none = np.zeros((0, 0), dtype=np.float32)
        mean = np.where(light < 1, depth, 0).astype(np.float32) if with_depth else none
        return SplatImage(np.ascontiguousarray(color), light, mean, none, none)

    def _tensor(self, values: np.ndarray) -> Any:
        plain = np.ascontiguousarray(values, dtype=np.float32)
        return self._torch.from_numpy(plain).to(self._device)


def why_no_gsplat() -> str:
    """Return why gsplat cannot be used here; empty if it can."""
    for name in ("gsplat", "torch"):
        if find_spec(name) is None:
            return f"{name} is not installed"
    torch: Any = importlib.import_module("torch")
    return "" if torch.cuda.is_available() else "torch finds no CUDA device"


def make_drawer(cloud: GaussianCloud) -> SplatDrawer:
    """Return gsplat on CUDA where both are there, else the CPU rasteriser."""
    return CpuDrawer(cloud) if why_no_gsplat() else GsplatDrawer(cloud)
