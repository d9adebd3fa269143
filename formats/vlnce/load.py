"""Load the JSON document of a VLN-CE episode file, within limits that no honest file reaches."""

from __future__ import annotations

import gzip
import json
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import FileFormatError

_READ_BYTES = 1 << 20
_OPENING = b"[{"
_NOT_BRACKETS = bytes(set(range(256)) - set(b"[]{}"))


@dataclass(frozen=True)
class FileLimits:
    """What an episode file may cost to read. RxR's largest file stays well below all of these.

    Attributes:
        bytes: decompressed size [bytes].
        containers: lists and objects in the whole file.
        depth: nesting of lists and objects.
        episodes: number of episodes.
    """

    bytes: int = 2 << 30
    containers: int = 60_000_000
    depth: int = 64
    episodes: int = 1_000_000


LIMITS = FileLimits()


def load_document(path: Path, limits: FileLimits = LIMITS) -> dict[str, Any]:
    """Load an episode file, gzip or plain JSON (told apart by content, not by name).

    Decompression stops at the size limit, and the brackets are counted before anything is parsed.

    Raises:
        FileFormatError: the file is missing, unreadable, broken, beyond a limit, or has no list
            of episodes.
    """
    data = _read(path, limits)
    brackets = np.frombuffer(data.translate(None, _NOT_BRACKETS), dtype=np.uint8)
    opening = np.isin(brackets, np.frombuffer(_OPENING, dtype=np.uint8))
    if int(opening.sum()) > limits.containers:
        raise FileFormatError(
            path, f"{int(opening.sum())} lists and objects; at most {limits.containers} are read"
        )
    depth = int(np.cumsum(np.where(opening, 1, -1), dtype=np.int64).max(initial=0))
    try:
        document = json.loads(data)
    except ValueError as error:  # also bad UTF-8, and integers of thousands of digits
        raise FileFormatError(path, f"not JSON: {error}") from error
    except RecursionError as error:
        raise FileFormatError(path, "not an episode file: nested too deeply") from error
    # Brackets in texts count above, so look twice before refusing.
    if depth > limits.depth and _deeper(document, limits.depth):
        raise FileFormatError(path, f"nested too deeply; at most {limits.depth} levels are read")
    if not isinstance(document, dict) or not isinstance(document.get("episodes"), list):
        raise FileFormatError(path, 'not a VLN-CE episode file: no list "episodes" at the top')
    count = len(document["episodes"])
    if count > limits.episodes:
        raise FileFormatError(path, f"{count} episodes; at most {limits.episodes} are read")
    return document


def _read(path: Path, limits: FileLimits) -> bytes:
    parts, total = [], 0
    try:
        with path.open("rb") as raw:
            zipped = raw.read(2) == b"\x1f\x8b"
            raw.seek(0)
            stream = gzip.GzipFile(fileobj=raw) if zipped else raw
            while part := stream.read(_READ_BYTES):
                total += len(part)
                if total > limits.bytes:
                    raise FileFormatError(
                        path, f"more than {limits.bytes} bytes when decompressed; refused"
                    )
                parts.append(part)
    except FileNotFoundError as error:
        raise FileFormatError(path, "no such file") from error
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise FileFormatError(path, f"broken gzip: {error}") from error
    except OSError as error:
        raise FileFormatError(path, f"cannot be read: {error.strerror}") from error
    return b"".join(parts)


def _deeper(document: Any, limit: int) -> bool:
    """Whether a JSON value nests more than `limit` lists and objects."""
    layer = [document]
    for _ in range(limit):
        layer = [
            child
            for value in layer
            for child in (value.values() if isinstance(value, dict) else value)
            if isinstance(child, dict | list)
        ]
        if not layer:
            return False
    return True
