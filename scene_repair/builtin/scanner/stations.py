"""Where the scanner stands and looks: through all rooms, at eye height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..config import ScanConfig
from ..home.plan import FloorPlan
from ..home.shell import wall_frame
from .tracing import Tracer

_HEADINGS = 6
_PITCHES_DEG = (-33.0, 27.0)
_HEIGHT_M = (1.4, 1.6)
_BODY_M = 0.3


@dataclass(frozen=True)
class View:
    """One depth view.

    Attributes:
        position_m: (3,) world.
        rotation: (3, 3) camera (x right, y down, z forward) to world.
    """

    position_m: NDArray[np.float64]
    rotation: NDArray[np.float64]


def look(position_m: NDArray[np.float64], yaw_rad: float, pitch_rad: float) -> View:
    """A level camera at `position_m` that looks along yaw and pitch (up positive)."""
    forward = np.array(
        [
            np.cos(yaw_rad) * np.cos(pitch_rad),
            np.sin(yaw_rad) * np.cos(pitch_rad),
            np.sin(pitch_rad),
        ]
    )
    right = np.array([np.sin(yaw_rad), -np.cos(yaw_rad), 0.0])
    return View(position_m, np.stack([right, np.cross(forward, right), forward], axis=1))


def _standing(tracer: Tracer, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether a person fits at camera positions (N, 3): bare floor below, nothing too near."""
    down = np.tile(np.float32([0, 0, -1]), (len(points), 1))
    clear = tracer.distance(points.astype(np.float32), down, 4.0) > points[:, 2] - 0.05
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(12)], -1).astype(np.float32)
    for height in (0.0, 0.9):
        origins = np.repeat(points - (0, 0, height), 12, axis=0).astype(np.float32)
        near = tracer.distance(origins, np.tile(ring, (len(points), 1)), 2.0)
        clear &= near.reshape(len(points), 12).min(1) > _BODY_M
    return clear


def stations(
    rng: np.random.Generator, plan: FloorPlan, tracer: Tracer, spacing_m: float
) -> NDArray[np.float64]:
    """(N, 3) camera positions [m]: a jittered lattice in every room and every doorway."""
    found: list[NDArray[np.float64]] = []
    for room in plan.rooms:
        count = np.maximum(np.round(room.size_m / spacing_m), 1).astype(int)
        step = room.size_m / count
        for i, j in np.ndindex(int(count[0]), int(count[1])):
            middle = np.asarray(room.lower_m) + (np.array([i, j]) + 0.5) * step
            tries = middle + rng.uniform(-0.5, 0.5, (14, 2)) * step
            tries[0] = middle
            points = np.c_[tries, rng.uniform(*_HEIGHT_M, len(tries))]
            good = np.flatnonzero(_standing(tracer, points))
            if len(good):
                found.append(points[good[0]])
    for door in plan.openings:
        if door.kind == "door" and door.room < door.other_room:
            place = wall_frame(plan.rooms[door.room], door.axis, door.sign)
            at = place((door.start_m + door.end_m) / 2, plan.wall_m / 2, 1.5)
            found.append(at)
    return np.array(found)


def views(
    rng: np.random.Generator, plan: FloorPlan, tracer: Tracer, config: ScanConfig
) -> list[View]:
    """All depth views: at each station several headings, looking down and up."""
    result = []
    for position in stations(rng, plan, tracer, config.station_spacing_m):
        start = rng.uniform(0, 2 * np.pi)
        for k in range(_HEADINGS):
            for pitch in _PITCHES_DEG:
                yaw = start + 2 * np.pi * k / _HEADINGS + rng.normal(0, 0.05)
                result.append(look(position, yaw, np.deg2rad(pitch + rng.normal(0, 2.0))))
    return result
