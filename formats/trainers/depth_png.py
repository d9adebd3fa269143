"""Depth images as PNG files of 16 bits."""

import struct
import zlib
from pathlib import Path

import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray

_UP = 2  # filter of PNG: each byte less the one above it
_HEAD = struct.Struct(">IIBBBBB")


def write_png(path: Path, depth: NDArray[np.uint16]) -> None:
    """Write an image (H, W).

    On depth of rendered rooms this takes a sixth of the time of OpenCV's fastest encoder, for a
    tenth to a third more bytes.
    """
    height, width = depth.shape
    big_endian = depth.byteswap().view(np.uint8)
    rows = np.empty((height, 1 + 2 * width), np.uint8)
    rows[:, 0] = _UP
    rows[0, 1:] = big_endian[0]
    np.subtract(big_endian[1:], big_endian[:-1], out=rows[1:, 1:])
    head = _HEAD.pack(width, height, 16, 0, 0, 0, 0)
    data = isal_zlib.compress(rows, 1)
    chunks = _chunk(b"IHDR", head) + _chunk(b"IDAT", data) + _chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunks)


def _chunk(name: bytes, data: bytes) -> bytes:
    named = name + data
    return struct.pack(">I", len(data)) + named + struct.pack(">I", zlib.crc32(named))
