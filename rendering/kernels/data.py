"""Arguments of the kernels: the scene, its light, and how to trace rays."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...formats.core.arrays import F32, I32, I64, Mask
from ...geometry.rays.library import lanes
from ...geometry.rays.packets import PacketScene, packet
from .cube_grid import CubeGrid

# All of LLVM's fast-math flags but those that assume that there are no infinities and NaNs.
FAST = {"contract", "arcp", "nsz", "reassoc"}
# Numba counts references to arrays with locked instructions, several for each array that a loop
# touches; here these took nine tenths of the time. A kernel compiled so must create no arrays.
UNCOUNTED = {"_nrt": False}


class TexturePack(NamedTuple):
    """Mip pyramids of T textures.

    Attributes:
        texels: (N,) uint32, row 0 = top of the image; 10 bits each of red (lowest), green and blue,
            the square root of linear light. It distinguishes all sRGB bytes, is decoded by one
            multiplication and read in one access. Each level has its first column and row again
            at its end, so that a pixel and its right neighbour, also around the edge, are one load.
        offset: (T, levels) int64 index into `texels` of each level.
        size_px: (T, levels, 2) int32 width and height of each level, without what is repeated.
        levels: (T,) int32 number of levels.
    """

    texels: NDArray[np.uint32]
    offset: I64
    size_px: I32
    levels: I32

    def level(self, texture: int, level: int) -> NDArray[np.uint32]:
        """Return a level's texels (H, W)."""
        width, height = (int(side) for side in self.size_px[texture, level])
        rows = self.texels[self.offset[texture, level] :][: (width + 1) * (height + 1)]
        return rows.reshape(height + 1, width + 1)[:height, :width]


class SceneArrays(NamedTuple):
    """A scene as arrays for kernels.

    Attributes:
        face: (F, 16) what shading needs of each triangle, in one cache line:
            gradients of the texture coordinates [1/m] (0–2, 3–5), texture coordinates of the first
            corner (6, 7) and steps to the others (8–11), material (12).
        base_linear: (M, 3) base colours in linear light.
        texture: (M,) int32 index of the texture, −1 = none.
        shaded: (M,) bool: whether the light falls on it; otherwise its texture is shown unchanged.
    """

    face: F32
    base_linear: F32
    texture: I32
    shaded: Mask
    pack: TexturePack


class LightArrays(NamedTuple):
    """A light as arrays for kernels.

    Attributes:
        room: `Light.parameters()`.
        relit: whether light falls only from panels and the lamp, instead of the fixed room light.
        grid: openness of corners under the fixed room light, else irradiance.
        lamp: (8,) position [m], direction, strength, unused; strength 0 = no lamp.
        lamp_apart: whether the lamp is not at the eye, so that its shadows are visible.
    """

    room: F32
    relit: bool
    grid: CubeGrid
    lamp: F32
    lamp_apart: bool


class Packets(NamedTuple):
    """One packet of rays on its way through a kernel, and how to trace it.

    Attributes:
        scene: address of Embree's scene.
        arguments: RTCIntersectArguments of a packet call.
        size: rays per packet.
        rays, bits: the packet, and the same memory as int32; see `packets.packet`.
        shadow_rays, shadow_bits: the packet of its shadow rays, likewise.
        starts: (16,) ray parameters of the rays' origins.
        reused: (16,) rays traced before whose colours the rays get, −1 = none.
        taps: (16,) taps of the texture footprints.
        samples: (16, 5) u, v, mip level, and the longer side of the footprints.
    """

    scene: int
    arguments: I32
    size: int
    rays: F32
    bits: I32
    shadow_rays: F32
    shadow_bits: I32
    starts: F32
    reused: I32
    taps: I32
    samples: F32

    @classmethod
    def of(cls, scene: PacketScene) -> "Packets":
        """Allocate the packets for a scene."""
        rays, shadow_rays = packet(), packet()
        return cls(
            scene.handle, scene.arguments, lanes(),
            rays, rays.view(np.int32), shadow_rays, shadow_rays.view(np.int32),
            np.zeros(16, dtype=np.float32), np.zeros(16, dtype=np.int32),
            np.zeros(16, dtype=np.int32), np.zeros((16, 5), dtype=np.float32),
        )  # fmt: skip


class Hits(NamedTuple):
    """Surfaces that N rays show.

    Attributes:
        color: (N, 3) linear light.
        depth: (N,) planar depth [m]; inf = nothing.
        surface: (N,) material; −1 = nothing, less = a part of the robot.
        prim: (N,) triangle of the scene; −1 = nothing.
    """

    color: F32
    depth: F32
    surface: I32
    prim: I32

    @classmethod
    def nothing(cls, count: int) -> "Hits":
        """Return hits of `count` rays that show nothing, in black."""
        return cls(
            np.zeros((count, 3), dtype=np.float32),
            np.full(count, np.inf, dtype=np.float32),
            np.full(count, -1, dtype=np.int32),
            np.full(count, -1, dtype=np.int32),
        )
