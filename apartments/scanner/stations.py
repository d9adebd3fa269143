"""Plan the scanner's views: through all rooms, at eye height."""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import Array, Mask
from ..building.plan import FloorPlan
from ..building.shell import wall_frame
from ..building.stairs import eyes_on_stairs
from ..config import ScanConfig
from .tracing import Tracer

# Number of headings and pitch [deg] of each sweep.
_SWEEPS = ((5, -34.0), (4, 26.0))
_LATTICE_M = 0.3
_HEIGHT_M = (1.4, 1.6)
_BODY_M = 0.3


@dataclass(frozen=True)
class View:
    """One depth view.

    Attributes:
        position_m: (3,) world.
        rotation: (3, 3) camera (x right, y down, z forward) to world.
    """

    position_m: Array
    rotation: Array


def look(position_m: Array, yaw_rad: float, pitch_rad: float) -> View:
    """Return a level camera at `position_m` that looks along yaw and pitch (up positive)."""
    flat = np.array([np.cos(yaw_rad), np.sin(yaw_rad)]) * np.cos(pitch_rad)
    forward = np.append(flat, np.sin(pitch_rad))
    right = np.array([np.sin(yaw_rad), -np.cos(yaw_rad), 0.0])
    return View(position_m, np.stack([right, np.cross(forward, right), forward], axis=1))


def _standing(tracer: Tracer, points: Array, floor_z_m: float) -> Mask:
    """Return whether camera positions (N, 3) are free: bare floor below, nothing too near."""
    down = np.tile(np.array([0.0, 0.0, -1.0], dtype=np.float32), (len(points), 1))
    depth = tracer.distance(points.astype(np.float32), down, 4.0)
    height = points[:, 2] - floor_z_m
    clear = (depth > height - 0.05) & (depth < height + 0.05)
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(12)], -1).astype(np.float32)
    for height in (0.0, 0.9):
        origins = np.repeat(points - (0, 0, height), 12, axis=0).astype(np.float32)
        near = tracer.distance(origins, np.tile(ring, (len(points), 1)), 2.0)
        clear &= near.reshape(len(points), 12).min(1) > _BODY_M
    return clear


def stations(rng: np.random.Generator, plan: FloorPlan, tracer: Tracer, spacing_m: float) -> Array:
    """Return camera positions (N, 3) [m] over the free floor of every room, and in doorways."""
    positions: list[Array] = []
    for room in plan.rooms:
        count = np.maximum(np.ceil(room.size_m / _LATTICE_M), 2).astype(int)
        cells = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in count)), -1).reshape(-1, 2)
        cells = np.asarray(room.lower_m) + cells * room.size_m / count
        points = np.c_[
            cells + rng.uniform(-0.08, 0.08, cells.shape),
            rng.uniform(*_HEIGHT_M, len(cells)) + plan.floor_z_m,
        ]
        positions += _spread(points[_standing(tracer, points, plan.floor_z_m)], spacing_m)
    for door in plan.openings:
        if door.kind in ("door", "passage") and door.room < door.other_room:
            place = wall_frame(plan.rooms[door.room], door.axis, door.sign)
            height = plan.floor_z_m + 1.5
            positions.append(place((door.start_m + door.end_m) / 2, plan.wall_m / 2, height))
    for stairs in (b for b in plan.blocks if b.kind == "stairs"):
        positions += [np.array(eye) for eye in eyes_on_stairs(stairs)]
    return np.array(positions)


def _spread(points: Array, spacing_m: float) -> list[Array]:
    """Sample points (N, 3) farthest-first until all lie within `spacing_m` of a sample."""
    samples: list[Array] = []
    if not len(points):
        return samples
    # Starting in the corner makes the choice hug the walls, where furniture hides the floor.
    distance = np.full(len(points), np.inf)
    distance[0] = 1e9
    while distance.max() > spacing_m:
        k = int(np.argmax(distance))
        samples.append(points[k])
        distance = np.minimum(distance, np.linalg.norm(points[:, :2] - points[k, :2], axis=1))
    return samples


def views(
    rng: np.random.Generator, plan: FloorPlan, tracer: Tracer, config: ScanConfig
) -> list[View]:
    """Return all depth views: at each station several headings, looking down and up."""
    result = []
    for position in stations(rng, plan, tracer, config.station_spacing_m):
        start = rng.uniform(0, 2 * np.pi)
        for count, pitch in _SWEEPS:
            for k in range(count):
                yaw = start + 2 * np.pi * k / count + rng.normal(0, 0.05)
                result.append(look(position, yaw, np.deg2rad(pitch + rng.normal(0, 2.0))))
    return result
