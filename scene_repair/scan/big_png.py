"""Downscale a large PNG image while it is decoded, a few rows at a time."""

import struct
import zlib
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...formats.core.kernel import kernel

CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
BLOCK = 4 << 20
MAX_PIXELS, MAX_SIDE = 4_000_000_000, 200_000


def shrink_png(data: bytes, max_side: int) -> NDArray[np.uint8]:
    """Return RGB pixels (H, W, 3) of a PNG file, averaged down by an integer factor.

    Raises:
        ValueError: damaged, interlaced, fewer than 8 bits a sample, or of too many pixels.
    """
    width, height, depth, kind, _, _, interlaced = struct.unpack(">IIBBBBB", data[16:29])
    if interlaced or depth not in (8, 16) or kind not in CHANNELS:
        raise ValueError(
            f"{width} × {height} pixels are too many for an interlaced or low-depth image"
        )
    if width * height > MAX_PIXELS or max(width, height) > MAX_SIDE:
        raise ValueError(f"{width} × {height} pixels are too many")
    factor = -(-max(width, height) // max_side)
    across, down = max(1, width // factor), max(1, height // factor)
    bytes_per_pixel = CHANNELS[kind] * depth // 8
    stride = width * bytes_per_pixel
    palette = _palette(data) if kind == 3 else None
    result = np.zeros((down, across, 3), dtype=np.uint8)
    previous = np.zeros(stride, dtype=np.uint8)
    total = np.zeros((across, 3), dtype=np.int64)
    columns = min(across * factor, width)
    taken = row = 0
    for line in _lines(data, stride + 1):
        current = np.frombuffer(line, dtype=np.uint8)
        _unfilter(int(current[0]), current[1:], previous, bytes_per_pixel)
        pixels = previous.reshape(width, -1)[:columns]
        total += (
            _rgb(pixels, kind, depth, palette).reshape(across, -1, 3).sum(axis=1, dtype=np.int64)
        )
        taken += 1
        if taken == min(factor, height):
            result[row] = total // (taken * (columns // across))
            total[:] = 0
            taken, row = 0, row + 1
            if row == down:
                return result
    raise ValueError("the image ends early")


def _chunks(data: bytes) -> Iterator[tuple[bytes, memoryview]]:
    view, at = memoryview(data), 8
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        yield data[at + 4 : at + 8], view[at + 8 : at + 8 + length]
        at += 12 + length


def _palette(data: bytes) -> NDArray[np.uint8]:
    for kind, body in _chunks(data):
        if kind == b"PLTE":
            colors = np.zeros((256, 3), dtype=np.uint8)
            found = np.frombuffer(body, dtype=np.uint8)
            colors[: len(found) // 3] = found[: len(found) // 3 * 3].reshape(-1, 3)[:256]
            return colors
    raise ValueError("no palette")


def _lines(data: bytes, length: int) -> Iterator[bytes]:
    """Yield rows as they are stored: one filter byte, then the samples."""
    unpack = zlib.decompressobj()
    left = bytearray()
    for kind, body in _chunks(data):
        if kind != b"IDAT":
            continue
        packed: bytes | memoryview = body
        while packed:
            left += unpack.decompress(packed, BLOCK)
            packed = unpack.unconsumed_tail
            whole = len(left) // length * length
            for start in range(0, whole, length):
                yield bytes(left[start : start + length])
            del left[:whole]
            if unpack.eof:
                return


def _rgb(
    pixels: NDArray[np.uint8], kind: int, depth: int, palette: NDArray[np.uint8] | None
) -> NDArray[np.uint8]:
    # Of sixteen bits the high byte comes first.
    samples = pixels[:, :: depth // 8]
    if palette is not None:
        return palette[samples[:, 0]]
    return samples[:, :3] if kind in (2, 6) else np.repeat(samples[:, :1], 3, axis=1)


@kernel()
def _unfilter(
    kind: int, line: NDArray[np.uint8], previous: NDArray[np.uint8], step: int
) -> None:  # pragma: no cover - compiled
    """Undo a row's filter (PNG specification, 9.2); `previous` becomes the row."""
    corner = np.zeros(step, dtype=np.uint8)
    for i in range(len(line)):
        above = int(previous[i])
        left = int(previous[i - step]) if i >= step else 0
        diagonal = int(corner[i % step])
        corner[i % step] = np.uint8(above)
        if kind == 0:
            guess = 0
        elif kind == 1:
            guess = left
        elif kind == 2:
            guess = above
        elif kind == 3:
            guess = (left + above) // 2
        else:
            p = left + above - diagonal
            a, b, c = abs(p - left), abs(p - above), abs(p - diagonal)
            if a <= b and a <= c:
                guess = left
            elif b <= c:
                guess = above
            else:
                guess = diagonal
        previous[i] = np.uint8((int(line[i]) + guess) & 255)
