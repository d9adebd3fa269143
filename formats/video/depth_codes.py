"""Metric depth as 12-bit logarithmic codes, LeRobot 0.6.1's depth quantisation.

LeRobot maps d in [depth_min, depth_max] to rint(4095 (ln(d + s) − ln(depth_min + s)) /
(ln(depth_max + s) − ln(depth_min + s))) with the shift s = 3.5 m, which BEHAVIOR-1K introduced.
It knows no invalid depth: with its default depth_min of 0.01 m a 0 reads back as 0.01 m. We set
depth_min = 0, so that code 0 means exactly 0 m, which we keep for invalid; a valid reading always
gets a code ≥ 1. With a far limit of 20 m a step is 1.6 mm at 0 m, 2.1 mm at 1 m and 11 mm at 20 m.
"""

import functools
import math

import cv2
import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import F32, I32, U16
from ..core.camera import DepthRange

DEPTH_PIXEL_FORMAT = "gray12le"
MILLIMETRE_PIXEL_FORMAT = "gray16le"  # of a video of `depth_images`
MAX_CODE = 4095
SHIFT_M = 3.5
MAX_MILLIMETRES_M = 65.535
NO_CODE = -1
# For writing depths again that a video gave: rounding may have put some below its near limit.
ANY_NEAR_M = 1e-6


def depth_to_codes(depth_m: ArrayLike, depth_range: DepthRange) -> U16:
    """Convert depth (...) [m] to codes (...) uint16 in 0 … 4095.

    0 stands for invalid: not finite, or outside `depth_range`.
    """
    depth = np.asarray(depth_m, dtype=np.float32)
    # NaN compares false.
    valid = (depth >= np.float32(depth_range.near_m)) & (depth <= np.float32(depth_range.far_m))
    log_min, log_max = _log_limits(depth_range)
    # In place: at this size new arrays cost more than arithmetic. Divided before it is multiplied,
    # in LeRobot's order, so that single-precision roundings agree.
    work = np.where(valid, depth, np.float32(0))
    work += np.float32(SHIFT_M)
    np.log(work, out=work)
    work -= np.float32(log_min)
    work /= np.float32(log_max - log_min)
    work *= np.float32(MAX_CODE)
    np.rint(work, out=work)
    np.clip(work, 1, MAX_CODE, out=work)
    codes = work.astype(np.uint16)
    codes *= valid
    return codes


def codes_to_depth(codes: U16, depth_range: DepthRange) -> F32:
    """Convert codes (...) to depth (...) float32 [m], 0 = invalid; as LeRobot does except code 0.

    LeRobot's own reader gives below 1e-6 m for code 0.
    """
    return _depth_table(depth_range)[codes]


def codes_to_millimetres(codes: U16, depth_range: DepthRange) -> U16:
    """Convert codes (...) to whole millimetres (...) uint16, 0 = invalid.

    Raises:
        ValueError: the range does not fit into 16 bits.
    """
    return _millimetre_table(depth_range)[codes]


def millimetres_to_codes(millimetres: U16, depth_range: DepthRange) -> U16:
    """Return the codes (...) of what `codes_to_millimetres` made of them.

    Raises:
        ValueError: a depth that no code of the range stands for.
    """
    codes = _codes_of_millimetres(depth_range)[millimetres]
    if np.any(codes == NO_CODE):
        raise ValueError(f"depths that a video of 0 to {depth_range.far_m} m cannot hold")
    return codes.astype(np.uint16)


@functools.cache
def _codes_of_millimetres(depth_range: DepthRange) -> I32:
    table = np.full(1 << 16, NO_CODE, dtype=np.int32)
    codes = np.arange(MAX_CODE + 1, dtype=np.uint16)
    table[codes_to_millimetres(codes, depth_range)] = codes
    return table


@functools.cache
def _depth_table(depth_range: DepthRange) -> F32:
    log_min, log_max = _log_limits(depth_range)
    table = np.arange(MAX_CODE + 1, dtype=np.float32)
    table = np.exp(table * np.float32((log_max - log_min) / MAX_CODE) + np.float32(log_min))
    table = np.clip(table - np.float32(SHIFT_M), 0.0, np.float32(depth_range.far_m))
    table[0] = 0.0
    return table


@functools.cache
def _millimetre_table(depth_range: DepthRange) -> U16:
    if depth_range.far_m > MAX_MILLIMETRES_M:
        raise ValueError(f"far limit {depth_range.far_m} m; valid: up to {MAX_MILLIMETRES_M} m")
    return np.rint(_depth_table(depth_range) * 1000.0).astype(np.uint16)


def _log_limits(depth_range: DepthRange) -> tuple[float, float]:
    if not 0.0 < depth_range.near_m < depth_range.far_m:
        raise ValueError(f"{depth_range}; valid: 0 < near_m < far_m")
    return math.log(SHIFT_M), math.log(depth_range.far_m + SHIFT_M)


# LZW over horizontal differences: a quarter of the bytes, as fast to read as it is to decompress.
_LZW, _DIFFERENCES = 5, 2
_OPTIONS = [cv2.IMWRITE_TIFF_COMPRESSION, _LZW, cv2.IMWRITE_TIFF_PREDICTOR, _DIFFERENCES]


def encode_depth_tiff(depth_mm: U16) -> bytes:
    """Encode (H, W) uint16 [mm], 0 = invalid, without loss."""
    done, data = cv2.imencode(".tiff", np.ascontiguousarray(depth_mm), _OPTIONS)
    if not done:
        raise ValueError(f"cannot encode depth of shape {depth_mm.shape} {depth_mm.dtype}")
    return data.tobytes()


def decode_depth_tiff(data: bytes) -> U16:
    """Decode what `encode_depth_tiff` returned.

    Raises:
        ValueError: not such an image.
    """
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    if image is None or image.dtype != np.uint16 or image.ndim != 2:
        raise ValueError("not a 16-bit depth image")
    return np.asarray(image, np.uint16)
