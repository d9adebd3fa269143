"""GLB containers: the two chunks of a binary glTF 2.0 file.

Layout: Khronos Group, glTF 2.0 specification, section 4 (GLB File Format).
"""

import json
import struct
from pathlib import Path
from typing import Any

from .files import check_input, open_input
from .limits import limits

JSON_CHUNK, BIN_CHUNK = b"JSON", b"BIN\0"


def glb_bytes(tree: dict[str, Any], body: bytes | bytearray | memoryview) -> bytes:
    """Return a GLB file of a JSON tree and a binary chunk, which is omitted if empty."""
    text = json.dumps(tree, separators=(",", ":")).encode()
    pieces: list[bytes | bytearray | memoryview] = [_head(text, JSON_CHUNK), text]
    pieces.append(b" " * (-len(text) % 4))
    if len(body):
        pieces += [_head(body, BIN_CHUNK), body, b"\0" * (-len(body) % 4)]
    total = 12 + sum(len(piece) for piece in pieces)
    return b"".join([struct.pack("<4sII", b"glTF", 2, total), *pieces])


def _head(chunk: bytes | bytearray | memoryview, kind: bytes) -> bytes:
    return struct.pack("<I4s", len(chunk) + -len(chunk) % 4, kind)


def read_glb(path: Path) -> tuple[bytes, memoryview]:
    """Return the JSON text and the binary chunk (empty if there is none) of a GLB file.

    Raises:
        ValueError: not a GLB file of version 2, or its chunks do not fit its size.
        FileFormatError: missing, or not a regular file.
    """
    size, max_json = check_input(path), limits().json_bytes
    with open_input(path) as stream:
        start = stream.read(12)
        if len(start) < 12 or start[:4] != b"glTF":
            raise ValueError("no glTF signature")
        version = struct.unpack_from("<I", start, 4)[0]
        if version != 2:
            raise ValueError(f"container version {version}; valid: 2")
        text, body = b"", memoryview(b"")
        while head := stream.read(8):
            if len(head) < 8:
                raise ValueError("the last chunk header is cut off")
            length, kind = struct.unpack("<I4s", head)
            if length > size - stream.tell():
                raise ValueError(f"chunk of {length:,} bytes in a file of {size:,}")
            if kind == JSON_CHUNK and not text:
                if length > max_json:
                    raise ValueError(f"{length:,} bytes of JSON; valid: up to {max_json:,}")
                text = stream.read(length)
            elif kind == BIN_CHUNK and not len(body):
                body = memoryview(stream.read(length))
            else:
                stream.seek(length, 1)
    if not text:
        raise ValueError("no JSON chunk")
    return text, body
