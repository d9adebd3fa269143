"""What the kernels are given: the scene, its light, and how to trace rays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..light.cube_grid import CubeGrid
from ..scene.textures import TexturePack

F32 = NDArray[np.float32]

# Everything but assuming that there are no infinities and NaNs.
FAST = {"contract", "arcp", "nsz", "reassoc"}


class SceneArrays(NamedTuple):
    """The scene as kernels see it.

    Attributes:
        face: (F, 16) all that shading needs of a triangle, in one line of the processor's cache:
            gradients of the texture coordinates [1/m] (0–2, 3–5), texture coordinates of the first
            corner (6, 7) and steps to the others (8–11), material (12).
        base_linear: (M, 3) base colours in linear light.
        texture: (M,) int32 index of the texture, −1 = none.
        shaded: (M,) bool: lit by the light; otherwise shown as it is.
        pack: the textures.
    """

    face: F32
    base_linear: F32
    texture: NDArray[np.int32]
    shaded: NDArray[np.bool_]
    pack: TexturePack


class LightArrays(NamedTuple):
    """A light as kernels see it.

    Attributes:
        room: `Light.parameters()`.
        relit: whether light falls only from panels and the lamp, instead of the fixed room light.
        grid: openness of corners under the fixed room light, else irradiance.
        lamp: (8,) position [m], direction, strength, unused; strength 0 = no lamp.
        lamp_apart: whether the lamp stands elsewhere than the eye, so that it throws shadows.
    """

    room: F32
    relit: bool
    grid: CubeGrid
    lamp: F32
    lamp_apart: bool


class Packets(NamedTuple):
    """How kernels trace rays.

    Attributes:
        scene: address of Embree's scene.
        arguments: of a packet call.
        rays, shadow_rays: room for a packet each; see `packets.packet`.
        lanes: rays per packet.
    """

    scene: int
    arguments: NDArray[np.int32]
    rays: F32
    shadow_rays: F32
    lanes: int
