"""Illumination: daylight from windows, ceiling lamps, sun and ambient reflection."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from ...formats.core.arrays import F32, Array, Floats
from ...formats.process.kernel import kernel
from ...formats.process.threads import beside
from ...geometry.rays.library import call_occluded, lanes
from ...geometry.rays.packets import FAR, VALID, fill_ray, packet
from ..building.true_scene import TrueScene
from .appearance import Appearance
from .tracing import Tracer

_LIFT_M = 0.03
_SKY = np.array([0.92, 0.98, 1.06], dtype=np.float32)
_LAMP = np.array([1.08, 0.98, 0.84], dtype=np.float32)
_SUN = np.array([1.0, 0.93, 0.8], dtype=np.float32)
_SUN_STRENGTH, _SUN_REACH_M = np.float32(1.5), np.float32(40.0)
# Shadow rays start this far before a surface, which must face the sun by this cosine at least.
_SUN_LIFT_M, _LEAST_SUN = np.float32(0.012), np.float32(0.02)
_WINDOW_SAMPLES, _NEAR_WINDOWS, _LAMP_SAMPLES, _NEAR_LAMPS = 4, 3, 3, 2


@dataclass(frozen=True)
class Lights:
    """The light sources of a building.

    Attributes:
        window_m: (W, 2, 3) lower and upper corner of each pane.
        window_normal: (W, 3) pointing into the room.
        lamp_m: (L, 3).
        sun: (3,) unit direction towards the sun.
    """

    window_m: Array
    window_normal: Array
    lamp_m: Array
    sun: Array

    @staticmethod
    def of(rng: np.random.Generator, scene: TrueScene) -> "Lights":
        """Collect the windows and lamps of `scene`, and place a sun in front of a window."""
        boxes, normals = [], []
        holes = [(p, o) for p in scene.storeys for o in p.openings if o.kind == "window"]
        for plan, o in holes:
            box = np.empty((2, 3))
            box[:, o.axis] = plan.rooms[o.room].wall_at(o.axis, o.sign) + o.sign * 0.13
            box[:, 1 - o.axis] = o.start_m, o.end_m
            box[:, 2] = o.bottom_m + plan.floor_z_m, o.top_m + plan.floor_z_m
            normal = np.zeros(3)
            normal[o.axis] = -o.sign
            boxes.append(box)
            normals.append(normal)
        outward = -normals[int(rng.integers(len(normals)))] if normals else np.array([1.0, 0, 0])
        azimuth = np.arctan2(outward[1], outward[0]) + rng.uniform(-0.7, 0.7)
        height = rng.uniform(0.5, 0.85)
        flat = np.array([np.cos(azimuth), np.sin(azimuth)]) * np.cos(height)
        boxes, normals = np.array(boxes).reshape(-1, 2, 3), np.array(normals).reshape(-1, 3)
        return Lights(boxes, normals, scene.lamps_m, np.append(flat, np.sin(height)))


def exposed(light: Floats) -> Floats:
    """Return what to multiply gamma-coded colours by in linear light (N, 3)."""
    return np.clip(light, 0.02, 2.2) ** np.float32(1 / 2.2)


class Lighting:
    """Irradiance at points of one building; 1 is a well-lit floor."""

    def __init__(
        self, rng: np.random.Generator, scene: TrueScene, tracer: Tracer, surface: Appearance
    ):
        panes = surface.emissive[scene.shape.material]
        # The sun shines through the panes.
        self._tracer, self._open = tracer, Tracer(scene.shape.corners[~panes])
        self._surface, self._lights = surface, Lights.of(rng, scene)

    def soft(
        self, rng: np.random.Generator, points_m: Floats, normals: Floats, rays: int
    ) -> Floats:
        """Return irradiance (N, 3) without direct sun at points (N, 3) with unit normals (N, 3)."""
        start = points_m + np.float32(_LIFT_M) * normals
        turn = rng.random(len(start), dtype=np.float32)
        with beside(partial(self._reflected, turn, start, normals, rays)) as reflected:
            windows, lamps = self._windows(rng, start, normals), self._lamps(rng, start, normals)
            return reflected() + windows + lamps

    def sun(self, points_m: Floats, normals: Floats) -> Floats:
        """Return irradiance (N, 3) of direct sun, with sharp shadows."""
        strength = np.empty(len(points_m), dtype=np.float32)
        scene, direction = self._open, self._lights.sun.astype(np.float32)
        _sunlit(
            scene.handle, scene.arguments, packet(), lanes(),
            np.ascontiguousarray(points_m, dtype=np.float32),
            np.ascontiguousarray(normals, dtype=np.float32), direction, strength,
        )  # fmt: skip
        return strength[:, None] * _SUN

    def _reflected(self, turn: F32, start: Floats, normals: Floats, rays: int) -> Floats:
        """Return ambient irradiance, occluded and tinted by near surfaces.

        Rays leave in the same pattern everywhere, turned by `turn` (N,) in 0…1.
        """
        total = np.zeros_like(start)
        across, along = tangents(normals)
        reach = 2.5
        for k in range(rays):
            # Cosine-weighted Fibonacci points, turned at random for each point.
            radius = np.float32(np.sqrt((k + 0.5) / rays))
            angle = 2 * np.pi * (turn + np.float32(k * 0.61803398875))
            x, y = radius * np.cos(angle), radius * np.sin(angle)
            direction = x[:, None] * across + y[:, None] * along + np.sqrt(1 - radius**2) * normals
            hits = self._tracer.first(start, direction, reach, coherent=False)
            near = hits.prim >= 0
            openness = np.where(near, 0.28 + 0.72 * hits.depth / reach, 1.0)
            material = self._surface.material[hits.prim]
            tint = np.where(near[:, None], 0.45 + 0.65 * self._surface.mean[material], 0.92)
            glow = near & self._surface.emissive[material]
            total += np.where(glow, 1.3, openness)[:, None] * tint
        return total * np.float32(0.62 / rays)

    def _windows(self, rng: np.random.Generator, start: Floats, normals: Floats) -> Floats:
        result = np.zeros_like(start)
        boxes, facing = self._lights.window_m, self._lights.window_normal
        if not len(boxes):
            return result
        middle = boxes.mean(1)
        away = start[:, None] - middle.astype(np.float32)
        gap = np.linalg.norm(away, axis=2)
        behind = np.einsum("nwi,wi->nw", away, facing.astype(np.float32)) < 0.02
        score = np.where(behind, 99.0, gap)
        count = min(_NEAR_WINDOWS, len(boxes))
        nearest = np.argsort(score, axis=1)[:, :count]
        for k in range(count):
            which = nearest[:, k]
            use = np.flatnonzero(np.take_along_axis(score, nearest, 1)[:, k] < 9.0)
            low, span = boxes[which[use], 0], boxes[which[use], 1] - boxes[which[use], 0]
            size = np.prod(np.where(span > 1e-6, span, 1.0), axis=1)
            axis = facing[which[use]]
            for s in range(_WINDOW_SAMPLES):
                spot = rng.random((len(use), 3))
                spot[:, 2] = (s + spot[:, 2]) / _WINDOW_SAMPLES
                # Some centimetres before the pane, clear of reveal and frame.
                target = low + spot * span + 0.03 * axis
                add = self._from(start[use], normals[use], target, axis)
                result[use] += (add * size * (0.75 / _WINDOW_SAMPLES))[:, None] * _SKY
        return result

    def _lamps(self, rng: np.random.Generator, start: Floats, normals: Floats) -> Floats:
        result = np.zeros_like(start)
        lamps = self._lights.lamp_m
        gap = np.linalg.norm(start[:, None] - lamps.astype(np.float32), axis=2)
        count = min(_NEAR_LAMPS, len(lamps))
        nearest = np.argsort(gap, axis=1)[:, :count]
        down = np.array([[0.0, 0.0, -1.0]])
        for k in range(count):
            for _ in range(_LAMP_SAMPLES):
                target = lamps[nearest[:, k]] + rng.uniform(-1, 1, start.shape) * (0.2, 0.2, 0.01)
                add = self._from(start, normals, target, down, 0.35)
                result += (add * (0.9 / _LAMP_SAMPLES))[:, None] * _LAMP
        return result

    def _from(
        self, start: Floats, normals: Floats, target: Array, axis: Array, spill: float = 0.0
    ) -> Floats:
        """Return irradiance (N,) from unit patches at `target` that shine along `axis`."""
        ray = (target - start).astype(np.float32)
        distance = np.linalg.norm(ray, axis=1)
        ray /= np.maximum(distance, 1e-6)[:, None]
        receive = np.maximum(np.einsum("ij,ij->i", ray, normals), 0)
        send = np.maximum(-(ray * axis).sum(1), 0) * (1 - spill) + spill
        strength = receive * send / (np.pi * np.maximum(distance, 0.5) ** 2)
        useful = np.flatnonzero(strength > 2e-4)
        hidden = self._tracer.blocked(start[useful], ray[useful], distance[useful] - 0.02)
        strength[useful[hidden]] = 0
        return strength.astype(np.float32)


def tangents(normals: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors (N, 3) that complete unit normals (N, 3) to right-handed frames.

    The first is x where there is no normal.
    """
    helper = np.where(np.abs(normals[:, 2:]) < 0.9, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    across = np.cross(helper.astype(normals.dtype), normals)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across /= np.maximum(length, 1e-9)
    across[length[:, 0] <= 1e-9] = (1.0, 0.0, 0.0)
    return across, np.cross(normals, across)


@kernel()
def _sunlit(scene, arguments, rays, n, points, normals, direction, strength):
    """Write the sun's irradiance (N,) at points (N, 3) with unit normals, 0 in shadow."""
    bits = rays.view(np.int32)
    valid = rays.ctypes.data + 4 * VALID
    lit = np.empty(n, dtype=np.int64)
    count = 0
    for i in range(len(points)):
        cosine = normals[i, 0] * direction[0] + normals[i, 1] * direction[1]
        cosine += normals[i, 2] * direction[2]
        strength[i] = _SUN_STRENGTH * cosine if cosine > _LEAST_SUN else 0.0
        if cosine > _LEAST_SUN:
            fill_ray(
                rays, bits, n, count,
                points[i, 0] + _SUN_LIFT_M * normals[i, 0],
                points[i, 1] + _SUN_LIFT_M * normals[i, 1],
                points[i, 2] + _SUN_LIFT_M * normals[i, 2],
                direction[0], direction[1], direction[2], _SUN_REACH_M,
            )  # fmt: skip
            lit[count] = i
            count += 1
        if count == n or (count and i == len(points) - 1):
            for k in range(count, n):
                bits[VALID + k] = 0
            call_occluded(n, valid, scene, rays.ctypes.data, arguments.ctypes.data)
            for k in range(count):
                if rays[FAR * n + k] < 0.0:
                    strength[lit[k]] = 0.0
            count = 0
