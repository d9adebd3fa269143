"""Read untrusted NumPy files: without pickle, and within a limit of memory."""

import io
import zipfile
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FileFormatError, brief, one_line
from .files import PARSER_ERRORS, check_input, open_input
from .limits import limits


def read_arrays(path: Path, data: bytes | None = None) -> dict[str, NDArray[Any]]:
    """Return the arrays of an .npz file, or of its content `data`, by name."""
    if data is not None:
        return _read(path, io.BytesIO(data))
    with open_input(path, max_bytes=limits().array_bytes) as stream:
        return _read(path, stream)


def map_array(path: Path, *, root: Path | None = None) -> NDArray[Any]:
    """Return the array of an .npy file, which stays on disk until it is looked at."""
    check_input(path, root=root)
    try:
        return np.load(path, mmap_mode="r", allow_pickle=False)
    except PARSER_ERRORS as error:
        raise FileFormatError(
            path, f"truncated or corrupt ({type(error).__name__}: {one_line(error)})"
        ) from error


def _read(path: Path, stream: BinaryIO) -> dict[str, NDArray[Any]]:
    cap = limits().array_bytes
    try:
        with zipfile.ZipFile(stream) as archive:
            total = sum(member.file_size for member in archive.infolist())
        if total > cap:
            raise FileFormatError(
                path, f"unpacks to {total:,} bytes; valid: up to {cap:,} (limit array_bytes)"
            )
        stream.seek(0)
        with np.load(stream, allow_pickle=False) as data:
            arrays = {key: data[key] for key in data.files}
        other = [key for key, values in arrays.items() if not isinstance(values, np.ndarray)]
        if other:
            raise ValueError(f"{brief(other[0])} is not an array")
        return arrays
    except PARSER_ERRORS as error:
        raise FileFormatError(
            path, f"damaged arrays ({type(error).__name__}: {one_line(error)})"
        ) from error
