"""Place Gaussians on the exact surfaces: a splat capture in closed form, without training.

A grid in the plane of each triangle gives the centres; only what a station of the scanner sees gets
a Gaussian, so that the floor is missing beneath furniture as in a real capture.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ...formats.core.arrays import F32, I64, Array, Floats
from ...formats.core.frames import matrix_to_quat
from ...formats.core.geometry import triangle_areas, triangle_normals
from ...formats.process.kernel import kernel
from ...formats.splats.harmonics import C0
from ...formats.splats.record import GaussianCloud
from ..building.true_scene import TrueScene
from ..config import ScanConfig
from .appearance import Appearance
from .light import Lighting, exposed, tangents
from .stations import stations
from .tracing import Tracer

# Standard deviation in the plane, in grid spacings: neighbours overlap to an opaque surface.
SPREAD = 0.7
THICKNESS_M, SCATTER_M, JITTER = 0.0025, 0.003, 0.15
OPACITY = (0.82, 0.98)
# Stations that are tested together for whether they see a place, nearest first; how far they see.
TESTED, SIGHT_M, LIFT_M = (4, 6, 10), 7.0, 0.012
# Light is computed at so many places and interpolated between those nearest to a Gaussian.
LIT_PLACES, LIT_NEAREST, LIGHT_RAYS = 30_000, 5, 24
# A metre of distance weighs as much as so much difference of the normals.
NORMAL_WEIGHT_M = 0.6
TRIAL_SPACING_M = 0.12


def place_splats(
    rng: np.random.Generator, scene: TrueScene, tracer: Tracer, config: ScanConfig, count: int
) -> GaussianCloud:
    """Return about `count` Gaussians on what the stations see of `scene`, world z up [m]."""
    eyes = np.concatenate(
        [stations(rng, plan, tracer, config.station_spacing_m) for plan in scene.storeys]
    )
    surface = Appearance.of(scene)
    panes = surface.emissive[scene.shape.material]
    corners = scene.shape.corners
    normals = triangle_normals(corners)
    usable = np.flatnonzero(triangle_areas(corners) > 1e-8)
    face, _, point = _on_grid(corners, normals, usable, TRIAL_SPACING_M)
    seen = seen_from(tracer, eyes, point, normals[face])
    area = max(int((seen != 0).sum()), 1) * TRIAL_SPACING_M**2
    spacing = float(np.sqrt(area / count))
    face, bary, point = _on_grid(corners, normals, usable, spacing)
    side = seen_from(tracer, eyes, point, normals[face])
    keep = side != 0
    face, bary, point, side = face[keep], bary[keep], point[keep], side[keep]
    normal = (normals[face] * side[:, None]).astype(np.float32)
    light = _light(rng, Lighting(rng, scene, tracer, surface), point, normal)
    light[panes[face]] = 1.0
    rgb = surface.color(face.astype(np.int32), bary).astype(np.float32) / 255
    rgb *= exposed(light)
    axes = _axes(normals)
    turn = matrix_to_quat(axes)[face].astype(np.float32)
    jitter = rng.normal(0, 1, point.shape) * (JITTER * spacing, JITTER * spacing, SCATTER_M)
    point = point + np.einsum("nij,nj->ni", axes[face], jitter)
    size = SPREAD * spacing * np.exp(rng.normal(0, 0.12, (len(point), 2)))
    return GaussianCloud(
        position=point.astype(np.float32),
        scale=np.c_[size, np.full(len(point), THICKNESS_M)].astype(np.float32),
        quat_wxyz=turn,
        opacity=rng.uniform(*OPACITY, len(point)).astype(np.float32),
        harmonics=((np.clip(rgb, 0, 1) - 0.5) / C0)[:, None].astype(np.float32),
    )


def seen_from(tracer: Tracer, eyes_m: Array, points_m: Floats, normals: Floats) -> NDArray[np.int8]:
    """Return (N,) 1 or −1: the side of the normal from which a station sees the point; 0 = none."""
    side = np.zeros(len(points_m), dtype=np.int8)
    tree = KDTree(eyes_m)
    done = 0
    for more in TESTED:
        count = min(done + more, len(eyes_m))
        rest = np.flatnonzero(side == 0)
        if count <= done or not len(rest):
            break
        # The stubs know only a number for k; a list returns these ranks alone.
        ranks: Any = list(range(done + 1, count + 1))
        nearest = np.asarray(tree.query(points_m[rest], k=ranks)[1])
        for column in range(nearest.shape[1]):
            open_ = side[rest] == 0
            index = rest[open_]
            toward = eyes_m[nearest[open_, column]] - points_m[index]
            distance = np.linalg.norm(toward, axis=1)
            facing = np.einsum("ij,ij->i", toward, normals[index]) / np.maximum(distance, 1e-9)
            fit = (distance < SIGHT_M) & (np.abs(facing) > 0.05)
            index, toward, distance, facing = index[fit], toward[fit], distance[fit], facing[fit]
            which = np.where(facing > 0, 1, -1)
            start = points_m[index] + LIFT_M * which[:, None] * normals[index]
            toward = eyes_m[nearest[open_, column]][fit] - start
            distance = np.linalg.norm(toward, axis=1)
            hidden = tracer.blocked(start, toward / distance[:, None], distance)
            side[index[~hidden]] = which[~hidden]
        done = count
    return side


def _light(rng: np.random.Generator, lighting: Lighting, points: Array, normals: F32) -> F32:
    """Return the light (N, 3) at points with unit normals: soft light interpolated, sun exact."""
    places = rng.choice(len(points), min(LIT_PLACES, len(points)), replace=False)
    at = points.astype(np.float32)
    soft = lighting.soft(rng, at[places], normals[places], LIGHT_RAYS)
    where = np.c_[points, NORMAL_WEIGHT_M * normals]
    tree = KDTree(where[places])
    distance, near = map(np.asarray, tree.query(where, k=min(LIT_NEAREST, len(places))))
    weight = 1 / (distance**2 + 1e-4)
    weight /= weight.sum(1, keepdims=True)
    light = np.einsum("nk,nki->ni", weight, soft[near]).astype(np.float32)
    return light + lighting.sun(at, normals).astype(np.float32)


def _axes(normals: Array) -> Array:
    """Return rotations (F, 3, 3) whose third column is the normal."""
    return np.stack([*tangents(normals), normals], axis=2).astype(np.float64)


def _on_grid(corners: Array, normals: Array, faces: I64, spacing: float) -> tuple[I64, F32, Array]:
    """Return the face, barycentric weights (N, 2) and place (N, 3) of grid points in triangles."""
    axes = _axes(normals[faces])
    flat = np.einsum("fki,fij->fkj", corners[faces], axes[:, :, :2])
    counts = np.zeros(len(faces), dtype=np.int64)
    _fill(flat, spacing, counts, np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    starts = np.cumsum(counts) - counts
    out = np.empty((int(counts.sum()), 3))
    _fill(flat, spacing, counts, starts, out)
    local = out[:, 0].astype(np.int64)
    bary = out[:, 1:].astype(np.float32)
    face = faces[local]
    a, b, c = corners[face].swapaxes(0, 1)
    place = a + out[:, 1:2] * (b - a) + out[:, 2:3] * (c - a)
    return face, bary, place


@kernel()
def _fill(flat, spacing, counts, starts, out):
    """Count the grid's points in each triangle, or write triangle and weights of each."""
    for f in range(flat.shape[0]):
        ax, ay = flat[f, 0, 0], flat[f, 0, 1]
        e1x, e1y = flat[f, 1, 0] - ax, flat[f, 1, 1] - ay
        e2x, e2y = flat[f, 2, 0] - ax, flat[f, 2, 1] - ay
        twice = e1x * e2y - e1y * e2x
        if abs(twice) < 1e-12:
            continue
        x0 = int(np.floor((ax + min(0.0, e1x, e2x)) / spacing))
        x1 = int(np.ceil((ax + max(0.0, e1x, e2x)) / spacing))
        y0 = int(np.floor((ay + min(0.0, e1y, e2y)) / spacing))
        y1 = int(np.ceil((ay + max(0.0, e1y, e2y)) / spacing))
        k = 0
        for y in range(y0, y1 + 1):
            # Every other row is shifted by half a cell: hexagons leave smaller gaps than squares.
            shift = 0.5 * (y % 2)
            for x in range(x0 - 1, x1 + 1):
                px, py = (x + 0.25 + shift) * spacing - ax, (y + 0.5) * spacing - ay
                b = (px * e2y - py * e2x) / twice
                c = (e1x * py - e1y * px) / twice
                if b >= 0.0 and c > 0.0 and b + c <= 1.0:
                    if out.shape[0] > 0:
                        out[starts[f] + k, 0] = f
                        out[starts[f] + k, 1] = b
                        out[starts[f] + k, 2] = c
                    k += 1
        counts[f] = k
