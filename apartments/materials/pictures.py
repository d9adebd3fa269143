"""Whole pictures: paintings, window views, fronts of appliances, rows of books, screens."""

import cv2
import numpy as np
from numpy.typing import ArrayLike

from .noise import Image, blend, canvas, colored, fractal, grain, noise, to_image


def painting(rng: np.random.Generator, shape: tuple[int, int]) -> Image:
    """Paint a picture for the wall: landscape, abstract shapes or colour fields, in a white mat."""
    color = [_landscape, _shapes, _fields][int(rng.integers(3))](rng, shape)
    mat = int(0.1 * min(shape))
    if rng.random() < 0.6:
        framed = canvas(shape, (238, 235, 228))
        framed[mat:-mat, mat:-mat] = color[mat:-mat, mat:-mat]
        color = framed
    return to_image(color)


def _landscape(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    height, width = shape
    y = np.linspace(0, 1, height, dtype=np.float32)[:, None]
    sky_top, sky_low = (
        rng.uniform([60, 110, 160], [140, 170, 220]),
        rng.uniform([220, 180, 150], [250, 225, 210]),
    )
    color = np.asarray(sky_top) * (1 - y[..., None]) + np.asarray(sky_low) * y[..., None]
    color = np.broadcast_to(color, (height, width, 3)).astype(np.float32)
    sun = (int(rng.uniform(0.2, 0.8) * width), int(rng.uniform(0.15, 0.4) * height))
    color = np.ascontiguousarray(color)
    cv2.circle(color, sun, int(0.07 * height), (250, 240, 205), -1, cv2.LINE_AA)
    for k in range(4):
        ridge = noise(rng, (1, width), (1, 5 + 2 * k))[0] * 0.05 + 0.42 + 0.14 * k
        hill = rng.uniform([50, 80, 60], [120, 140, 110]) * (1 - 0.16 * k)
        color = blend(color, hill, (y > ridge[None, :]).astype(np.float32))
    return color * (1 + 0.05 * fractal(rng, shape, (8, 8), 4))[..., None]


def _shapes(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    height, width = shape
    color = canvas(shape, rng.uniform(205, 240, 3))
    palette = rng.uniform([20, 20, 20], [235, 200, 200], (6, 3))
    for k in range(11):
        paint = tuple(float(c) for c in palette[k % 6])
        p = (rng.uniform(0.05, 0.95, 2) * (width, height)).astype(int).tolist()
        q = (rng.uniform(0.05, 0.95, 2) * (width, height)).astype(int).tolist()
        kind = int(rng.integers(3))
        if kind == 0:
            cv2.circle(color, p, int(rng.uniform(0.05, 0.22) * height), paint, -1, cv2.LINE_AA)
        elif kind == 1:
            cv2.rectangle(color, p, q, paint, -1 if k < 4 else 3, cv2.LINE_AA)
        else:
            cv2.line(color, p, q, paint, int(rng.integers(2, 8)), cv2.LINE_AA)
    return color


def _fields(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    height, _ = shape
    base = rng.uniform([120, 60, 40], [230, 190, 170])
    color = colored(base, 1 + 0.08 * fractal(rng, shape, (6, 6), 5))
    cut = np.sort(rng.uniform(0.15, 0.9, 2))
    y = np.linspace(0, 1, height, dtype=np.float32)[:, None] + 0.01 * noise(rng, shape, (20, 20))
    for k, paint in enumerate(rng.uniform(20, 230, (2, 3))):
        color = blend(color, paint, np.clip((y - cut[k]) * 30, 0, 1).astype(np.float32))
    return color


def window_view(rng: np.random.Generator, shape: tuple[int, int], panes: int) -> Image:
    """Paint daylight outside: sky, clouds, distant houses or trees, behind a frame of panes."""
    height, width = shape
    y = np.linspace(0, 1, height, dtype=np.float32)[:, None]
    color = canvas(shape, (0, 0, 0))
    color += np.array([176, 208, 242], np.float32) * (1 - y[..., None])
    color += np.array([240, 244, 246], np.float32) * y[..., None]
    cloud = np.clip(0.5 * fractal(rng, shape, (3, 5), 4) - 0.1, 0, 1) * (1 - 0.6 * y)
    color = blend(color, (252, 252, 252), cloud)
    horizon = rng.uniform(0.56, 0.68)
    if rng.random() < 0.5:
        at = 0.0
        while at < 1.0:
            w, top = rng.uniform(0.1, 0.25), horizon + rng.uniform(-0.2, 0.0)
            wall = rng.uniform([165, 145, 130], [225, 210, 200])
            x0, x1, y0 = int(at * width), int((at + w) * width), int(top * height)
            color[y0:, x0:x1] = wall
            for r in range(y0 + 6, height, 16):
                for c in range(x0 + 5, x1 - 6, 13):
                    color[r : r + 8, c : c + 6] = wall * 0.55
            at += w
    tree_line = horizon + 0.08 + 0.05 * noise(rng, (1, width), (1, 9))[0]
    fol = colored((96, 128, 74), 1 + 0.25 * fractal(rng, shape, (20, 20), 3))
    color = blend(color, fol, np.clip((y - tree_line[None, :]) * 25, 0, 1).astype(np.float32))
    color = color * 0.88 + 30  # Overexposed, as windows are to an indoor camera.
    bar = max(3, int(0.045 * height))
    frame = np.array([236, 235, 230], np.float32)
    for k in range(panes + 1):
        c = round(k * (width - bar) / panes)
        color[:, c : c + bar] = frame
        color[:, c + bar : c + bar + 2] *= 0.8
    color[:bar], color[-bar:] = frame, frame
    return to_image(color)


def book_spines(rng: np.random.Generator, shape: tuple[int, int], tint: ArrayLike) -> Image:
    """Paint a row of books standing on a shelf.

    The gap above them is the dark back of the shelf.
    """
    height, width = shape
    color = colored(tint, 0.35 + 0.02 * noise(rng, shape, (4, 30)))
    palette = rng.uniform([30, 30, 40], [215, 190, 170], (9, 3))
    x = 0
    while x < width:
        w = int(rng.integers(5, 14))
        if rng.random() < 0.06:
            x += int(rng.integers(6, 22))
            continue
        top = int(height * rng.uniform(0.08, 0.42))
        spine = palette[rng.integers(9)] * rng.uniform(0.75, 1.15)
        across = 1 - 0.35 * np.abs(np.linspace(-1, 1, w)) ** 3
        stop = min(x + w, width)
        color[top:, x:stop] = spine * across[None, : stop - x, None]
        if rng.random() < 0.7:
            band = top + int((height - top) * rng.uniform(0.12, 0.3))
            color[band : band + max(height // 16, 2), x + 1 : stop - 1] = rng.uniform(170, 240, 3)
        x += w
    return to_image(color)


def front(
    rng: np.random.Generator,
    shape: tuple[int, int],
    base: ArrayLike,
    rows: int,
    columns: int,
    *,
    knob: ArrayLike = (70, 70, 72),
    framed: bool = False,
    wood: np.ndarray | None = None,
) -> Image:
    """Paint cupboard doors or drawers: `rows` × `columns` leaves with joints and handles."""
    height, width = shape
    color = (
        colored(base, 1 + 0.01 * fractal(rng, shape, (3, 3), 3))
        if wood is None
        else cv2.resize(wood, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32)
    )
    for r in range(rows):
        for c in range(columns):
            y0, y1 = r * height // rows, (r + 1) * height // rows
            x0, x1 = c * width // columns, (c + 1) * width // columns
            leaf = color[y0:y1, x0:x1]
            leaf *= 1 + rng.normal(0, 0.012)
            leaf[:2] *= 0.45
            leaf[:, :2] *= 0.45
            leaf[2:4] *= 1.05
            h, w = leaf.shape[:2]
            inset = int(0.14 * min(h, w))
            if framed and inset > 4:
                leaf[inset : inset + 2, inset:-inset] *= 0.7
                leaf[inset:-inset, inset : inset + 2] *= 0.75
                leaf[-inset : -inset + 2, inset:-inset] *= 1.1
                leaf[inset:-inset, -inset : -inset + 2] *= 1.08
            tall = h > 1.2 * w
            if tall:
                x = 8 if c % 2 else w - 12
                y = h // 2 - 16 if rows == 1 else h // 2 - 10
                leaf[y : y + min(32, h // 2), x : x + 4] = knob
            else:
                y = max(6, int(0.14 * h)) if h > 40 else h // 2
                leaf[y : y + 4, w // 2 - min(20, w // 4) : w // 2 + min(20, w // 4)] = knob
    return to_image(color)


def oven(rng: np.random.Generator, shape: tuple[int, int]) -> Image:
    """Paint an oven's front: panel with knobs and a clock over a dark door."""
    height, width = shape
    color = colored((172, 174, 176), 1 + 0.02 * noise(rng, shape, (height // 2, 3)))
    panel = height // 5
    for k in range(4):
        x = int(width * (0.12 + 0.13 * k + (0.25 if k > 1 else 0)))
        cv2.circle(color, (x, panel // 2), panel // 4, (45, 45, 48), -1, cv2.LINE_AA)
    color[panel // 4 : 3 * panel // 4, int(0.4 * width) : int(0.58 * width)] = (20, 26, 30)
    color[panel + 4 : panel + 9, width // 10 : -width // 10] = (215, 216, 218)
    color[panel + 16 : -10, width // 10 : -width // 10] = (30, 30, 33)
    return to_image(color)


def washer(rng: np.random.Generator, shape: tuple[int, int]) -> Image:
    """Paint the front of a washing machine."""
    height, width = shape
    color = canvas(shape, (232, 233, 234)) * (1 + grain(rng, shape, 0.006))[..., None]
    color = np.ascontiguousarray(color)
    middle = (width // 2, int(0.56 * height))
    for radius, paint in ((0.33, (160, 163, 168)), (0.28, (205, 207, 210)), (0.24, (52, 58, 66))):
        cv2.circle(color, middle, int(radius * width), paint, -1, cv2.LINE_AA)
    cv2.ellipse(color, middle, (width // 6, width // 8), 0, 200, 320, (105, 115, 128), 3)
    color[height // 7 : height // 7 + 2] *= 0.7
    cv2.circle(color, (int(0.72 * width), height // 14), height // 26, (120, 124, 130), -1)
    color[height // 28 : height // 10, width // 12 : width // 3] *= 0.82
    return to_image(color)


def screen(rng: np.random.Generator, shape: tuple[int, int]) -> Image:
    """Paint a dark screen that reflects the room faintly."""
    height, width = shape
    y, x = np.linspace(0, 1, height)[:, None], np.linspace(0, 1, width)[None, :]
    sheen = np.exp(-(((x - y * 0.5 - 0.35) / 0.12) ** 2)) + 0.4 * np.exp(-(((x - 0.8) / 0.1) ** 2))
    color = colored((16, 17, 20), (1 + 0.9 * sheen).astype(np.float32))
    color[:4], color[-8:], color[:, :4], color[:, -4:] = 10, 10, 10, 10
    return to_image(color)


def mirror(rng: np.random.Generator, shape: tuple[int, int]) -> Image:
    """Paint a mirror as a still picture of a bright, blurred room."""
    blur = fractal(rng, shape, (3, 2), 2)
    y = np.linspace(1.06, 0.86, shape[0], dtype=np.float32)[:, None]
    return to_image(colored((196, 204, 208), y + 0.05 * blur))


def panel_door(rng: np.random.Generator, shape: tuple[int, int], base: ArrayLike) -> Image:
    """Paint a closed door leaf with two panels, handle and spyhole."""
    height, width = shape
    color = colored(base, 1 + 0.02 * noise(rng, shape, (3, width // 3)))
    color = np.ascontiguousarray(color)
    for top, low in ((0.07, 0.42), (0.5, 0.93)):
        y0, y1, x0, x1 = int(top * height), int(low * height), int(0.16 * width), int(0.84 * width)
        cv2.rectangle(color, (x0, y0), (x1, y1), tuple(float(c) * 0.7 for c in np.ravel(base)), 3)
        cv2.rectangle(
            color,
            (x0 + 4, y0 + 4),
            (x1 - 3, y1 - 3),
            tuple(float(c) * 1.12 for c in np.ravel(base)),
            2,
        )
    cv2.circle(color, (width // 2, int(0.25 * height)), 3, (60, 60, 60), -1)
    at = (int(0.92 * width), int(0.5 * height))
    cv2.circle(color, at, 7, (190, 180, 150), -1, cv2.LINE_AA)
    cv2.line(color, at, (at[0] - 26, at[1]), (196, 186, 156), 6)
    return to_image(color)


def clock(rng: np.random.Generator, shape: tuple[int, int]) -> Image:
    """Paint a round clock face."""
    side = min(shape)
    color = canvas(shape, (242, 240, 232))
    middle = (shape[1] // 2, shape[0] // 2)
    cv2.circle(color, middle, side // 2 - 4, (40, 40, 42), 7, cv2.LINE_AA)
    for k in range(12):
        a = 2 * np.pi * k / 12
        p, q = (
            [int(middle[0] + r * side * np.cos(a)), int(middle[1] + r * side * np.sin(a))]
            for r in (0.35, 0.42)
        )
        cv2.line(color, p, q, (40, 40, 42), 3, cv2.LINE_AA)
    for length, a in ((0.22, rng.uniform(0, 6.28)), (0.33, rng.uniform(0, 6.28))):
        q = [int(middle[0] + length * side * np.cos(a)), int(middle[1] + length * side * np.sin(a))]
        cv2.line(color, middle, q, (30, 30, 30), 4, cv2.LINE_AA)
    return to_image(color)
