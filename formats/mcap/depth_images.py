"""Depth as Foxglove shows it, and back to the codes that datasets hold, without loss.

16-bit millimetres (16UC1) wherever each code of the range gets millimetres of its own, which holds
from a far limit of 8 m on; nearer ranges are finer than a millimetre and take metres (32FC1).
"""

import functools

import numpy as np

from ..core.arrays import U16
from ..core.camera import DepthRange
from ..video.depth_codes import (
    MAX_CODE,
    MAX_MILLIMETRES_M,
    NO_CODE,
    codes_to_depth,
    codes_to_millimetres,
    millimetres_to_codes,
)

MILLIMETRES, METRES = "16UC1", "32FC1"
_BYTES = {MILLIMETRES: 2, METRES: 4}
_CODES = np.arange(MAX_CODE + 1, dtype=np.uint16)


@functools.cache
def depth_encoding(depth_range: DepthRange) -> tuple[str, int]:
    """Return Foxglove's name of the encoding for a range, and its bytes per pixel.

    Raises:
        ValueError: the range does not fit into 16 bits of millimetres.
    """
    if depth_range.far_m > MAX_MILLIMETRES_M:
        raise ValueError(f"far limit {depth_range.far_m} m; valid: up to {MAX_MILLIMETRES_M} m")
    millimetres = codes_to_millimetres(_CODES, depth_range)
    encoding = MILLIMETRES if np.all(np.diff(millimetres.astype(int)) > 0) else METRES
    return encoding, _BYTES[encoding]


def encode_depth(codes: U16, depth_range: DepthRange) -> bytes:
    """Return the pixels of a depth image (H, W) in the range's encoding, row by row."""
    if depth_encoding(depth_range)[0] == MILLIMETRES:
        return codes_to_millimetres(codes, depth_range).astype("<u2").tobytes()
    return codes_to_depth(codes, depth_range).astype("<f4").tobytes()


def decode_depth(data: bytes, encoding: str, depth_range: DepthRange) -> U16:
    """Return the codes (H · W,) of the pixels that `encode_depth` made.

    Raises:
        ValueError: another encoding, or a depth that no code of the range stands for.
    """
    if encoding == MILLIMETRES:
        return millimetres_to_codes(np.frombuffer(data, "<u2"), depth_range)
    if encoding == METRES:
        table, depth = codes_to_depth(_CODES, depth_range), np.frombuffer(data, "<f4")
        codes = np.searchsorted(table, depth).clip(0, MAX_CODE).astype(np.int32)
        codes[table[codes] != depth] = NO_CODE
    else:
        raise ValueError(f"depth encoding {encoding!r}; valid: {', '.join(_BYTES)}")
    if np.any(codes == NO_CODE):
        raise ValueError(f"depths that a video of 0 to {depth_range.far_m} m cannot hold")
    return codes.astype(np.uint16)
