"""Shade surfaces whose hits are given: those of a robot, and pictures that OpenGL rendered."""

import numpy as np

from ...formats.core.arrays import F32, I64, U8
from ...formats.process.kernel import inlined, kernel
from ...geometry.rays.packets import PacketHits
from .data import FAST, UNCOUNTED, LightArrays
from .surface_light import background, exposed, incident, robot_shadow, viewer_side

f32 = np.float32


@kernel(3, error_model="numpy", fastmath=FAST, **UNCOUNTED)
def shade_robot(
    rays: I64,
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
        out: (N, 3) linear light, written at `rays`.
    """
    for j in range(rays.shape[0]):
        face, i = hits.prim[j], rays[j]
        u, v, t = hits.u[j], hits.v[j], hits.depth[j]
        w = f32(1.0) - u - v
        lx, ly, lz = _between(corner_normal, face, w, u, v)
        nx = rotation[0, 0] * lx + rotation[0, 1] * ly + rotation[0, 2] * lz
        ny = rotation[1, 0] * lx + rotation[1, 1] * ly + rotation[1, 2] * lz
        nz = rotation[2, 0] * lx + rotation[2, 1] * ly + rotation[2, 2] * lz
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        scale, cosine = viewer_side(nx, ny, nz, dx, dy, dz, f32(1e-12))
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


@inlined(error_model="numpy", fastmath=FAST)
def _between(corner: F32, face, w, u, v):
    """Return the mean of a triangle's three corner vectors with weights `w`, `u`, `v`."""
    return (
        w * corner[face, 0, 0] + u * corner[face, 1, 0] + v * corner[face, 2, 0],
        w * corner[face, 0, 1] + u * corner[face, 1, 1] + v * corner[face, 2, 1],
        w * corner[face, 0, 2] + u * corner[face, 1, 2] + v * corner[face, 2, 2],
    )


@kernel(3, error_model="numpy", fastmath=FAST, **UNCOUNTED)
def light_pixels(
    rgb: U8,
    depth: F32,
    state: U8,
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
    and one in its column, which is exact on a flat surface and one-sided at an edge.

    Args:
        rgb: (N, 3) sRGB of the surfaces.
        depth: (N,) planar depth [m], 0 = nothing.
        state: (N,) 0 nothing, 1 not lit, 2 lit, 3 the robot.
        width: image width [px].
        height: image height [px].
        directions: (N, 3), world, of unit length along the optical axis.
        eye: (3,) optical centre [m].
        decode: (256,) linear light of each byte.
        lamp_gain: (N,) 0 in the lamp's shadow, or (0,): no shadow.
        spheres: (S, 4) of the robot, which darken what is near them.
        out: (N, 3) linear light, written.
    """
    for i in range(depth.shape[0]):
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        if state[i] == 0:
            out[i, 0], out[i, 1], out[i, 2] = background(dx, dy, dz, light.room)
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
            flip, cosine = viewer_side(nx, ny, nz, dx, dy, dz, f32(1e-30))
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
                factor = robot_shadow(spheres, x, y, z, nx, ny, nz)
                red *= factor
                green *= factor
                blue *= factor
        out[i, 0] = red
        out[i, 1] = green
        out[i, 2] = blue
