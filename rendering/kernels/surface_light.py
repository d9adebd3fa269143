"""Light on a point of a surface: helpers that are inlined into kernels."""

import numpy as np

from ...formats.core.arrays import F32
from ...formats.process.kernel import inlined
from .cube_grid import CubeGrid
from .data import FAST, LightArrays
from .vectors import blend_cells

f32 = np.float32

# Sines of the elevations between which the background changes from dark to sky.
HORIZON_FROM, HORIZON_TO = f32(0.05), f32(0.3)
# Cosines of the angles off the lamp's axis: full strength within the first, none beyond the second.
LAMP_CORE, LAMP_EDGE = 0.95, 0.5
LAMP_SOFT_M2 = 0.25  # added to the squared distance, so that nearby surfaces are not overexposed
# The soft dark spot under a robot; see `contact_shadow`.
SPHERE_REACH_M = 0.8
SPHERE_STRENGTH = 6.0


@inlined(error_model="numpy", fastmath=FAST)
def cube_at(grid: CubeGrid, x, y, z, nx, ny, nz):
    """Return the trilinear value of a grid at a surface point with a unit normal.

    Args:
        x, y, z: point [m].
        nx, ny, nz: normal on the viewer's side.
    """
    # Three quarters of a cell in front of the surface, so that cells behind it count little.
    off = f32(0.75)
    gx = (x - grid.lower_m[0]) * grid.per_m + off * nx
    gy = (y - grid.lower_m[1]) * grid.per_m + off * ny
    gz = (z - grid.lower_m[2]) * grid.per_m + off * nz
    columns, rows, layers = grid.cube.shape[2], grid.cube.shape[1], grid.cube.shape[0]
    gx = min(max(gx, f32(0.0)), f32(columns - 1))
    gy = min(max(gy, f32(0.0)), f32(rows - 1))
    gz = min(max(gz, f32(0.0)), f32(layers - 1))
    x0 = min(np.int32(gx), np.int32(columns - 2))
    y0 = min(np.int32(gy), np.int32(rows - 2))
    z0 = min(np.int32(gz), np.int32(layers - 2))
    columns = np.int32(columns)
    layer = columns * np.int32(rows)
    cell = x0 + y0 * columns + z0 * layer
    total = blend_cells(
        grid.cube.ctypes.data,
        (cell, cell + columns, cell + layer, cell + columns + layer),
        (gx - f32(x0), gy - f32(y0), gz - f32(z0)),
        (nx, ny, nz),
    )
    return total * grid.scale


@inlined(error_model="numpy", fastmath=FAST)
def room_light(nx, ny, nz, cosine, light: F32):
    """Return the factor of the fixed room shading.

    Args:
        nx, ny, nz: unit normal on the viewer's side.
        cosine: between the normal and the direction to the viewer.
        light: `Light.parameters()`.
    """
    up = f32(0.5) + f32(0.5) * nz
    facing = nx * light[4] + ny * light[5] + nz * light[6]
    # Half-Lambert for the key light: opposite walls differ and none is black.
    return (
        light[1]
        + (light[0] - light[1]) * up
        + light[2] * f32(0.5) * facing
        + light[3] * (cosine - f32(0.5))
    )


@inlined(error_model="numpy", fastmath=FAST)
def incident(x, y, z, nx, ny, nz, cosine, corners, light: LightArrays, lamp_gain):
    """Return the factor by which the light scales a surface's colour.

    Args:
        x, y, z: point [m].
        nx, ny, nz: unit normal on the viewer's side.
        cosine: between the normal and the direction to the viewer.
        corners: whether the fixed room light is darker in corners.
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


@inlined(error_model="numpy", fastmath=FAST)
def exposed(value, light: LightArrays):
    """Return linear light as the camera records it: under panels and lamps with soft highlights."""
    if not light.relit:
        return value
    return f32(1.0) - np.exp(-value)


@inlined(error_model="numpy", fastmath=FAST)
def robot_shadow(spheres: F32, x, y, z, nx, ny, nz):
    """Return the factor by which a robot's spheres darken a surface point; see `contact_shadow`.

    Args:
        spheres: (S, 4) world centre and radius [m].
        x, y, z: point [m].
        nx, ny, nz: unit normal on the viewer's side.
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
    factor = f32(1.0)
    if hidden > f32(0.0):
        factor = np.exp(-f32(SPHERE_STRENGTH) * hidden)
    return factor


@inlined(error_model="numpy", fastmath=FAST)
def viewer_side(nx, ny, nz, dx, dy, dz, least):
    """Return what scales a normal to unit length on the viewer's side, and the viewing cosine.

    Args:
        nx, ny, nz: normal of any length and side.
        dx, dy, dz: direction of the view ray, of any length.
        least: squared length below which a normal counts as zero.
    """
    along = nx * dx + ny * dy + nz * dz
    flip = f32(1.0) / np.sqrt(max(nx * nx + ny * ny + nz * nz, least))
    if along > f32(0.0):
        flip = -flip
    cosine = np.abs(along * flip) / np.sqrt(dx * dx + dy * dy + dz * dz)
    return flip, cosine


@inlined(error_model="numpy", fastmath=FAST)
def background(dx, dy, dz, room: F32):
    """Return red, green and blue where a ray hits nothing; `room` is `Light.parameters()`."""
    rise = dz / np.sqrt(dx * dx + dy * dy + dz * dz)
    up = (rise - HORIZON_FROM) / (HORIZON_TO - HORIZON_FROM)
    up = min(max(up, f32(0.0)), f32(1.0))
    return (
        room[10] + up * (room[7] - room[10]),
        room[11] + up * (room[8] - room[11]),
        room[12] + up * (room[9] - room[12]),
    )
