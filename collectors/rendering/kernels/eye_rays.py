"""The kernel that traces rays from the eye and shades the scene's surfaces that they hit.

Each packet of rays passes through four steps: trace, shadow rays to the lamp, texture footprints,
shading. Steps and helpers are inlined, since passing arrays between compiled functions counts
references atomically, which costs more than a texture look-up.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ....formats.core.kernel import kernel
from .data import F32, FAST, LightArrays, Packets, SceneArrays
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
    color: F32,
    depth: F32,
    surface: NDArray[np.int32],
    prim: NDArray[np.int32],
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
        color: (N, 3) linear light, written.
        depth: (N,) planar depth [m], written; inf = nothing.
        surface: (N,) material, written; −1 = nothing.
        prim: (N,) triangle, written; −1 = nothing.
    """
    lanes = packets.lanes
    rays = packets.rays
    bits = rays.view(np.int32)
    lit_apart = light.relit and light.lamp_apart and light.lamp[6] > f32(0.0)
    starts = np.zeros(16, dtype=np.float32)
    taps = np.zeros(16, dtype=np.int32)
    samples = np.zeros((16, 5), dtype=np.float32)  # u, v, mip level, the footprint's side
    records, texels = np.int64(scene.face.ctypes.data), np.int64(scene.pack.texels.ctypes.data)
    low = np.full(3, np.inf, dtype=np.float32)
    high = np.full(3, -np.inf, dtype=np.float32)
    for s in range(spheres.shape[0]):
        for k in range(3):
            low[k] = min(low[k], spheres[s, k] - f32(SPHERE_REACH_M))
            high[k] = max(high[k], spheres[s, k] + f32(SPHERE_REACH_M))
    for first in range(0, order.shape[0], lanes):
        _fill_packet(order, first, directions, eye, cut_above_m, rays, bits, lanes, starts)
        call_intersect(
            lanes,
            rays.ctypes.data + 4 * VALID,
            packets.scene,
            rays.ctypes.data,
            packets.arguments.ctypes.data,
        )
        for k in range(lanes):
            if bits[GEOM * lanes + k] != -1:
                prefetch(np.uintp(records + np.int64(64) * np.int64(bits[PRIM * lanes + k])))
        if lit_apart:
            _trace_lamp(order, first, directions, eye, packets, bits, starts, light.lamp)
        for k in range(lanes):
            i = order[first + k]
            if i < 0 or bits[GEOM * lanes + k] == -1:
                continue
            face = np.uint64(bits[PRIM * lanes + k])
            texture = scene.texture[np.uint64(np.int32(scene.face[face, 12]))]
            if texture >= 0:
                _find_footprint(
                    k, i, face, np.uint64(texture), directions, pixel, rays, lanes, starts, scene,
                    texels, taps, samples,
                )  # fmt: skip
        for k in range(lanes):
            i = order[first + k]
            if i < 0:
                continue
            dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
            if bits[GEOM * lanes + k] == -1:
                depth[i] = f32(np.inf)
                surface[i] = -1
                prim[i] = -1
                color[i, 0], color[i, 1], color[i, 2] = background(dx, dy, dz, light.room)
                continue
            face = bits[PRIM * lanes + k]
            material = np.int32(scene.face[np.uint64(face), 12])
            t = rays[FAR * lanes + k] + starts[k]
            depth[i] = t
            surface[i] = material
            prim[i] = face
            nx = rays[NORMAL * lanes + k]
            ny = rays[(NORMAL + 1) * lanes + k]
            nz = rays[(NORMAL + 2) * lanes + k]
            flip, cosine = viewer_side(nx, ny, nz, dx, dy, dz, f32(1e-30))
            red = scene.base_linear[material, 0]
            green = scene.base_linear[material, 1]
            blue = scene.base_linear[material, 2]
            texture = scene.texture[material]
            if texture >= 0:
                r, g, b = sample_texture(
                    scene.pack,
                    texture,
                    samples[k, 0],
                    samples[k, 1],
                    taps[k],
                    samples[k, 2],
                    samples[k, 3],
                    samples[k, 4],
                )
                red *= r
                green *= g
                blue *= b
            x = eye[0] + t * dx
            y = eye[1] + t * dy
            z = eye[2] + t * dz
            if scene.shaded[material] and nx * nx + ny * ny + nz * nz > f32(0.0):
                gain = f32(1.0)
                if lit_apart and packets.shadow_rays[FAR * lanes + k] < f32(0.0):
                    gain = f32(0.0)
                factor = incident(
                    x, y, z, nx * flip, ny * flip, nz * flip, cosine, True, light, gain
                )
                red = exposed(red * factor, light)
                green = exposed(green * factor, light)
                blue = exposed(blue * factor, light)
            if (
                x > low[0]
                and y > low[1]
                and z > low[2]
                and x < high[0]
                and y < high[1]
                and z < high[2]
            ):
                factor = robot_shadow(spheres, x, y, z, nx * flip, ny * flip, nz * flip)
                red *= factor
                green *= factor
                blue *= factor
            color[i, 0] = red
            color[i, 1] = green
            color[i, 2] = blue


@njit(inline="always", error_model="numpy")
def _fill_packet(order, first, directions, eye, cut_above_m, rays, bits, lanes, starts):
    """Write one packet of eye rays; `starts` (16,) gets the ray parameters of their origins."""
    for k in range(lanes):
        i = max(order[first + k], 0)
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        start = f32(0.0)
        if eye[2] > cut_above_m:  # if a ray never passes the cut, it starts far away
            start = f32(cut_above_m - eye[2]) / min(dz, f32(-1e-6))
        starts[k] = start
        fill_ray(
            rays, bits, lanes, k,
            eye[0] + start * dx, eye[1] + start * dy, eye[2] + start * dz,
            dx, dy, dz, f32(np.inf),
        )  # fmt: skip
        bits[GEOM * lanes + k] = -1
        if order[first + k] < 0:
            bits[VALID + k] = 0


@njit(inline="always", error_model="numpy")
def _trace_lamp(order, first, directions, eye, packets, bits, starts, lamp):
    """Trace shadow rays from a packet's hits to the lamp; `FAR` of occluded ones becomes −inf."""
    lanes, rays, shadow_rays = packets.lanes, packets.rays, packets.shadow_rays
    shadow_bits = shadow_rays.view(np.int32)
    for k in range(lanes):
        shadow_bits[VALID + k] = 0
        i = order[first + k]
        if i < 0 or bits[GEOM * lanes + k] == -1:
            continue
        nx = rays[NORMAL * lanes + k]
        ny = rays[(NORMAL + 1) * lanes + k]
        nz = rays[(NORMAL + 2) * lanes + k]
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        flip, _ = viewer_side(nx, ny, nz, dx, dy, dz, f32(1e-30))
        t = rays[FAR * lanes + k] + starts[k]
        # Shadow rays start 2 mm in front of the surface.
        x = eye[0] + t * dx + f32(2e-3) * (nx * flip)
        y = eye[1] + t * dy + f32(2e-3) * (ny * flip)
        z = eye[2] + t * dz + f32(2e-3) * (nz * flip)
        fill_ray(
            shadow_rays, shadow_bits, lanes, k,
            x, y, z, lamp[0] - x, lamp[1] - y, lamp[2] - z, f32(1.0),
        )  # fmt: skip
    call_occluded(
        lanes,
        shadow_rays.ctypes.data + 4 * VALID,
        packets.scene,
        shadow_rays.ctypes.data,
        packets.arguments.ctypes.data,
    )


@njit(inline="always", error_model="numpy")
def _find_footprint(
    k, i, face, texture, directions, pixel, rays, lanes, starts, scene, texels, taps, samples
):
    """Compute and prefetch the texture footprint of the hit in lane `k`.

    Args:
        k: lane.
        i: ray.
        face: triangle that it hit.
        texture: texture of the triangle.
        directions: (N, 3) of all rays.
        pixel: (2, 3), see `render_rays`.
        rays: the packet.
        lanes: rays per packet.
        starts: (16,) ray parameters of the origins.
        scene: the scene.
        texels: address of the texels.
        taps: (16,) number of taps, written.
        samples: (16, 5) texture coordinates, mip level and the footprint's side, written.
    """
    dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
    t = rays[FAR * lanes + k] + starts[k]
    # Where the neighbouring pixels' rays meet this plane: exact ray differentials.
    nx = rays[NORMAL * lanes + k]
    ny = rays[(NORMAL + 1) * lanes + k]
    nz = rays[(NORMAL + 2) * lanes + k]
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
    u = rays[HIT_U * lanes + k]
    v = rays[HIT_V * lanes + k]
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
    taps[k] = count
    samples[k, 0] = sample_u
    samples[k, 1] = sample_v
    samples[k, 2] = lod
    samples[k, 3] = step_u
    samples[k, 4] = step_v
