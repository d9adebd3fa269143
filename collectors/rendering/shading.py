"""Hits to colours in linear light: texture filtering, room light, and the kernels that use them.

All of it is one file on purpose. The helpers are inlined into the kernels (passing arrays between
compiled functions counts references atomically, which costs more than a texture look-up), and
numba's cache notices changes only in a kernel's own file.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .cube_grid import CubeGrid
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
    PacketHits,
    call_intersect,
    call_occluded,
    prefetch,
)
from .textures import TexturePack

f32 = np.float32
F32 = NDArray[np.float32]


# Everything but assuming that there are no infinities and NaNs.
FAST = {"contract", "arcp", "nsz", "reassoc"}
# Sines of the elevations between which the dark of a hole turns into sky.
HORIZON_FROM, HORIZON_TO = f32(0.05), f32(0.3)
MAX_TAPS = f32(6.0)
EXPONENT_BIAS = np.int32(127 << 23)
HALF_PER_OCTAVE = f32(0.5 / (1 << 23))
PER_SQUARE = f32(1.0 / 1023.0**2)  # texels hold 10-bit square roots
# Cosines of the angles off the lamp's axis within which it is full, and beyond which it is dark.
LAMP_CORE, LAMP_EDGE = 0.95, 0.5
LAMP_SOFT_M2 = 0.25  # a lamp is no point; nearby things are not burnt out
# The soft dark spot under a robot; see `contact_shadow`.
SPHERE_REACH_M = 0.8
SPHERE_STRENGTH = 3.0


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


@njit(inline="always", error_model="numpy")
def _square(texel: np.uint32, shift: int) -> np.float32:
    value = f32(np.int32((texel >> np.uint32(shift)) & np.uint32(1023)))
    return value * value


@njit(inline="always", error_model="numpy")
def bilinear(texels: NDArray[np.uint32], start, width, height, u, v):
    """Bilinear colour at (u, v) of one mip level, as three sums of squared 10-bit roots.

    Args:
        texels: all texels.
        start: index of the level's first texel.
        width: of the level [px], int32.
        height: of the level [px], int32.
        u: texture coordinate to the right, float32, repeating.
        v: texture coordinate upwards, float32, repeating.
    """
    x = (u - np.floor(u)) * f32(width) - f32(0.5)
    y = (f32(1.0) - (v - np.floor(v))) * f32(height) - f32(0.5)  # v points up, rows go down
    left = np.floor(x)
    top = np.floor(y)
    fx = x - left
    fy = y - top
    x0 = np.int32(left)
    y0 = np.int32(top)
    x1 = x0 + np.int32(1)
    y1 = y0 + np.int32(1)
    if x0 < 0:
        x0 += width
    if y0 < 0:
        y0 += height
    if x1 >= width:
        x1 -= width
    if y1 >= height:
        y1 -= height
    row0 = start + np.int64(y0) * width
    row1 = start + np.int64(y1) * width
    a = texels[np.uint64(row0 + x0)]
    b = texels[np.uint64(row0 + x1)]
    c = texels[np.uint64(row1 + x0)]
    d = texels[np.uint64(row1 + x1)]
    wd = fx * fy
    wb = fx - wd
    wc = fy - wd
    wa = f32(1.0) - fx - wc
    return (
        wa * _square(a, 0) + wb * _square(b, 0) + wc * _square(c, 0) + wd * _square(d, 0),
        wa * _square(a, 10) + wb * _square(b, 10) + wc * _square(c, 10) + wd * _square(d, 10),
        wa * _square(a, 20) + wb * _square(b, 20) + wc * _square(c, 20) + wd * _square(d, 20),
    )


@njit(inline="always", error_model="numpy")
def footprint(pack: TexturePack, texture, du_dx, dv_dx, du_dy, dv_dy):
    """How to filter a texture over a pixel's footprint.

    The footprint is the parallelogram of the two derivatives. Taps lie along its longer side, the
    mip level follows its shorter one (as graphics hardware does, after McCormack et al., "Feline",
    1999), so that floors seen at a flat angle stay sharp across and do not shimmer along.

    Args:
        pack: all textures.
        texture: index of the texture.
        du_dx: change of u per pixel to the right.
        dv_dx: change of v per pixel to the right.
        du_dy: change of u per pixel down.
        dv_dy: change of v per pixel down.

    Returns:
        Number of taps, mip level (with its fraction), and the longer side's change of u and v.
    """
    width = f32(pack.size_px[texture, 0, 0])
    height = f32(pack.size_px[texture, 0, 1])
    ax = du_dx * width
    bx = dv_dx * height
    ay = du_dy * width
    by = dv_dy * height
    step_u = du_dx
    step_v = dv_dx
    long_square = ax * ax + bx * bx
    short_square = ay * ay + by * by
    if short_square > long_square:
        step_u = du_dy
        step_v = dv_dy
        long_square, short_square = short_square, long_square
    taps = np.int32(1)
    lod = f32(0.0)
    if long_square > f32(1.0):
        # A sheared footprint is narrower than its shorter side: its area says how narrow.
        area = ax * by - ay * bx
        short_square = max(f32(1.0), min(short_square, area * area / long_square))
        ratio = np.sqrt(long_square / short_square)
        taps = np.int32(min(MAX_TAPS, max(f32(1.0), np.ceil(ratio - f32(0.5)))))
        per_tap = f32(1.0) / f32(taps)
        # log2 from the float's exponent and linearly between powers of two, as hardware does.
        bits = f32(max(short_square, long_square * per_tap * per_tap)).view(np.int32)
        lod = f32(bits - EXPONENT_BIAS) * HALF_PER_OCTAVE
        lod = min(lod, f32(pack.levels[texture] - 1))
    return taps, lod, step_u, step_v


@njit(inline="always", error_model="numpy")
def prefetch_texels(pack: TexturePack, texels, texture, lod, u, v):
    """Fetch the texels around (u, v), which are read soon; `texels` is their address."""
    level = np.int32(lod)
    for _ in range(2):
        width = pack.size_px[texture, level, 0]
        height = pack.size_px[texture, level, 1]
        x = np.int64((u - np.floor(u)) * f32(width) - f32(0.5))
        y = np.int64((f32(1.0) - (v - np.floor(v))) * f32(height) - f32(0.5))
        at = texels + np.int64(4) * (pack.offset[texture, level] + y * width + x)
        prefetch(np.uintp(at))
        prefetch(np.uintp(at + np.int64(4) * width))
        if lod <= f32(level):
            break
        level += np.int32(1)


@njit(inline="always", error_model="numpy")
def sample_texture(pack: TexturePack, texture, u, v, taps, lod, step_u, step_v):
    """Colour of a texture over a footprint: red, green, blue in linear light.

    Args:
        pack: all textures.
        texture: index of the texture.
        u: texture coordinate to the right, float32.
        v: texture coordinate upwards, float32.
        taps: from `footprint`, as are the next.
        lod: mip level.
        step_u: change of u along the footprint.
        step_v: change of v along the footprint.
    """
    level = np.int32(lod)
    fraction = lod - f32(level)
    red = green = blue = f32(0.0)
    share = f32(1.0) / f32(taps)
    step_u *= share
    step_v *= share
    first = f32(0.5) * (f32(taps) - f32(1.0))
    u -= first * step_u
    v -= first * step_v
    for _ in range(taps):
        r, g, b = bilinear(
            pack.texels,
            pack.offset[texture, level],
            pack.size_px[texture, level, 0],
            pack.size_px[texture, level, 1],
            u,
            v,
        )
        if fraction > f32(0.0):
            r1, g1, b1 = bilinear(
                pack.texels,
                pack.offset[texture, level + 1],
                pack.size_px[texture, level + 1, 0],
                pack.size_px[texture, level + 1, 1],
                u,
                v,
            )
            r += fraction * (r1 - r)
            g += fraction * (g1 - g)
            b += fraction * (b1 - b)
        red += r
        green += g
        blue += b
        u += step_u
        v += step_v
    share *= PER_SQUARE
    return red * share, green * share, blue * share


@njit(inline="always", error_model="numpy")
def cube_at(grid: CubeGrid, x, y, z, nx, ny, nz):
    """Value of a grid at a surface point with a unit normal, trilinear.

    Args:
        grid: traced grid.
        x: point [m], x.
        y: point [m], y.
        z: point [m], z.
        nx: normal on the viewer's side, x.
        ny: normal, y.
        nz: normal, z.
    """
    # Three quarters of a cell in front of the surface, so that cells behind it count little.
    off = f32(0.75)
    gx = (x - grid.lower_m[0]) * grid.per_m + off * nx
    gy = (y - grid.lower_m[1]) * grid.per_m + off * ny
    gz = (z - grid.lower_m[2]) * grid.per_m + off * nz
    gx = min(max(gx, f32(0.0)), f32(grid.cube.shape[2] - 1))
    gy = min(max(gy, f32(0.0)), f32(grid.cube.shape[1] - 1))
    gz = min(max(gz, f32(0.0)), f32(grid.cube.shape[0] - 1))
    x0 = np.int64(gx)
    y0 = np.int64(gy)
    z0 = np.int64(gz)
    fx = gx - f32(x0)
    fy = gy - f32(y0)
    fz = gz - f32(z0)
    x1 = min(x0 + 1, grid.cube.shape[2] - 1)
    y1 = min(y0 + 1, grid.cube.shape[1] - 1)
    z1 = min(z0 + 1, grid.cube.shape[0] - 1)
    result = f32(0.0)
    for axis in range(3):
        side = nx if axis == 0 else (ny if axis == 1 else nz)
        k = 2 * axis if side >= f32(0.0) else 2 * axis + 1
        low = (f32(1.0) - fy) * (
            (f32(1.0) - fx) * f32(grid.cube[z0, y0, x0, k]) + fx * f32(grid.cube[z0, y0, x1, k])
        ) + fy * (
            (f32(1.0) - fx) * f32(grid.cube[z0, y1, x0, k]) + fx * f32(grid.cube[z0, y1, x1, k])
        )
        high = (f32(1.0) - fy) * (
            (f32(1.0) - fx) * f32(grid.cube[z1, y0, x0, k]) + fx * f32(grid.cube[z1, y0, x1, k])
        ) + fy * (
            (f32(1.0) - fx) * f32(grid.cube[z1, y1, x0, k]) + fx * f32(grid.cube[z1, y1, x1, k])
        )
        result += side * side * (low + fz * (high - low))
    return result * grid.scale


@njit(inline="always", error_model="numpy")
def room_light(nx, ny, nz, cosine, light: F32):
    """Factor of the fixed room shading.

    Args:
        nx: unit normal on the viewer's side, x.
        ny: y.
        nz: z.
        cosine: between the normal and the direction to the viewer.
        light: `Light.parameters()`.
    """
    up = f32(0.5) + f32(0.5) * nz
    facing = nx * light[4] + ny * light[5] + nz * light[6]
    # Half-Lambert for the key: opposite walls differ, none falls into black.
    return (
        light[1]
        + (light[0] - light[1]) * up
        + light[2] * f32(0.5) * facing
        + light[3] * (cosine - f32(0.5))
    )


@njit(inline="always", error_model="numpy")
def incident(x, y, z, nx, ny, nz, cosine, corners, light: LightArrays, lamp_gain):
    """Factor by which light makes a surface's colour brighter or darker.

    Args:
        x: point [m], x.
        y: point [m], y.
        z: point [m], z.
        nx: unit normal on the viewer's side, x.
        ny: y.
        nz: z.
        cosine: between the normal and the direction to the viewer.
        corners: whether the fixed room light is darker in corners.
        light: the light.
        lamp_gain: 1 where the lamp reaches, 0 in its shadow.
    """
    if not light.relit:
        factor = room_light(nx, ny, nz, cosine, light.room)
        if corners:
            free = cube_at(light.grid, x, y, z, nx, ny, nz)
            factor *= f32(1.0) - light.room[13] * (f32(1.0) - free)
        return factor
    factor = cube_at(light.grid, x, y, z, nx, ny, nz)
    if light.lamp[6] > f32(0.0):
        lx, ly, lz = light.lamp[0] - x, light.lamp[1] - y, light.lamp[2] - z
        square = lx * lx + ly * ly + lz * lz
        near = f32(1.0) / np.sqrt(max(square, f32(1e-8)))
        facing = max((nx * lx + ny * ly + nz * lz) * near, f32(0.0))
        ahead = -(light.lamp[3] * lx + light.lamp[4] * ly + light.lamp[5] * lz) * near
        beam = (ahead - f32(LAMP_EDGE)) * f32(1.0 / (LAMP_CORE - LAMP_EDGE))
        beam = min(max(beam, f32(0.0)), f32(1.0))
        beam = beam * beam * (f32(3.0) - f32(2.0) * beam)
        factor += lamp_gain * light.lamp[6] * facing * beam / (square + f32(LAMP_SOFT_M2))
    return factor


@njit(inline="always", error_model="numpy")
def exposed(value, light: LightArrays):
    """Linear light as the camera records it: what panels and lamps overexpose keeps its shape."""
    if not light.relit:
        return value
    return f32(1.0) - np.exp(-value)


@njit(inline="always", error_model="numpy")
def hidden_share(spheres: F32, x, y, z, nx, ny, nz):
    """How much of the light on a surface point the spheres of a robot hide; see `contact_shadow`.

    Args:
        spheres: (S, 4) world centre and radius [m].
        x: point [m], x.
        y: point [m], y.
        z: point [m], z.
        nx: unit normal on the viewer's side, x.
        ny: y.
        nz: z.
    """
    hidden = f32(0.0)
    for s in range(spheres.shape[0]):
        ux, uy, uz = spheres[s, 0] - x, spheres[s, 1] - y, spheres[s, 2] - z
        square = ux * ux + uy * uy + uz * uz
        if square < f32(SPHERE_REACH_M * SPHERE_REACH_M):
            height = nx * ux + ny * uy + nz * uz
            if height > f32(0.0):
                radius = spheres[s, 3]
                square = max(square, radius * radius)
                fade = f32(1.0) - square * f32(1.0 / (SPHERE_REACH_M * SPHERE_REACH_M))
                hidden += fade * radius * radius * height / (square * np.sqrt(square))
    return hidden


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


@njit(cache=True, error_model="numpy", fastmath=FAST)
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


@njit(cache=True, error_model="numpy", fastmath=FAST)
def shade_robot(
    rays: NDArray[np.int64],
    directions: F32,
    eye: F32,
    hits: PacketHits,
    corner_normal: F32,
    rotation: F32,
    base_linear: F32,
    light: LightArrays,
    out: F32,
):
    """Write the colours of rays that hit one geom of the robot.

    Args:
        rays: (K,) indices of the rays that hit.
        directions: (N, 3) of all rays, world.
        eye: (3,) optical centre [m].
        hits: of the K rays.
        corner_normal: (F, 3, 3) unit normals at the triangles' corners, geom frame.
        rotation: (3, 3) geom to world.
        base_linear: (3,) colour in linear light.
        light: what lights it.
        out: (N, 3) linear light, written at `rays`.
    """
    local = np.empty(3, dtype=np.float32)
    for j in range(rays.shape[0]):
        face, i = hits.prim[j], rays[j]
        u, v, t = hits.u[j], hits.v[j], hits.depth[j]
        w = f32(1.0) - u - v
        for k in range(3):
            local[k] = (
                w * corner_normal[face, 0, k]
                + u * corner_normal[face, 1, k]
                + v * corner_normal[face, 2, k]
            )
        nx = rotation[0, 0] * local[0] + rotation[0, 1] * local[1] + rotation[0, 2] * local[2]
        ny = rotation[1, 0] * local[0] + rotation[1, 1] * local[1] + rotation[1, 2] * local[2]
        nz = rotation[2, 0] * local[0] + rotation[2, 1] * local[1] + rotation[2, 2] * local[2]
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        along = nx * dx + ny * dy + nz * dz
        scale = f32(1.0) / np.sqrt(max(nx * nx + ny * ny + nz * nz, f32(1e-12)))
        if along > f32(0.0):
            scale = -scale
        cosine = np.abs(along * scale) / np.sqrt(dx * dx + dy * dy + dz * dz)
        factor = incident(
            eye[0] + t * dx,
            eye[1] + t * dy,
            eye[2] + t * dz,
            nx * scale,
            ny * scale,
            nz * scale,
            cosine,
            False,
            light,
            f32(1.0),
        )
        for k in range(3):
            out[i, k] = exposed(base_linear[k] * factor, light)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def light_pixels(
    rgb: NDArray[np.uint8],
    depth: F32,
    state: NDArray[np.uint8],
    width: int,
    height: int,
    directions: F32,
    eye: F32,
    decode: F32,
    light: LightArrays,
    lamp_gain: F32,
    spheres: F32,
    out: F32,
):
    """Light a picture of the surfaces' own colours.

    The normal of a pixel is that of the plane through it and its nearer neighbours, one in its row
    and one in its column: on a flat surface exact, and at an edge that of the pixel's own side.

    Args:
        rgb: (N, 3) sRGB of the surfaces.
        depth: (N,) planar depth [m], 0 = nothing.
        state: (N,) 0 nothing, 1 shown as it is, 2 lit, 3 the robot.
        width: image width [px].
        height: image height [px].
        directions: (N, 3), world, of unit length along the optical axis.
        eye: (3,) optical centre [m].
        decode: (256,) linear light of each byte.
        light: what lights it.
        lamp_gain: (N,) 0 in the lamp's shadow, or (0,): no shadow.
        spheres: (S, 4) of the robot, which darken what is near them.
        out: (N, 3) linear light, written.
    """
    for i in range(depth.shape[0]):
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        if state[i] == 0:
            rise = dz / np.sqrt(dx * dx + dy * dy + dz * dz)
            up = (rise - HORIZON_FROM) / (HORIZON_TO - HORIZON_FROM)
            up = min(max(up, f32(0.0)), f32(1.0))
            for c in range(3):
                below = light.room[10 + c]
                out[i, c] = below + up * (light.room[7 + c] - below)
            continue
        red, green, blue = decode[rgb[i, 0]], decode[rgb[i, 1]], decode[rgb[i, 2]]
        if state[i] > 1 or spheres.shape[0] > 0:
            row = i // width
            column = i - row * width
            t = depth[i]
            a = i - 1 if column > 0 else i + 1
            if 0 < column < width - 1 and abs(depth[i + 1] - t) < abs(depth[a] - t):
                a = i + 1
            b = i - width if row > 0 else i + width
            if 0 < row < height - 1 and abs(depth[i + width] - t) < abs(depth[b] - t):
                b = i + width
            ax = depth[a] * directions[a, 0] - t * dx
            ay = depth[a] * directions[a, 1] - t * dy
            az = depth[a] * directions[a, 2] - t * dz
            bx = depth[b] * directions[b, 0] - t * dx
            by = depth[b] * directions[b, 1] - t * dy
            bz = depth[b] * directions[b, 2] - t * dz
            nx = ay * bz - az * by
            ny = az * bx - ax * bz
            nz = ax * by - ay * bx
            along = nx * dx + ny * dy + nz * dz
            flip = f32(1.0) / np.sqrt(max(nx * nx + ny * ny + nz * nz, f32(1e-30)))
            if along > f32(0.0):
                flip = -flip
            cosine = np.abs(along * flip) / np.sqrt(dx * dx + dy * dy + dz * dz)
            nx *= flip
            ny *= flip
            nz *= flip
            x, y, z = eye[0] + t * dx, eye[1] + t * dy, eye[2] + t * dz
            if state[i] > 1:
                gain = lamp_gain[i] if lamp_gain.shape[0] > 0 else f32(1.0)
                factor = incident(x, y, z, nx, ny, nz, cosine, state[i] == 2, light, gain)
                red = exposed(red * factor, light)
                green = exposed(green * factor, light)
                blue = exposed(blue * factor, light)
            if state[i] != 3 and spheres.shape[0] > 0:
                hidden = hidden_share(spheres, x, y, z, nx, ny, nz)
                if hidden > f32(0.0):
                    factor = np.exp(-f32(SPHERE_STRENGTH) * hidden)
                    red *= factor
                    green *= factor
                    blue *= factor
        out[i, 0] = red
        out[i, 1] = green
        out[i, 2] = blue
