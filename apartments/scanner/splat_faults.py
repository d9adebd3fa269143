"""Faults of real splat captures: floaters, thin spots, and a far background outside."""

from dataclasses import dataclass, replace

import numpy as np

from ...formats.core.arrays import Array
from ...formats.splats.record import GaussianCloud, joined
from ..building.true_scene import TrueScene

# Floaters for each square metre of floor, their sizes, lengths over widths, and opacities.
FLOATERS_PER_M2 = 6.0
FLOATER_M, FLOATER_STRETCH, FLOATER_OPACITY = (0.01, 0.1), 3.0, (0.04, 0.5)
# Spots where most Gaussians are missing and the others are faint.
SPOTS_PER_M2, SPOT_M, SPOT_KEPT, SPOT_OPACITY = 0.25, (0.12, 0.45), 0.15, (0.1, 0.5)
BACKGROUND, BACKGROUND_M, BACKGROUND_SIZE = 8_000, (20.0, 80.0), 0.03


@dataclass(frozen=True)
class Faults:
    """The faults that were planted.

    Attributes:
        floaters: number of Gaussians that belong to no surface.
        spots_m: (S, 4) centre and radius of the thin spots, world [m].
        background: number of Gaussians far outside.
    """

    floaters: int
    spots_m: Array
    background: int


def with_faults(
    rng: np.random.Generator, scene: TrueScene, cloud: GaussianCloud
) -> tuple[GaussianCloud, Faults]:
    """Return the cloud with faults; floaters and background follow the surfaces' Gaussians."""
    floor_m2 = sum(float(np.prod(r.size_m)) for plan in scene.storeys for r in plan.rooms)
    spots = _spots(rng, cloud, round(SPOTS_PER_M2 * floor_m2))
    cloud = _thinned(rng, cloud, spots)
    count = round(FLOATERS_PER_M2 * floor_m2)
    cloud = joined([cloud, _floaters(rng, scene, count), _background(rng, scene)])
    return cloud, Faults(count, spots, BACKGROUND)


def _spots(rng: np.random.Generator, cloud: GaussianCloud, count: int) -> Array:
    center = cloud.position[rng.choice(len(cloud), count)]
    return np.c_[center, rng.uniform(*SPOT_M, count)].astype(np.float64)


def _thinned(rng: np.random.Generator, cloud: GaussianCloud, spots: Array) -> GaussianCloud:
    keep = np.ones(len(cloud), dtype=bool)
    opacity = cloud.opacity.copy()
    for x, y, z, radius in spots:
        inside = np.linalg.norm(cloud.position - (x, y, z), axis=1) < radius
        keep &= ~inside | (rng.random(len(cloud)) < SPOT_KEPT)
        opacity[inside] = rng.uniform(*SPOT_OPACITY, int(inside.sum()))
    return replace(cloud, opacity=opacity).take(keep)


def _floaters(rng: np.random.Generator, scene: TrueScene, count: int) -> GaussianCloud:
    rooms = [(plan, room) for plan in scene.storeys for room in plan.rooms]
    share = np.array([np.prod(room.size_m) for _, room in rooms])
    places = []
    for k in rng.choice(len(rooms), count, p=share / share.sum()):
        plan, room = rooms[k]
        xy = np.asarray(room.lower_m) + rng.random(2) * room.size_m
        places.append((*xy, plan.floor_z_m + rng.uniform(0.1, plan.ceiling_m - 0.1)))
    low, high = np.log(FLOATER_M)
    size = np.exp(rng.uniform(low, high, (count, 1)))
    stretch = FLOATER_STRETCH ** rng.uniform(-1, 1, (count, 3))
    return _cloud(rng, np.array(places), size * stretch, rng.uniform(*FLOATER_OPACITY, count))


def _background(rng: np.random.Generator, scene: TrueScene) -> GaussianCloud:
    lower, upper = scene.bounds()
    direction = rng.standard_normal((BACKGROUND, 3))
    direction[:, 2] = np.abs(direction[:, 2])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    distance = rng.uniform(*BACKGROUND_M, (BACKGROUND, 1))
    size = BACKGROUND_SIZE * distance * 2.0 ** rng.uniform(-1, 1, (BACKGROUND, 3))
    opacity = rng.uniform(0.3, 0.95, BACKGROUND)
    return _cloud(rng, (lower + upper) / 2 + distance * direction, size, opacity)


def _cloud(
    rng: np.random.Generator, position: Array, scale: Array, opacity: Array
) -> GaussianCloud:
    quat = rng.standard_normal((len(position), 4))
    return GaussianCloud(
        position=position.reshape(-1, 3).astype(np.float32),
        scale=scale.astype(np.float32),
        quat_wxyz=(quat / np.linalg.norm(quat, axis=1, keepdims=True)).astype(np.float32),
        opacity=opacity.astype(np.float32),
        harmonics=rng.uniform(-1.2, 1.2, (len(position), 1, 3)).astype(np.float32),
    )
