"""Wall finishes."""

import numpy as np
from numpy.typing import ArrayLike

from .floors import tiles
from .noise import Image, blend, canvas, colored, fractal, grain, noise, to_image


def plaster(
    rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike, scuffs: float = 0.06
) -> Image:
    """Paint plaster: roller texture, faint clouds, a few scuffs of the given darkness."""
    roller = noise(rng, shape, (shape[0] // 3, shape[1] // 3))
    cloud = fractal(rng, shape, (3, 3), 4)
    scuff = np.clip(noise(rng, shape, (shape[0] // 12, shape[1] // 30)) - 2.9, 0, 1)
    return to_image(colored(base, 1 + 0.012 * roller + 0.014 * cloud - scuffs * scuff))


def stripes(
    rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike, other: ArrayLike, count: int
) -> Image:
    """Paint wallpaper with upright stripes and a thin line beside each."""
    phase = (np.arange(shape[1]) * count / shape[1]) % 1.0
    wide = np.broadcast_to((phase < 0.45).astype(np.float32), shape)
    line = np.broadcast_to((np.abs(phase - 0.72) < 0.025).astype(np.float32), shape)
    paper = 1 + 0.012 * noise(rng, shape, (shape[0] // 2, shape[1] // 2))
    color = blend(colored(base, paper), colored(other, paper), np.maximum(wide, line))
    return to_image(color)


def damask(
    rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike, other: ArrayLike, count: int
) -> Image:
    """Paint wallpaper with a repeated ornament made of a few harmonics."""
    y = np.arange(shape[0], dtype=np.float32)[:, None] / shape[0] * count * 2 * np.pi
    x = np.arange(shape[1], dtype=np.float32)[None, :] / shape[1] * count * 2 * np.pi
    a, b = rng.uniform(0.6, 1.4, 2)
    ornament = (
        np.cos(x) * np.cos(y)
        + 0.7 * a * np.cos(2 * x) * np.cos(y)
        - 0.6 * b * np.cos(x) * np.cos(3 * y)
        + 0.5 * np.cos(3 * x) * np.cos(2 * y)
    )
    weight = np.clip((ornament - 0.35) * 6, 0, 1).astype(np.float32)
    paper = 1 + 0.012 * noise(rng, shape, (shape[0] // 2, shape[1] // 2))
    return to_image(blend(colored(base, paper), colored(other, paper), weight))


def bricks(rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike) -> Image:
    """Paint brickwork, about 25 × 7 cm per brick when the image covers 1.5 × 1.5 m."""
    wall = tiles(rng, shape, (20, 6), base, grout=(186, 180, 170), offset=True, grout_px=2.2)
    worn = 1 + 0.07 * fractal(rng, shape, (8, 8), 4) + grain(rng, shape, 0.03)
    return to_image(wall.astype(np.float32) * worn[..., None])


def panelling(
    rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike, count: int
) -> Image:
    """Paint tongue-and-groove boards."""
    phase = (np.arange(shape[1]) * count / shape[1]) % 1.0
    profile = (
        1 - 0.28 * np.exp(-((phase / 0.035) ** 2)) + 0.05 * np.exp(-(((phase - 0.93) / 0.03) ** 2))
    )
    streak = noise(rng, shape, (max(shape[0] // 200, 2), shape[1] // 3))
    return to_image(colored(base, (profile[None, :] * (1 + 0.012 * streak)).astype(np.float32)))


def paint(rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike) -> Image:
    """Paint smooth lacquer on wood or metal."""
    return to_image(canvas(shape, base) * (1 + 0.012 * fractal(rng, shape, (3, 3), 3))[..., None])
