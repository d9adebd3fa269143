"""Rays from surfaces to the lamp, to be inlined into kernels."""

from __future__ import annotations

import numpy as np
from numba import njit

from .data import Packets
from .packets import DIRECTION, FAR, MASK, NEAR, ORIGIN, PACKET_ROWS, RAY_FLAGS, TIME

f32 = np.float32


@njit(inline="always", error_model="numpy")
def fill_shadow_ray(packets: Packets, k, x, y, z, nx, ny, nz, lamp):
    """Put the ray from a point to the lamp into lane `k`.

    Args:
        packets: rays.
        k: lane.
        x: point [m], x.
        y: point [m], y.
        z: point [m], z.
        nx: unit normal on the viewer's side, x.
        ny: y.
        nz: z.
        lamp: its position first.
    """
    lanes = packets.lanes
    rays = packets.shadow_rays
    bits = rays.view(np.int32)
    bits[PACKET_ROWS * 16 + k] = -1
    x += f32(2e-3) * nx
    y += f32(2e-3) * ny
    z += f32(2e-3) * nz
    rays[ORIGIN * lanes + k] = x
    rays[(ORIGIN + 1) * lanes + k] = y
    rays[(ORIGIN + 2) * lanes + k] = z
    rays[DIRECTION * lanes + k] = lamp[0] - x
    rays[(DIRECTION + 1) * lanes + k] = lamp[1] - y
    rays[(DIRECTION + 2) * lanes + k] = lamp[2] - z
    rays[NEAR * lanes + k] = f32(0.0)
    rays[TIME * lanes + k] = f32(0.0)
    rays[FAR * lanes + k] = f32(1.0)
    bits[MASK * lanes + k] = -1
    bits[RAY_FLAGS * lanes + k] = 0
