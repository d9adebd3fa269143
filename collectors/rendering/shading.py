"""Hits to colours in linear light."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .openness import OpennessGrid, openness_at
from .sampling import sample_texture
from .textures import TexturePack

f32 = np.float32
F32 = NDArray[np.float32]


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


@njit(cache=True, error_model="numpy")
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
            out[i, 0], out[i, 1], out[i, 2] = light[7], light[8], light[9]
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
            factor *= f32(1.0) - light[10] * (f32(1.0) - free)
            red *= factor
            green *= factor
            blue *= factor
        out[i, 0] = scene.base_linear[material, 0] * red
        out[i, 1] = scene.base_linear[material, 1] * green
        out[i, 2] = scene.base_linear[material, 2] * blue


@njit(cache=True, error_model="numpy")
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
