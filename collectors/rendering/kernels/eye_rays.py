"""The kernel that traces rays from the eye and shades what of the scene they hit.

Helpers are inlined from other files: passing arrays between compiled functions counts references
atomically, which costs more than a texture look-up.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ....formats.core.kernel import kernel
from .data import F32, FAST, LightArrays, Packets, SceneArrays
from .packets import (
    DIRECTION,
    FAR,
    GEOM,
    HIT_U,
    HIT_V,
    MASK,
    NEAR,
    NORMAL,
    ORIGIN,
    PACKET_ROWS,
    PRIM,
    RAY_FLAGS,
    TIME,
    call_intersect,
    call_occluded,
    prefetch,
)
from .shadow_rays import fill_shadow_ray
from .surface_light import (
    HORIZON_FROM,
    HORIZON_TO,
    SPHERE_REACH_M,
    SPHERE_STRENGTH,
    exposed,
    hidden_share,
    incident,
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
    """Trace rays from the eye and shade what of the scene they hit.

    Args:
        order: (P · lanes,) rays of each packet, −1 = an idle lane.
        directions: (N, 3), world, of unit length along the optical axis.
        pixel: (2, 3) change of a direction per sample to the right and down: the footprint.
        eye: (3,) optical centre [m].
        cut_above_m: rays start where they pass this world z.
        packets: how to trace.
        scene: what there is.
        light: what lights it.
        spheres: (S, 4) of the robot, which darken what is near them.
        color: (N, 3) linear light, written.
        depth: (N,) planar depth [m], written; inf = nothing.
        surface: (N,) material, written; −1 = nothing.
        prim: (N,) triangle, written; −1 = nothing.
    """
    lanes = packets.lanes
    rays = packets.rays
    bits = rays.view(np.int32)
    valid = PACKET_ROWS * 16
    lit_apart = light.relit and light.lamp_apart and light.lamp[6] > f32(0.0)
    starts = np.zeros(16, dtype=np.float32)
    materials = np.zeros(16, dtype=np.int32)
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
        for k in range(lanes):
            i = order[first + k]
            bits[valid + k] = -1 if i >= 0 else 0
            i = max(i, 0)
            dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
            start = f32(0.0)
            if eye[2] > cut_above_m:  # if a ray never passes the cut, it starts far away
                start = f32(cut_above_m - eye[2]) / min(dz, f32(-1e-6))
            starts[k] = start
            rays[ORIGIN * lanes + k] = eye[0] + start * dx
            rays[(ORIGIN + 1) * lanes + k] = eye[1] + start * dy
            rays[(ORIGIN + 2) * lanes + k] = eye[2] + start * dz
            rays[DIRECTION * lanes + k] = dx
            rays[(DIRECTION + 1) * lanes + k] = dy
            rays[(DIRECTION + 2) * lanes + k] = dz
            rays[NEAR * lanes + k] = f32(0.0)
            rays[TIME * lanes + k] = f32(0.0)
            rays[FAR * lanes + k] = f32(np.inf)
            bits[MASK * lanes + k] = -1
            bits[RAY_FLAGS * lanes + k] = 0
            bits[GEOM * lanes + k] = -1
        call_intersect(
            lanes,
            rays.ctypes.data + 4 * valid,
            packets.scene,
            rays.ctypes.data,
            packets.arguments.ctypes.data,
        )
        for k in range(lanes):
            if bits[GEOM * lanes + k] != -1:
                prefetch(np.uintp(records + np.int64(64) * np.int64(bits[PRIM * lanes + k])))
        if lit_apart:
            for k in range(lanes):
                packets.shadow_rays.view(np.int32)[valid + k] = 0
                i = order[first + k]
                if i < 0 or bits[GEOM * lanes + k] == -1:
                    continue
                nx = rays[NORMAL * lanes + k]
                ny = rays[(NORMAL + 1) * lanes + k]
                nz = rays[(NORMAL + 2) * lanes + k]
                dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
                flip = f32(1.0) / np.sqrt(max(nx * nx + ny * ny + nz * nz, f32(1e-30)))
                if nx * dx + ny * dy + nz * dz > f32(0.0):
                    flip = -flip
                t = rays[FAR * lanes + k] + starts[k]
                fill_shadow_ray(
                    packets,
                    k,
                    eye[0] + t * dx,
                    eye[1] + t * dy,
                    eye[2] + t * dz,
                    nx * flip,
                    ny * flip,
                    nz * flip,
                    light.lamp,
                )
            call_occluded(
                lanes,
                packets.shadow_rays.ctypes.data + 4 * valid,
                packets.scene,
                packets.shadow_rays.ctypes.data,
                packets.arguments.ctypes.data,
            )
        for k in range(lanes):
            i = order[first + k]
            if i < 0 or bits[GEOM * lanes + k] == -1:
                continue
            face = np.uint64(bits[PRIM * lanes + k])
            material = np.int32(scene.face[face, 12])
            materials[k] = material
            texture = scene.texture[np.uint64(material)]
            if texture >= 0:
                texture = np.uint64(texture)
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
        for k in range(lanes):
            i = order[first + k]
            if i < 0:
                continue
            dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
            if bits[GEOM * lanes + k] == -1:
                depth[i] = f32(np.inf)
                surface[i] = -1
                prim[i] = -1
                rise = dz / np.sqrt(dx * dx + dy * dy + dz * dz)
                up = (rise - HORIZON_FROM) / (HORIZON_TO - HORIZON_FROM)
                up = min(max(up, f32(0.0)), f32(1.0))
                for c in range(3):
                    below = light.room[10 + c]
                    color[i, c] = below + up * (light.room[7 + c] - below)
                continue
            face = bits[PRIM * lanes + k]
            t = rays[FAR * lanes + k] + starts[k]
            nx = rays[NORMAL * lanes + k]
            ny = rays[(NORMAL + 1) * lanes + k]
            nz = rays[(NORMAL + 2) * lanes + k]
            material = materials[k]
            depth[i] = t
            surface[i] = material
            prim[i] = face
            square = nx * nx + ny * ny + nz * nz
            along = nx * dx + ny * dy + nz * dz
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
            flip = f32(1.0) / np.sqrt(max(square, f32(1e-30)))
            if along > f32(0.0):
                flip = -flip
            if scene.shaded[material] and square > f32(0.0):
                cosine = np.abs(along * flip) / np.sqrt(dx * dx + dy * dy + dz * dz)
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
                hidden = hidden_share(spheres, x, y, z, nx * flip, ny * flip, nz * flip)
                if hidden > f32(0.0):
                    factor = np.exp(-f32(SPHERE_STRENGTH) * hidden)
                    red *= factor
                    green *= factor
                    blue *= factor
            color[i, 0] = red
            color[i, 1] = green
            color[i, 2] = blue
