"""Two packed formats: `.splat` (antimatter15's viewer) and SPZ (Niantic, versions 1 to 4).

Layouts: the viewers' and the library's public documentation. A `.splat` file is rows of 32 bytes
without a header. SPZ holds one stream for each attribute, gzip-compressed together up to version 3,
each by Zstandard in version 4; its axes are right, up, backward.
"""

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import zstandard

from ..core.arrays import F32, U8
from ..core.errors import FileFormatError
from ..untrusted.files import check_input, read_input
from ..untrusted.limits import limits
from .harmonics import C0
from .record import GaussianCloud, check_count, cleaned

SPLAT_ROW = np.dtype(
    [("position", "<f4", 3), ("scale", "<f4", 3), ("rgba", "u1", 4), ("quat", "u1", 4)]
)
SPZ_MAGIC = 0x5053474E
SPZ_VERSIONS = (1, 2, 3, 4)
HEADER, HEADER_4 = 16, 32
ANTIALIASED = 1
# SPZ spreads colours by this factor around grey, so that bytes also hold what is brighter.
COLOR_SPREAD = 0.15
GZIP = 16 + zlib.MAX_WBITS
UP = ("y", "SPZ is y up by its documentation")


def read_dot_splat(path: Path) -> GaussianCloud:
    """Read a `.splat` file."""
    size = check_input(path)
    count, left = divmod(size, SPLAT_ROW.itemsize)
    if left:
        raise FileFormatError(
            path, f"its size of {size:,} bytes is not a multiple of {SPLAT_ROW.itemsize}"
        )
    check_count(path, count, 0)
    rows = np.frombuffer(read_input(path, max_bytes=size), SPLAT_ROW)
    color = (rows["rgba"] / 255).astype(np.float32)
    with np.errstate(invalid="ignore", over="ignore"):
        unlikely = (~np.isfinite(rows["scale"]) | (rows["scale"] <= 0)).any(1).mean()
    if unlikely > 0.5:
        raise FileFormatError(path, "is not a .splat file: most sizes are not positive numbers")
    return cleaned(
        path,
        GaussianCloud(
            position=rows["position"].copy(),
            scale=rows["scale"].copy(),
            quat_wxyz=(rows["quat"] / 128 - 1).astype(np.float32),
            opacity=color[:, 3].copy(),
            harmonics=((color[:, None, :3] - 0.5) / np.float32(C0)).astype(np.float32),
        ),
    )


def read_spz(path: Path) -> GaussianCloud:
    """Read an SPZ file."""
    return spz_cloud(path, read_input(path, max_bytes=limits().scan_bytes))


def spz_cloud(path: Path, data: bytes) -> GaussianCloud:
    """Read the bytes of an SPZ file; `path` is for messages."""
    head = spz_header(path, data)
    version, count = struct.unpack_from("<II", head, 4)
    degree, fraction_bits, flags, streams = head[12:16]
    check_count(path, count, degree)
    sizes = _stream_sizes(version, count, degree)
    if version < 4:
        body = _gunzipped(path, data, HEADER + sum(sizes))[HEADER:]
        if len(body) < sum(sizes):
            raise FileFormatError(
                path, f"declares {count:,} Gaussians, but has {len(body):,} bytes"
            )
        starts = np.cumsum([0, *sizes])
        parts = [body[a : a + n] for a, n in zip(starts, sizes, strict=False)]
    else:
        parts = _zstd_streams(path, data, streams, sizes)
    columns = [np.frombuffer(part, np.uint8).reshape(count, -1) for part in parts]
    position, alpha, rgb, scale, rotation = columns[:5]
    harmonics = np.empty((count, (degree + 1) ** 2, 3), dtype=np.float32)
    harmonics[:, 0] = (rgb / np.float32(255) - 0.5) / COLOR_SPREAD
    if degree:
        rest = columns[5].reshape(count, -1, 3)
        harmonics[:, 1:] = (rest.astype(np.float32) - 128) / 128
    return cleaned(
        path,
        GaussianCloud(
            position=_positions(position, version, fraction_bits),
            scale=np.exp(scale / 16 - 10).astype(np.float32),
            quat_wxyz=_rotations(rotation, version),
            opacity=(alpha[:, 0] / 255).astype(np.float32),
            harmonics=harmonics,
            antialiased=bool(flags & ANTIALIASED),
            up=UP,
        ),
    )


def spz_header(path: Path, data: bytes | memoryview) -> bytes:
    """Return the first bytes of an SPZ file, with its number of Gaussians, degree and flags."""
    plain = data[:4] == struct.pack("<I", SPZ_MAGIC)
    head = bytes(data[:HEADER_4]) if plain else _gunzipped(path, data, HEADER)
    if len(head) < HEADER or struct.unpack_from("<I", head)[0] != SPZ_MAGIC:
        raise FileFormatError(path, "is not an SPZ file: no signature")
    version = struct.unpack_from("<I", head, 4)[0]
    if version not in SPZ_VERSIONS or plain != (version >= 4):
        raise FileFormatError(path, f"is SPZ version {version}; valid: 1 to 4")
    return head


def _stream_sizes(version: int, count: int, degree: int) -> list[int]:
    per_splat = [6 if version == 1 else 9, 1, 3, 3, 4 if version >= 3 else 3]
    if degree:
        per_splat.append(3 * ((degree + 1) ** 2 - 1))
    return [n * count for n in per_splat]


def _positions(raw: U8, version: int, fraction_bits: int) -> F32:
    if version == 1:
        return np.ascontiguousarray(raw).view("<f2").astype(np.float32)
    wide = np.zeros((len(raw), 3, 4), dtype=np.uint8)
    wide[..., 1:] = raw.reshape(-1, 3, 3)
    # In the upper three bytes the sign is right; the shift makes up for the lowest.
    number = wide.view("<i4")[..., 0].astype(np.float64)
    return (number / 2.0 ** (8 + fraction_bits)).astype(np.float32)


def _rotations(raw: U8, version: int) -> F32:
    """Return quaternions (N, 4), wxyz; SPZ has them in the order xyzw."""
    if version < 3:
        xyz = raw.astype(np.float32) / 127.5 - 1
        w = np.sqrt(np.maximum(0, 1 - (xyz**2).sum(1)))
        return np.concatenate([w[:, None], xyz], axis=1)
    word = np.ascontiguousarray(raw).view("<u4")[:, 0]
    largest = (word >> 30).astype(np.int64)
    xyzw = np.zeros((len(word), 4))
    for place in (3, 2, 1, 0):
        stored = largest != place
        value = (word & 511) / 511 * np.sqrt(0.5) * np.where(word & 512, -1, 1)
        xyzw[stored, place] = value[stored]
        word = np.where(stored, word >> 10, word)
    rest = np.sqrt(np.maximum(0, 1 - (xyzw**2).sum(1)))
    np.put_along_axis(xyzw, largest[:, None], rest[:, None], axis=1)
    return np.roll(xyzw, 1, axis=1).astype(np.float32)


def _gunzipped(path: Path, data: bytes | memoryview, most: int) -> bytes:
    """Return up to `most` bytes of a gzip stream, never more."""
    try:
        return zlib.decompressobj(GZIP).decompress(data, most)
    except zlib.error as error:
        raise FileFormatError(path, f"is not an SPZ file, or damaged: {error}") from error


def _zstd_streams(path: Path, data: bytes, streams: int, sizes: list[int]) -> list[bytes]:
    if len(data) < HEADER_4:
        raise FileFormatError(path, f"is cut off after {len(data)} bytes")
    table = struct.unpack_from("<I", data, 16)[0]
    start = table + 16 * streams
    if streams < len(sizes) or start > len(data):
        streams_in = f"{streams} streams in {len(data):,} bytes"
        raise FileFormatError(path, f"{streams_in}; needed: {len(sizes)}")
    parts = []
    for k, size in enumerate(sizes):
        packed, unpacked = struct.unpack_from("<QQ", data, table + 16 * k)
        if unpacked != size or start + packed > len(data):
            raise FileFormatError(
                path, f"stream {k} unpacks to {unpacked:,} bytes; expected {size:,}"
            )
        source = io.BytesIO(data[start : start + packed])
        try:
            part = zstandard.ZstdDecompressor().stream_reader(source).read(size)
        except zstandard.ZstdError as error:
            raise FileFormatError(path, f"stream {k} is damaged: {error}") from error
        if len(part) < size:
            raise FileFormatError(path, f"stream {k} ends after {len(part):,} of {size:,} bytes")
        parts.append(part)
        start += packed
    return parts
