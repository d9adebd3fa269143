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

from .openness import OpennessGrid
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


class SceneArrays(NamedTuple):
    """The scene as kernels see it.

    Attributes:
        vertices, faces, corner_uv, face_material: the visual mesh.
        base_linear: (M, 3) base colours in linear light.
        texture: (M,) int32 index of the texture, −1 = none.
        shaded: (M,) bool: lit by the room light; otherwise shown as it is.
        pack: the textures.
        openness: darkens corners of what is lit by the room light.
    """

    vertices: F32
    faces: NDArray[np.int32]
    corner_uv: F32
    face_material: NDArray[np.int32]
    base_linear: F32
    texture: NDArray[np.int32]
    shaded: NDArray[np.bool_]
    pack: TexturePack
    openness: OpennessGrid


class Hits(NamedTuple):
    """What N rays met.

    Attributes:
        prim: (N,) int32 triangle, −1 = none.
        u, v: (N,) barycentric coordinates of the second and third corner.
        depth: (N,) ray parameter, which is planar depth [m].
    """

    prim: NDArray[np.int32]
    u: F32
    v: F32
    depth: F32


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
def sample_texture(pack: TexturePack, texture, u, v, du_dx, dv_dx, du_dy, dv_dy):
    """Colour of a texture over a pixel's footprint: red, green, blue in linear light.

    The footprint is the parallelogram of the two derivatives. Taps lie along its longer side, the
    mip level follows its shorter one (as graphics hardware does, after McCormack et al., "Feline",
    1999), so that floors seen at a flat angle stay sharp across and do not shimmer along.

    Args:
        pack: all textures.
        texture: index of the texture.
        u: texture coordinate to the right, float32.
        v: texture coordinate upwards, float32.
        du_dx: change of u per pixel to the right.
        dv_dx: change of v per pixel to the right.
        du_dy: change of u per pixel down.
        dv_dy: change of v per pixel down.
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
    level = np.int32(0)
    fraction = f32(0.0)
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
def openness_at(grid: OpennessGrid, x, y, z, nx, ny, nz):
    """Openness (0–1) at a surface point with a unit normal, trilinear.

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
    return result * f32(1.0 / 255.0)


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


@njit(cache=True, error_model="numpy", fastmath=FAST)
def shade_scene(directions: F32, pixel: F32, hits: Hits, scene: SceneArrays, light: F32, out: F32):
    """Colour of each ray's hit on the scene.

    Args:
        directions: (N, 3).
        pixel: (2, 3) change of a direction per sample to the right and down: the footprint.
        hits: of N rays.
        scene: what was hit.
        light: `Light.parameters()`.
        out: (N, 3) linear light, written.
    """
    for i in range(hits.prim.shape[0]):
        face = hits.prim[i]
        if face < 0:
            x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
            rise = z / np.sqrt(x * x + y * y + z * z)
            up = min(max((rise - HORIZON_FROM) / (HORIZON_TO - HORIZON_FROM), f32(0.0)), f32(1.0))
            for k in range(3):
                out[i, k] = light[10 + k] + up * (light[7 + k] - light[10 + k])
            continue
        material = scene.face_material[face]
        texture = scene.texture[material]
        a, b, c = scene.faces[face, 0], scene.faces[face, 1], scene.faces[face, 2]
        ax, ay, az = scene.vertices[a, 0], scene.vertices[a, 1], scene.vertices[a, 2]
        ex = scene.vertices[b, 0] - ax
        ey = scene.vertices[b, 1] - ay
        ez = scene.vertices[b, 2] - az
        gx = scene.vertices[c, 0] - ax
        gy = scene.vertices[c, 1] - ay
        gz = scene.vertices[c, 2] - az
        nx = ey * gz - ez * gy
        ny = ez * gx - ex * gz
        nz = ex * gy - ey * gx
        square = nx * nx + ny * ny + nz * nz
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        along = nx * dx + ny * dy + nz * dz
        red = green = blue = f32(1.0)
        if texture >= 0:
            # Where the neighbouring pixels' rays meet this plane: exact ray differentials, as
            # changes of the barycentrics u and v.
            t = hits.depth[i]
            scale = f32(0.0)
            if square > f32(0.0) and along != f32(0.0):
                scale = t / square
            else:
                along = f32(1.0)
            ux = (gy * nz - gz * ny) * scale
            uy = (gz * nx - gx * nz) * scale
            uz = (gx * ny - gy * nx) * scale
            vx = (ny * ez - nz * ey) * scale
            vy = (nz * ex - nx * ez) * scale
            vz = (nx * ey - ny * ex) * scale
            u_along = (ux * dx + uy * dy + uz * dz) / along
            v_along = (vx * dx + vy * dy + vz * dz) / along
            px, py, pz = pixel[0, 0], pixel[0, 1], pixel[0, 2]
            tilt = nx * px + ny * py + nz * pz
            u_right = ux * px + uy * py + uz * pz - tilt * u_along
            v_right = vx * px + vy * py + vz * pz - tilt * v_along
            px, py, pz = pixel[1, 0], pixel[1, 1], pixel[1, 2]
            tilt = nx * px + ny * py + nz * pz
            u_down = ux * px + uy * py + uz * pz - tilt * u_along
            v_down = vx * px + vy * py + vz * pz - tilt * v_along
            s0, t0 = scene.corner_uv[face, 0, 0], scene.corner_uv[face, 0, 1]
            s1, t1 = scene.corner_uv[face, 1, 0] - s0, scene.corner_uv[face, 1, 1] - t0
            s2, t2 = scene.corner_uv[face, 2, 0] - s0, scene.corner_uv[face, 2, 1] - t0
            u, v = hits.u[i], hits.v[i]
            red, green, blue = sample_texture(
                scene.pack,
                texture,
                s0 + u * s1 + v * s2,
                t0 + u * t1 + v * t2,
                u_right * s1 + v_right * s2,
                u_right * t1 + v_right * t2,
                u_down * s1 + v_down * s2,
                u_down * t1 + v_down * t2,
            )
        if scene.shaded[material] and square > f32(0.0):
            flip = f32(1.0) / np.sqrt(square)
            if along > f32(0.0):
                flip = -flip
            cosine = np.abs(along * flip) / np.sqrt(dx * dx + dy * dy + dz * dz)
            nx *= flip
            ny *= flip
            nz *= flip
            free = openness_at(
                scene.openness,
                ax + hits.u[i] * ex + hits.v[i] * gx,
                ay + hits.u[i] * ey + hits.v[i] * gy,
                az + hits.u[i] * ez + hits.v[i] * gz,
                nx,
                ny,
                nz,
            )
            factor = room_light(nx, ny, nz, cosine, light)
            factor *= f32(1.0) - light[13] * (f32(1.0) - free)
            red *= factor
            green *= factor
            blue *= factor
        out[i, 0] = scene.base_linear[material, 0] * red
        out[i, 1] = scene.base_linear[material, 1] * green
        out[i, 2] = scene.base_linear[material, 2] * blue


@njit(cache=True, error_model="numpy", fastmath=FAST)
def shade_robot(
    rays: NDArray[np.int64],
    directions: F32,
    hits: Hits,
    corner_normal: F32,
    rotation: F32,
    base_linear: F32,
    light: F32,
    out: F32,
):
    """Write the colours of rays that hit one geom of the robot.

    Args:
        rays: (K,) indices of the rays that hit.
        directions: (N, 3) of all rays, world.
        hits: of the K rays.
        corner_normal: (F, 3, 3) unit normals at the triangles' corners, geom frame.
        rotation: (3, 3) geom to world.
        base_linear: (3,) colour in linear light.
        light: `Light.parameters()`.
        out: (N, 3) linear light, written at `rays`.
    """
    local = np.empty(3, dtype=np.float32)
    for j in range(rays.shape[0]):
        face, i = hits.prim[j], rays[j]
        u, v = hits.u[j], hits.v[j]
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
        factor = room_light(nx * scale, ny * scale, nz * scale, cosine, light)
        for k in range(3):
            out[i, k] = base_linear[k] * factor
