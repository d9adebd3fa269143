"""Floor coverings. Every function returns an image of exactly the size it is asked to cover."""

import numpy as np
from numpy.typing import ArrayLike

from .noise import Field, Image, blend, colored, fractal, grain, noise, to_image


def wood_field(rng: np.random.Generator, shape: tuple[int, int]) -> Field:
    """Return the grain of wood along x, about −1…1."""
    rows, columns = shape
    warp = noise(rng, shape, (max(rows // 90, 2), max(columns // 300, 2)))
    y = np.linspace(0, 1, rows, endpoint=False, dtype=np.float32)[:, None]
    rings = np.sin(2 * np.pi * (np.round(rows / 22) * y + 1.1 * warp))
    fibre = noise(rng, shape, (rows // 2, max(columns // 60, 2)))
    streak = noise(rng, shape, (max(rows // 10, 2), max(columns // 250, 2)))
    return (0.35 * rings + 0.4 * fibre + 0.5 * streak).astype(np.float32)


def planks(
    rng: np.random.Generator,
    shape: tuple[int, int],
    rows: int,
    per_row: int,
    base: ArrayLike,
    contrast: float = 1.0,
) -> Image:
    """Paint boards along x, each with its own tone and grain, and dark grooves."""
    height, width = shape
    y, x = np.arange(height)[:, None], np.arange(width)[None, :]
    board_h, board_w = height / rows, width / per_row
    row = np.minimum((y / board_h).astype(np.int64), rows - 1)
    shifted = (x + rng.integers(0, width, rows)[row]) % width
    column = np.minimum((shifted / board_w).astype(np.int64), per_row - 1)
    board = row * per_row + column
    count = rows * per_row
    field = wood_field(rng, shape)
    moved = field[
        (y + rng.integers(0, height, count)[board]) % height,
        (x + rng.integers(0, width, count)[board]) % width,
    ]
    tone = rng.normal(0, 0.075, count).astype(np.float32)[board]
    color = colored(base, 1 + contrast * (tone + 0.085 * moved) + grain(rng, shape, 0.012))
    # Boards differ in warmth too, not only in brightness.
    warmth = rng.normal(0, 0.025, count).astype(np.float32)[board]
    color[..., 0] *= 1 + warmth
    color[..., 2] *= 1 - warmth
    in_y, in_x = y - row * board_h, shifted - column * board_w
    groove = (in_y < 1.2) | (in_x < 1.2)
    bevel = (in_y > board_h - 1.5) | (in_x > board_w - 1.5)
    return to_image(color * (1 - 0.45 * groove - 0.12 * bevel)[..., None])


def herringbone(rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike) -> Image:
    """Paint herringbone parquet: 24 boards' widths in the height, each four times as long."""
    height, width = shape
    block = height // 24
    y, x = np.meshgrid(np.arange(height) // block, np.arange(width) // block, indexing="ij")
    phase = (x - y) % 8
    across = phase < 4  # The board runs along x here, along y elsewhere.
    start_x, start_y = np.where(across, x - phase, x), np.where(across, y, y - (7 - phase))
    code = (start_x * 73856093 ^ start_y * 19349663) & 0xFFFF
    rows_y, cols_x = np.arange(height)[:, None], np.arange(width)[None, :]
    field = wood_field(rng, (max(shape), max(shape)))
    side = max(shape)
    along = field[(rows_y + code) % side, (cols_x + code * 3) % side]
    upright = field[(cols_x + code) % side, (rows_y + code * 3) % side]
    tone = rng.normal(0, 0.07, 1 << 16).astype(np.float32)[code]
    factor = 1 + tone + 0.08 * np.where(across, along, upright) + np.where(across, 0.03, -0.03)
    in_y, in_x = rows_y % block, cols_x % block
    edge_long = np.where(across, in_y < 1, in_x < 1)
    edge_short = np.where(across, (phase == 0) & (in_x < 1), (phase == 7) & (in_y < 1))
    return to_image(
        colored(base, factor.astype(np.float32)) * (1 - 0.4 * (edge_long | edge_short))[..., None]
    )


def tiles(
    rng: np.random.Generator,
    shape: tuple[int, int],
    count: tuple[int, int],
    base: ArrayLike,
    *,
    other: ArrayLike | None = None,
    grout: ArrayLike = (150, 145, 138),
    veins: float = 0.0,
    offset: bool = False,
    grout_px: float = 1.6,
) -> Image:
    """Paint tiles with grout, `count` along y and x; colours are 0–255.

    Args:
        other: second colour of a chequered floor.
        veins: strength of marble veins.
        offset: shift every second row by half a tile (bricks).
        grout_px: half width of a joint.
    """
    height, width = shape
    tile_h, tile_w = height / count[0], width / count[1]
    y, x = np.arange(height)[:, None] + 0.5, np.arange(width)[None, :] + 0.5
    row = (y / tile_h).astype(np.int64)
    shifted = (x + (row % 2) * (tile_w / 2 if offset else 0.0)) % width
    column = np.minimum((shifted / tile_w).astype(np.int64), count[1] - 1)
    index = row * count[1] + column
    total = count[0] * count[1]
    cloud = fractal(rng, shape, (5, 5), 4)
    jump = rng.integers(0, max(shape), (2, total))
    rows, columns = np.arange(height)[:, None], np.arange(width)[None, :]
    cloud = cloud[(rows + jump[0][index]) % height, (columns + jump[1][index]) % width]
    tone = rng.normal(0, 0.022, total).astype(np.float32)[index]
    factor = 1 + tone + 0.035 * cloud + grain(rng, shape, 0.008)
    if veins:
        factor = factor - veins * np.exp(-((cloud / 0.07) ** 2))
    color = colored(base, factor)
    if other is not None:
        color = blend(color, colored(other, factor), ((row + column) % 2).astype(np.float32))
    in_y, in_x = y - row * tile_h, shifted - column * tile_w
    edge = np.minimum(np.minimum(in_y, tile_h - in_y), np.minimum(in_x, tile_w - in_x))
    color *= (1 - 0.1 * np.exp(-edge / 3.0))[..., None]
    joint = colored(grout, 1 + grain(rng, shape, 0.04))
    return to_image(blend(color, joint, (edge < grout_px).astype(np.float32)))


def carpet(rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike) -> Image:
    """Paint a wall-to-wall carpet: tufts and faint tracks."""
    tufts = noise(rng, shape, (shape[0] // 3, shape[1] // 3))
    tracks = fractal(rng, shape, (4, 4), 3)
    speck = noise(rng, shape, (shape[0] // 6, shape[1] // 6))
    return to_image(colored(base, 1 + 0.09 * tufts + 0.035 * tracks + 0.05 * speck))


def terrazzo(rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike) -> Image:
    """Paint stone chips in cement."""
    color = colored(base, 1 + 0.02 * fractal(rng, shape, (4, 4), 3) + grain(rng, shape, 0.012))
    for chip in ((120, 95, 80), (235, 230, 222), (88, 92, 96), (178, 140, 104)):
        field = noise(rng, shape, (shape[0] // 11, shape[1] // 11))
        color = blend(color, chip, (field > 1.75).astype(np.float32))
    return to_image(color)


def concrete(rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike) -> Image:
    """Paint polished concrete."""
    cloud = fractal(rng, shape, (3, 3), 6)
    pores = noise(rng, shape, (shape[0] // 3, shape[1] // 3)) > 2.6
    return to_image(
        colored(base, (1 + 0.055 * cloud + grain(rng, shape, 0.012)) * (1 - 0.15 * pores))
    )
