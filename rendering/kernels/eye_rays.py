"""The kernel that traces rays from the eye and shades the scene's surfaces that they hit.

Each packet of rays passes through five steps: trace, colours known already, shadow rays to the
lamp, texture footprints, shading. Footprints apart from shading take less time than both at once,
since the processor guesses the number of taps less often. Steps and helpers are inlined.
"""

import numpy as np

from ...formats.core.arrays import F32, I32
from ...formats.process.kernel import inlined, kernel
from ...geometry.rays.library import call_intersect, call_occluded
from ...geometry.rays.packets import FAR, GEOM, HIT_U, HIT_V, NORMAL, PRIM, VALID, fill_ray
from .data import FAST, UNCOUNTED, Hits, LightArrays, Packets, SceneArrays
from .surface_light import background, exposed, incident, robot_shadow, viewer_side
from .texture_sampling import footprint, prefetch_texels, sample_texture

f32 = np.float32


@kernel(3, error_model="numpy", fastmath=FAST, **UNCOUNTED)
def render_rays(
    order: I32,
    directions: F32,
    pixel: F32,
    eye: F32,
    cut_above_m: float,
    packets: Packets,
    scene: SceneArrays,
    light: LightArrays,
    spheres: F32,
    reach: F32,
    near: I32,
    seen: Hits,
    hits: Hits,
):
    """Trace rays from the eye and shade the surfaces of the scene that they hit.

    Args:
        order: (P · lanes,) rays of each packet, −1 = an idle lane.
        directions: (N, 3), world, of unit length along the optical axis.
        pixel: (2, 3) change of a direction per sample to the right and down: the footprint.
        eye: (3,) optical centre [m].
        cut_above_m: rays start where they pass this world z.
        spheres: (S, 4) centre and radius [m] of the robot's spheres, which darken nearby surfaces.
        reach: (2, 3) bounds of what they darken [m].
        near: (N,) the ray of `seen` next to each ray, or (0,).
        seen: of rays traced before. A ray that hits the same triangle as that next to it gets its
            colour, without being shaded.
        hits: of the N rays, written.
    """
    count, rays = packets.size, packets.rays
    lit_apart = light.relit and light.lamp_apart and light.lamp[6] > f32(0.0)
    texels = scene.pack.texels.ctypes.data
    for first in range(0, order.shape[0], count):
        _fill_packet(packets, order, first, directions, eye, cut_above_m)
        call_intersect(
            count,
            rays.ctypes.data + 4 * VALID,
            packets.scene,
            rays.ctypes.data,
            packets.arguments.ctypes.data,
        )
        for k in range(count):
            packets.reused[k] = _seen_before(packets, k, order[first + k], near, seen)
        if lit_apart:
            _trace_lamp(packets, order, first, directions, eye, light.lamp)
        for k in range(count):
            i = order[first + k]
            if i >= 0 and packets.bits[GEOM * count + k] != -1 and packets.reused[k] < 0:
                _find_footprint(packets, k, i, directions, pixel, scene, texels)
        for k in range(count):
            i = order[first + k]
            if i < 0:
                continue
            if packets.bits[GEOM * count + k] == -1:
                hits.depth[i] = f32(np.inf)
                hits.surface[i] = -1
                hits.prim[i] = -1
                dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
                red, green, blue = background(dx, dy, dz, light.room)
            elif packets.reused[k] >= 0:
                _locate(packets, k, i, scene, hits)
                j = packets.reused[k]
                red, green, blue = seen.color[j, 0], seen.color[j, 1], seen.color[j, 2]
            else:
                gain = f32(1.0)
                if lit_apart and packets.shadow_rays[FAR * count + k] < f32(0.0):
                    gain = f32(0.0)
                red, green, blue = _shade(
                    packets, k, i, directions, eye, scene, texels, light, gain, spheres, reach, hits
                )
            hits.color[i, 0] = red
            hits.color[i, 1] = green
            hits.color[i, 2] = blue


@inlined(error_model="numpy", fastmath=FAST)
def _fill_packet(packets, order, first, directions, eye, cut_above_m):
    """Write the rays `order[first : first + size]` into the packet."""
    for k in range(packets.size):
        i = max(order[first + k], 0)
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        start = f32(0.0)
        if eye[2] > cut_above_m:  # if a ray never passes the cut, it starts far away
            start = f32(cut_above_m - eye[2]) / min(dz, f32(-1e-6))
        packets.starts[k] = start
        fill_ray(
            packets.rays, packets.bits, packets.size, k,
            eye[0] + start * dx, eye[1] + start * dy, eye[2] + start * dz,
            dx, dy, dz, f32(np.inf),
        )  # fmt: skip
        packets.bits[GEOM * packets.size + k] = -1
        if order[first + k] < 0:
            packets.bits[VALID + k] = 0


@inlined(error_model="numpy", fastmath=FAST)
def _normal_at(packets, k):
    """Return the normal that Embree gave for the hit in lane `k`, of any length and side."""
    return (
        packets.rays[NORMAL * packets.size + k],
        packets.rays[(NORMAL + 1) * packets.size + k],
        packets.rays[(NORMAL + 2) * packets.size + k],
    )


@inlined(error_model="numpy", fastmath=FAST)
def _seen_before(packets, k, i, near, seen):
    """Return the ray next to ray `i` in lane `k` if both hit the same triangle, else −1."""
    if near.shape[0] > 0 and i >= 0:
        reused = near[i]
        # A robot in front of the triangle has a surface below −1.
        if seen.prim[reused] == packets.bits[PRIM * packets.size + k] and seen.surface[reused] >= 0:
            return reused
    return np.int32(-1)


@inlined(error_model="numpy", fastmath=FAST)
def _locate(packets, k, i, scene, hits):
    """Write what the hit of ray `i` in lane `k` is to `hits`; return its depth and material."""
    face = packets.bits[PRIM * packets.size + k]
    material = np.int32(scene.face[np.uint64(face), 12])
    t = packets.rays[FAR * packets.size + k] + packets.starts[k]
    hits.depth[i] = t
    hits.surface[i] = material
    hits.prim[i] = face
    return t, material


@inlined(error_model="numpy", fastmath=FAST)
def _trace_lamp(packets, order, first, directions, eye, lamp):
    """Trace shadow rays from a packet's hits to the lamp; `FAR` of occluded ones becomes −inf."""
    shadow_rays, shadow_bits = packets.shadow_rays, packets.shadow_bits
    for k in range(packets.size):
        shadow_bits[VALID + k] = 0
        i = order[first + k]
        if i < 0 or packets.bits[GEOM * packets.size + k] == -1 or packets.reused[k] >= 0:
            continue
        nx, ny, nz = _normal_at(packets, k)
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        flip, _ = viewer_side(nx, ny, nz, dx, dy, dz, f32(1e-30))
        t = packets.rays[FAR * packets.size + k] + packets.starts[k]
        # Shadow rays start 2 mm in front of the surface.
        x = eye[0] + t * dx + f32(2e-3) * (nx * flip)
        y = eye[1] + t * dy + f32(2e-3) * (ny * flip)
        z = eye[2] + t * dz + f32(2e-3) * (nz * flip)
        fill_ray(
            shadow_rays, shadow_bits, packets.size, k,
            x, y, z, lamp[0] - x, lamp[1] - y, lamp[2] - z, f32(1.0),
        )  # fmt: skip
    call_occluded(
        packets.size,
        shadow_rays.ctypes.data + 4 * VALID,
        packets.scene,
        shadow_rays.ctypes.data,
        packets.arguments.ctypes.data,
    )


@inlined(error_model="numpy", fastmath=FAST)
def _find_footprint(packets, k, i, directions, pixel, scene, texels):
    """Compute the texture footprint of the hit of ray `i` in lane `k`, if any.

    Args:
        packets: the packet; its `taps` and `samples` are written.
        k: lane.
        i: ray.
        directions: (N, 3) of all rays.
        pixel: (2, 3), see `render_rays`.
    """
    face = np.uint64(packets.bits[PRIM * packets.size + k])
    texture = scene.texture[np.uint64(np.int32(scene.face[face, 12]))]
    if texture >= 0:
        texture = np.uint64(texture)
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        t = packets.rays[FAR * packets.size + k] + packets.starts[k]
        # Where the neighbouring pixels' rays meet this plane: exact ray differentials.
        nx, ny, nz = _normal_at(packets, k)
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
        u = packets.rays[HIT_U * packets.size + k]
        v = packets.rays[HIT_V * packets.size + k]
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
        packets.taps[k] = count
        packets.samples[k, 0] = sample_u
        packets.samples[k, 1] = sample_v
        packets.samples[k, 2] = lod
        packets.samples[k, 3] = step_u
        packets.samples[k, 4] = step_v
        prefetch_texels(scene.pack, texels, texture, sample_u, sample_v, count, lod, step_u, step_v)


@inlined(error_model="numpy", fastmath=FAST)
def _shade(packets, k, i, directions, eye, scene, texels, light, gain, spheres, reach, hits):
    """Shade the hit of ray `i` in lane `k`, and return red, green and blue in linear light.

    Args:
        k: lane.
        i: ray.
        directions: (N, 3) of all rays.
        eye: (3,) optical centre [m].
        texels: address of the texels.
        gain: 1 where the lamp reaches, 0 in its shadow.
        spheres: (S, 4), see `render_rays`.
        reach: (2, 3) bounds of what they darken [m].
        hits: depth, surface and triangle of the ray are written.
    """
    dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
    t, material = _locate(packets, k, i, scene, hits)
    nx, ny, nz = _normal_at(packets, k)
    square = nx * nx + ny * ny + nz * nz
    flip, cosine = viewer_side(nx, ny, nz, dx, dy, dz, f32(1e-30))
    nx, ny, nz = nx * flip, ny * flip, nz * flip
    red = scene.base_linear[material, 0]
    green = scene.base_linear[material, 1]
    blue = scene.base_linear[material, 2]
    texture = scene.texture[material]
    if texture >= 0:
        u, v, lod = packets.samples[k, 0], packets.samples[k, 1], packets.samples[k, 2]
        step_u, step_v = packets.samples[k, 3], packets.samples[k, 4]
        taps = packets.taps[k]
        r, g, b = sample_texture(scene.pack, texels, texture, u, v, taps, lod, step_u, step_v)
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
