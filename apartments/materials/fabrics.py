"""Textiles, wood, stone and metal of furniture."""

import numpy as np
from numpy.typing import ArrayLike

from .floors import wood_field
from .noise import Image, blend, canvas, colored, fractal, grain, noise, to_image


def board(rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike) -> Image:
    """Paint furniture wood, grain along x."""
    cloud = fractal(rng, shape, (2, 3), 3)
    return to_image(colored(base, 1 + 0.1 * wood_field(rng, shape) + 0.03 * cloud))


def weave(rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike) -> Image:
    """Paint upholstery cloth."""
    y, x = np.arange(shape[0])[:, None], np.arange(shape[1])[None, :]
    thread = 0.06 * np.sin(2 * np.pi * y / 4) * np.sin(2 * np.pi * x / 4)
    slub = noise(rng, shape, (shape[0] // 2, shape[1] // 24)) + noise(
        rng, shape, (shape[0] // 24, shape[1] // 2)
    )
    wear = fractal(rng, shape, (3, 3), 3)
    return to_image(colored(base, (1 + thread + 0.045 * slub + 0.03 * wear).astype(np.float32)))


def plaid(
    rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike, other: ArrayLike, count: int
) -> Image:
    """Paint a checked blanket."""

    def bands(size: int) -> np.ndarray:
        phase = (np.arange(size) * count / size) % 1.0
        return 0.55 * (phase < 0.4) + 0.45 * (np.abs(phase - 0.7) < 0.05)

    weight = 0.5 * bands(shape[0])[:, None] + 0.5 * bands(shape[1])[None, :]
    cloth = 1 + 0.05 * noise(rng, shape, (shape[0] // 2, shape[1] // 2))
    color = blend(colored(base, cloth), colored(other, cloth), weight.astype(np.float32))
    return to_image(color)


def quilt(
    rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike, other: ArrayLike, style: int
) -> Image:
    """Paint bed linen: 0 stripes, 1 dots, 2 plain with folds, 3 large leaves."""
    y, x = np.arange(shape[0])[:, None], np.arange(shape[1])[None, :]
    folds = 1 + 0.05 * fractal(rng, shape, (4, 6), 3) + grain(rng, shape, 0.012)
    if style == 0:
        weight = np.broadcast_to(((x * 10 // shape[1]) % 2).astype(np.float32), shape)
    elif style == 1:
        u, v = (x * 12 / shape[1]) % 1 - 0.5, (y * 12 / shape[0]) % 1 - 0.5
        weight = (u**2 + v**2 < 0.06).astype(np.float32)
    elif style == 3:
        leaf = noise(rng, shape, (14, 14))
        weight = np.clip((np.abs(leaf) - 0.9) * 6, 0, 1)
    else:
        weight = np.zeros(shape, dtype=np.float32)
    return to_image(blend(colored(base, folds), colored(other, folds), weight))


def rug(
    rng: np.random.Generator, shape: tuple[int, int], colors: list[tuple[int, int, int]]
) -> Image:
    """Paint a whole rug: border, fringe and a mirrored or geometric field."""
    height, width = shape
    y = np.abs(np.linspace(-1, 1, height, dtype=np.float32))[:, None]
    x = np.abs(np.linspace(-1, 1, width, dtype=np.float32))[None, :]
    edge = np.minimum((1 - y) * height / width, 1 - x)
    color = canvas(shape, colors[0])
    style = int(rng.integers(3))
    if style == 0:  # Oriental: a quarter of ornament, mirrored twice.
        quarter = fractal(rng, (height // 2 + 1, width // 2 + 1), (9, 12), 2)
        full = np.block([[quarter, quarter[:, ::-1]], [quarter[::-1], quarter[::-1, ::-1]]])
        full = full[:height, :width]
        color = blend(color, colors[1], (full > 0.5).astype(np.float32))
        color = blend(color, colors[2], (full < -0.9).astype(np.float32))
        medallion = (x / 0.5) ** 2 + (y / 0.62) ** 2
        color = blend(color, colors[2], (np.abs(medallion - 0.85) < 0.12).astype(np.float32))
    elif style == 1:  # Diamonds.
        lattice = np.abs((x * 5 + y * 3.5) % 1 - 0.5) + np.abs((x * 5 - y * 3.5) % 1 - 0.5)
        color = blend(color, colors[1], (lattice < 0.28).astype(np.float32))
        color = blend(color, colors[2], (np.abs(lattice - 0.5) < 0.05).astype(np.float32))
    else:  # Broad stripes across.
        band = np.broadcast_to((x * 7).astype(np.int64) % 3, shape)
        for k in (1, 2):
            color = blend(color, colors[k], (band == k).astype(np.float32))
    frame = (edge > 0.05) & (edge < 0.11)
    color = blend(color, colors[1], frame.astype(np.float32))
    color = blend(color, colors[2], ((edge > 0.12) & (edge < 0.135)).astype(np.float32))
    pile = 1 + 0.07 * noise(rng, shape, (height // 2, width // 2)) + grain(rng, shape, 0.03)
    return to_image(color * pile[..., None])


def marble(rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike, vein: float) -> Image:
    """Paint a stone worktop with veins."""
    cloud = fractal(rng, shape, (3, 3), 5)
    veins = np.exp(-((fractal(rng, shape, (2, 3), 5) / 0.06) ** 2))
    return to_image(colored(base, 1 + 0.04 * cloud - vein * veins + grain(rng, shape, 0.01)))


def brushed(rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike) -> Image:
    """Paint brushed metal with a broad sheen."""
    lines = noise(rng, shape, (shape[0] // 2, 3))
    sheen = noise(rng, shape, (3, 3))
    return to_image(colored(base, 1 + 0.03 * lines + 0.06 * sheen))


def leaves(rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike) -> Image:
    """Paint foliage: light leaves over dark gaps."""
    field = noise(rng, shape, (shape[0] // 9, shape[1] // 9))
    fine = noise(rng, shape, (shape[0] // 4, shape[1] // 4))
    factor = np.clip(0.85 + 0.32 * field + 0.14 * fine, 0.25, 1.5)
    color = colored(base, factor)
    color[..., 0] += 12 * np.clip(field, 0, 2)
    return to_image(color)


def wicker(rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike) -> Image:
    """Paint a basket weave."""
    y, x = np.arange(shape[0])[:, None] / 6.0, np.arange(shape[1])[None, :] / 9.0
    over = np.sin(np.pi * y) * np.sign(np.sin(np.pi * x + np.pi * np.floor(y)))
    return to_image(
        colored(base, (0.85 + 0.25 * over + grain(rng, shape, 0.05)).astype(np.float32))
    )
