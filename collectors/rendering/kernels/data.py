"""Arguments of the kernels: the scene, its light, and how to trace rays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..light.cube_grid import CubeGrid
from ..scene.textures import TexturePack

F32 = NDArray[np.float32]

# All of LLVM's fast-math flags but those that assume that there are no infinities and NaNs.
FAST = {"contract", "arcp", "nsz", "reassoc"}


class SceneArrays(NamedTuple):
    """A scene as arrays for kernels.

    Attributes:
        face: (F, 16) what shading needs of each triangle, in one cache line:
            gradients of the texture coordinates [1/m] (0–2, 3–5), texture coordinates of the first
            corner (6, 7) and steps to the others (8–11), material (12).
        base_linear: (M, 3) base colours in linear light.
        texture: (M,) int32 index of the texture, −1 = none.
        shaded: (M,) bool: whether the light falls on it; otherwise its texture is shown unchanged.
        pack: the textures.
    """

    face: F32
    base_linear: F32
    texture: NDArray[np.int32]
    shaded: NDArray[np.bool_]
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
    """What kernels need to trace rays.

    Attributes:
        scene: address of Embree's scene.
        arguments: RTCIntersectArguments of a packet call.
        rays, shadow_rays: memory for one packet each; see `packets.packet`.
        lanes: rays per packet.
    """

    scene: int
    arguments: NDArray[np.int32]
    rays: F32
    shadow_rays: F32
    lanes: int


class Hits(NamedTuple):
    """What N rays show.

    Attributes:
        color: (N, 3) linear light.
        depth: (N,) planar depth [m]; inf = nothing.
        surface: (N,) material; −1 = nothing, less = a part of the robot.
        prim: (N,) triangle of the scene; −1 = nothing.
    """

    color: F32
    depth: F32
    surface: NDArray[np.int32]
    prim: NDArray[np.int32]
