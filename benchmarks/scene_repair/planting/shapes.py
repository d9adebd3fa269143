"""Outlines of holes by kind, around the origin, and the little plane geometry they need."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vlnpe.formats.core.arrays import Array, Mask

Rings = list[Array]

# Smallest and largest longer side of a hole.
SMALLEST_M, LARGEST_M = 0.03, 2.0


@dataclass(frozen=True)
class Outline:
    """An area as rings (n, 2) [m], filled by the even-odd rule."""

    rings: Rings

    def bounds_m(self) -> tuple[Array, Array]:
        """Lower and upper corner."""
        points = np.concatenate(self.rings)
        return points.min(axis=0), points.max(axis=0)

    def size_m(self) -> float:
        """Return the longest distance within it."""
        points = np.concatenate(self.rings)
        apart = points[:, None] - points[None]
        return float(np.sqrt((apart**2).sum(axis=-1).max()))

    def moved(self, by_m: Array, turn_rad: float = 0.0) -> "Outline":
        """Return this turned about the origin, then shifted."""
        c, s = np.cos(turn_rad), np.sin(turn_rad)
        turn = np.array([[c, s], [-s, c]])
        return Outline([ring @ turn + by_m for ring in self.rings])

    def contains(self, points_m: Array) -> Mask:
        """Return whether points (N, 2) lie inside."""
        inside = np.zeros(len(points_m), dtype=bool)
        x, y = points_m[:, 0], points_m[:, 1]
        for ring in self.rings:
            for (ax, ay), (bx, by) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
                crosses = (ay > y) != (by > y)
                if ay != by:
                    inside ^= crosses & (x < (bx - ax) * (y - ay) / (by - ay) + ax)
        return inside


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def disc(radius_m: float, wobble: float, rng: np.random.Generator) -> Array:
    """Return a ring (n, 2) around the origin, more or less round."""
    count = int(np.clip(2 * np.pi * radius_m / 0.03, 12, 60))
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    wave = sum(
        rng.uniform(-1, 1) / k * np.cos(k * angle + rng.uniform(0, 2 * np.pi)) for k in (2, 3, 5)
    )
    radius = radius_m * (1 + wobble * wave)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def rectangle(length_m: float, width_m: float) -> Array:
    """Return a ring (4, 2) around the origin, its longer side along x."""
    x, y = length_m / 2, width_m / 2
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])


def round_hole(rng: np.random.Generator, size_m: float) -> Outline:
    """Return a wobbly disc."""
    return Outline([disc(size_m / 2, rng.uniform(0, 0.15), rng)])


def crack(rng: np.random.Generator, size_m: float) -> Outline:
    """Return a long bent line, a few mm to some cm wide, with pointed ends."""
    count = max(int(size_m / 0.12), 3) + 1
    x = np.linspace(-size_m / 2, size_m / 2, count)
    y = np.cumsum(rng.normal(0, 0.15 * size_m / count, count))
    half = np.full(count, log_uniform(rng, 0.004, 0.04) / 2) * rng.uniform(0.6, 1.4, count)
    half[[0, -1]] = 0.0005
    upper, lower = np.stack([x, y + half], axis=1), np.stack([x, y - half], axis=1)
    ring = np.concatenate([lower, upper[::-1]])
    return Outline([ring - ring.mean(axis=0)])


def sliver(rng: np.random.Generator, size_m: float) -> Outline:
    """Return the straight gap between two tiles."""
    return Outline([rectangle(size_m, log_uniform(rng, 0.002, 0.015))])


def concave(rng: np.random.Generator, size_m: float) -> Outline:
    """Return an L or a U."""
    a, b = size_m * rng.uniform(0.45, 0.7), size_m * rng.uniform(0.5, 0.7)
    arm = min(a, b) * rng.uniform(0.2, 0.33)
    if rng.random() < 0.5:
        ring = [[0, 0], [a, 0], [a, arm], [arm, arm], [arm, b], [0, b]]
    else:
        ring = [[0, 0], [a, 0], [a, b], [a - arm, b], [a - arm, arm], [arm, arm], [arm, b], [0, b]]
    points = np.array(ring, dtype=np.float64)
    return Outline([points - np.array([a, b]) / 2])


def ring_hole(rng: np.random.Generator, size_m: float) -> Outline:
    """Return a ring around an island of floor."""
    outer = disc(size_m / 2, rng.uniform(0, 0.08), rng)
    return Outline([outer, outer * rng.uniform(0.35, 0.75)])


def block(rng: np.random.Generator, size_m: float) -> Outline:
    """Return a rectangle, as things and walls hide one."""
    width = size_m * rng.uniform(0.35, 0.8)
    return Outline([rectangle(np.sqrt(size_m**2 - width**2), width)])


@dataclass(frozen=True)
class Kind:
    """Distribution of holes of one kind.

    Attributes:
        draw: an outline of a given size [m].
        sizes_m: least and greatest.
    """

    draw: Callable[[np.random.Generator, float], Outline]
    sizes_m: tuple[float, float]


KINDS = {
    "round": Kind(round_hole, (SMALLEST_M, LARGEST_M)),
    "crack": Kind(crack, (0.3, LARGEST_M)),
    "sliver": Kind(sliver, (0.2, 1.5)),
    "concave": Kind(concave, (0.15, LARGEST_M)),
    "ring": Kind(ring_hole, (0.25, LARGEST_M)),
    "at a wall": Kind(block, (0.06, LARGEST_M)),
    "under furniture": Kind(block, (0.1, LARGEST_M)),
    "threshold": Kind(block, (0.3, 1.2)),
}


def ragged(outline: Outline, rng: np.random.Generator, tooth_m: float = 0.025) -> Outline:
    """Return the outline with teeth, as if whole small triangles were missing."""
    rings = []
    for ring in outline.rings:
        after = np.roll(ring, -1, axis=0)
        points = []
        for a, b in zip(ring, after, strict=True):
            length = float(np.linalg.norm(b - a))
            steps = int(np.ceil(length / tooth_m))
            t = np.arange(steps)[:, None] / steps
            along = a * (1 - t) + b * t
            normal = np.array([a[1] - b[1], b[0] - a[0]]) / max(length, 1e-9)
            push = rng.uniform(-0.5, 0.5, (steps, 1)) * min(tooth_m, length)
            points.append(along + push * normal)
        rings.append(np.concatenate(points))
    return Outline(rings)
