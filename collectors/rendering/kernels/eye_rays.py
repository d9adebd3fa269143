"""The kernel that traces rays from the eye and shades the scene's surfaces that they hit.

Each packet of rays passes through four steps: trace, shadow rays to the lamp, texture footprints,
shading. Steps and helpers are inlined, since passing arrays between compiled functions counts
references atomically, which costs more than a texture look-up.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ....formats.core.kernel import kernel
from .data import F32, FAST, Hits, LightArrays, Packets, SceneArrays
from .embree_library import call_intersect, call_occluded, prefetch
from .packets import FAR, GEOM, HIT_U, HIT_V, NORMAL, PRIM, VALID, fill_ray
from .surface_light import (
    SPHERE_REACH_M,
    background,
    exposed,
    incident,
    robot_shadow,
    viewer_side,
)
from .texture_sampling import footprint, prefetch_texels, sample_texture

f32 = np.float32


class Lanes(NamedTuple):
    """One packet of rays on its way through the steps.

    Attributes:
        size: rays per packet.
        rays, bits: the packet, and the same memory as int32; see `packets.packet`.
        starts: (16,) ray parameters of the rays' origins.
        taps: (16,) taps of the texture footprints.
        samples: (16, 5) u, v, mip level, and the longer side of the footprints.
    """

    size: int
    rays: F32
    bits: NDArray[np.int32]
    starts: F32
    taps: NDArray[np.int32]
    samples: F32


@kernel(error_model="numpy", fastmath=FAST)
def render_rays(
    order: NDArray[np.int32],
    directions: F32,
    pixel: F32,
    eye: F32,
    cut_above_m: float,
    packets: Packets,
    scene: SceneArrays,
    light: LightArrays,
    spheres: F32,
    hits: Hits,
):
    """Trace rays from the eye and shade the surfaces of the scene that they hit.

    Args:
        order: (P · lanes,) rays of each packet, −1 = an idle lane.
        directions: (N, 3), world, of unit length along the optical axis.
        pixel: (2, 3) change of a direction per sample to the right and down: the footprint.
        eye: (3,) optical centre [m].
        cut_above_m: rays start where they pass this world z.
        packets: how to trace.
        scene: the scene.
        light: the light.
        spheres: (S, 4) centre and radius [m] of the robot's spheres, which darken nearby surfaces.
        hits: of the N rays, written.
    """
    count, rays = packets.lanes, packets.rays
    lanes = Lanes(
        count,
        rays,
        rays.view(np.int32),
        np.zeros(16, dtype=np.float32),
        np.zeros(16, dtype=np.int32),
        np.zeros((16, 5), dtype=np.float32),
    )
    lit_apart = light.relit and light.lamp_apart and light.lamp[6] > f32(0.0)
    records, texels = np.int64(scene.face.ctypes.data), np.int64(scene.pack.texels.ctypes.data)
    reach = np.empty((2, 3), dtype=np.float32)  # bounds of what the robot darkens
    reach[0] = np.inf
    reach[1] = -np.inf
    for s in range(spheres.shape[0]):
        for k in range(3):
            reach[0, k] = min(reach[0, k], spheres[s, k] - f32(SPHERE_REACH_M))
            reach[1, k] = max(reach[1, k], spheres[s, k] + f32(SPHERE_REACH_M))
    for first in range(0, order.shape[0], count):
        _fill_packet(lanes, order, first, directions, eye, cut_above_m)
        call_intersect(
            count,
            rays.ctypes.data + 4 * VALID,
            packets.scene,
            rays.ctypes.data,
            packets.arguments.ctypes.data,
        )
        for k in range(count):
            if lanes.bits[GEOM * count + k] != -1:
                face = np.int64(lanes.bits[PRIM * count + k])
                prefetch(np.uintp(records + np.int64(64) * face))
        if lit_apart:
            _trace_lamp(lanes, order, first, directions, eye, packets, light.lamp)
        for k in range(count):
            i = order[first + k]
            if i >= 0 and lanes.bits[GEOM * count + k] != -1:
                _find_footprint(lanes, k, i, directions, pixel, scene, texels)
        for k in range(count):
            i = order[first + k]
            if i < 0:
                continue
            if lanes.bits[GEOM * count + k] == -1:
                hits.depth[i] = f32(np.inf)
                hits.surface[i] = -1
                hits.prim[i] = -1
                dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
                red, green, blue = background(dx, dy, dz, light.room)
            else:
                gain = f32(1.0)
                if lit_apart and packets.shadow_rays[FAR * count + k] < f32(0.0):
                    gain = f32(0.0)
                red, green, blue = _shade(
                    lanes, k, i, directions, eye, scene, light, gain, spheres, reach, hits
                )
            hits.color[i, 0] = red
            hits.color[i, 1] = green
            hits.color[i, 2] = blue


@njit(inline="always", error_model="numpy")
def _fill_packet(lanes, order, first, directions, eye, cut_above_m):
    """Write the rays `order[first : first + size]` into the packet."""
    for k in range(lanes.size):
        i = max(order[first + k], 0)
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        start = f32(0.0)
        if eye[2] > cut_above_m:  # if a ray never passes the cut, it starts far away
            start = f32(cut_above_m - eye[2]) / min(dz, f32(-1e-6))
        lanes.starts[k] = start
        fill_ray(
            lanes.rays, lanes.bits, lanes.size, k,
            eye[0] + start * dx, eye[1] + start * dy, eye[2] + start * dz,
            dx, dy, dz, f32(np.inf),
        )  # fmt: skip
        lanes.bits[GEOM * lanes.size + k] = -1
        if order[first + k] < 0:
            lanes.bits[VALID + k] = 0


@njit(inline="always", error_model="numpy")
def _normal_at(lanes, k):
    """Return the normal that Embree gave for the hit in lane `k`, of any length and side."""
    return (
        lanes.rays[NORMAL * lanes.size + k],
        lanes.rays[(NORMAL + 1) * lanes.size + k],
        lanes.rays[(NORMAL + 2) * lanes.size + k],
    )


@njit(inline="always", error_model="numpy")
def _trace_lamp(lanes, order, first, directions, eye, packets, lamp):
    """Trace shadow rays from a packet's hits to the lamp; `FAR` of occluded ones becomes −inf."""
    shadow_rays = packets.shadow_rays
    shadow_bits = shadow_rays.view(np.int32)
    for k in range(lanes.size):
        shadow_bits[VALID + k] = 0
        i = order[first + k]
        if i < 0 or lanes.bits[GEOM * lanes.size + k] == -1:
            continue
        nx, ny, nz = _normal_at(lanes, k)
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        flip, _ = viewer_side(nx, ny, nz, dx, dy, dz, f32(1e-30))
        t = lanes.rays[FAR * lanes.size + k] + lanes.starts[k]
        # Shadow rays start 2 mm in front of the surface.
        x = eye[0] + t * dx + f32(2e-3) * (nx * flip)
        y = eye[1] + t * dy + f32(2e-3) * (ny * flip)
        z = eye[2] + t * dz + f32(2e-3) * (nz * flip)
        fill_ray(
            shadow_rays, shadow_bits, lanes.size, k,
            x, y, z, lamp[0] - x, lamp[1] - y, lamp[2] - z, f32(1.0),
        )  # fmt: skip
    call_occluded(
        lanes.size,
        shadow_rays.ctypes.data + 4 * VALID,
        packets.scene,
        shadow_rays.ctypes.data,
        packets.arguments.ctypes.data,
    )


@njit(inline="always", error_model="numpy")
def _find_footprint(lanes, k, i, directions, pixel, scene, texels):
    """Compute and prefetch the texture footprint of the hit of ray `i` in lane `k`, if any.

    Args:
        lanes: the packet; its `taps` and `samples` are written.
        k: lane.
        i: ray.
        directions: (N, 3) of all rays.
        pixel: (2, 3), see `render_rays`.
        scene: the scene.
        texels: address of the texels.
    """
    face = np.uint64(lanes.bits[PRIM * lanes.size + k])
    texture = scene.texture[np.uint64(np.int32(scene.face[face, 12]))]
    if texture >= 0:
        texture = np.uint64(texture)
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        t = lanes.rays[FAR * lanes.size + k] + lanes.starts[k]
        # Where the neighbouring pixels' rays meet this plane: exact ray differentials.
        nx, ny, nz = _normal_at(lanes, k)
        along = nx * dx + ny * dy + nz * dz
        per_along = f32(0.0)
        if along != f32(0.0):
            per_along = f32(1.0) / along
        sx, sy, sz = scene.face[face, 0], scene.face[face, 1], scene.face[face, 2]
        tx, ty, tz = scene.face[face, 3], scene.face[face, 4], scene.face[face, 5]
        px, py, pz = pixel[0, 0], pixel[0, 1], pixel[0, 2]
        tilt = (nx * px + ny * py + nz * pz) * per_along
        px, py, pz = t * (px - tilt * dx), t * (py - tilt * dy), t * (pz - tilt * dz)
        qx, qy, qz = pixel[1, 0], pixel[1, 1], pixel[1, 2]
        tilt = (nx * qx + ny * qy + nz * qz) * per_along
        qx, qy, qz = t * (qx - tilt * dx), t * (qy - tilt * dy), t * (qz - tilt * dz)
        s1, t1 = scene.face[face, 8], scene.face[face, 9]
        s2, t2 = scene.face[face, 10], scene.face[face, 11]
        u = lanes.rays[HIT_U * lanes.size + k]
        v = lanes.rays[HIT_V * lanes.size + k]
        sample_u = scene.face[face, 6] + u * s1 + v * s2
        sample_v = scene.face[face, 7] + u * t1 + v * t2
        count, lod, step_u, step_v = footprint(
            scene.pack,
            texture,
            px * sx + py * sy + pz * sz,
            px * tx + py * ty + pz * tz,
            qx * sx + qy * sy + qz * sz,
            qx * tx + qy * ty + qz * tz,
        )
        prefetch_texels(scene.pack, texels, texture, lod, sample_u, sample_v)
        lanes.taps[k] = count
        lanes.samples[k, 0] = sample_u
        lanes.samples[k, 1] = sample_v
        lanes.samples[k, 2] = lod
        lanes.samples[k, 3] = step_u
        lanes.samples[k, 4] = step_v


@njit(inline="always", error_model="numpy")
def _shade(lanes, k, i, directions, eye, scene, light, gain, spheres, reach, hits):
    """Shade the hit of ray `i` in lane `k`, and return red, green and blue in linear light.

    Args:
        lanes: the packet.
        k: lane.
        i: ray.
        directions: (N, 3) of all rays.
        eye: (3,) optical centre [m].
        scene: the scene.
        light: the light.
        gain: 1 where the lamp reaches, 0 in its shadow.
        spheres: (S, 4), see `render_rays`.
        reach: (2, 3) bounds of what the spheres darken [m].
        hits: depth, surface and triangle of the ray are written.
    """
    dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
    face = lanes.bits[PRIM * lanes.size + k]
    material = np.int32(scene.face[np.uint64(face), 12])
    t = lanes.rays[FAR * lanes.size + k] + lanes.starts[k]
    hits.depth[i] = t
    hits.surface[i] = material
    hits.prim[i] = face
    nx, ny, nz = _normal_at(lanes, k)
    square = nx * nx + ny * ny + nz * nz
    flip, cosine = viewer_side(nx, ny, nz, dx, dy, dz, f32(1e-30))
    nx, ny, nz = nx * flip, ny * flip, nz * flip
    red = scene.base_linear[material, 0]
    green = scene.base_linear[material, 1]
    blue = scene.base_linear[material, 2]
    texture = scene.texture[material]
    if texture >= 0:
        u, v, lod = lanes.samples[k, 0], lanes.samples[k, 1], lanes.samples[k, 2]
        step_u, step_v = lanes.samples[k, 3], lanes.samples[k, 4]
        r, g, b = sample_texture(scene.pack, texture, u, v, lanes.taps[k], lod, step_u, step_v)
        red *= r
        green *= g
        blue *= b
    x, y, z = eye[0] + t * dx, eye[1] + t * dy, eye[2] + t * dz
    if scene.shaded[material] and square > f32(0.0):
        factor = incident(x, y, z, nx, ny, nz, cosine, True, light, gain)
        red = exposed(red * factor, light)
        green = exposed(green * factor, light)
        blue = exposed(blue * factor, light)
    if (
        x > reach[0, 0]
        and y > reach[0, 1]
        and z > reach[0, 2]
        and x < reach[1, 0]
        and y < reach[1, 1]
        and z < reach[1, 2]
    ):
        factor = robot_shadow(spheres, x, y, z, nx, ny, nz)
        red *= factor
        green *= factor
        blue *= factor
    return red, green, blue
