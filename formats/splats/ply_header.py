"""The header of a PLY file, and its binary rows."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.errors import FileFormatError

MAX_HEADER_BYTES = 1 << 16
TYPES = {
    "char": "i1", "uchar": "u1", "int8": "i1", "uint8": "u1", "short": "i2", "ushort": "u2",
    "int16": "i2", "uint16": "u2", "int": "i4", "uint": "u4", "int32": "i4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip


@dataclass(frozen=True)
class PlyElement:
    """One element: its number of rows, their type, and where they start in the file.

    Attributes:
        name: e.g. `vertex`.
        count: number of rows.
        row: type of a row; None if it holds lists, whose length varies.
        offset: first byte; −1 if it follows rows of varying length.
    """

    name: str
    count: int
    row: np.dtype | None
    offset: int
    properties: tuple[str, ...]


@dataclass(frozen=True)
class PlyHeader:
    """A parsed header: `format` (ascii, binary_little_endian, …) and elements by name."""

    format: str
    elements: dict[str, PlyElement]
    comments: tuple[str, ...]


def read_ply_header(path: Path) -> PlyHeader:
    """Parse the header of a PLY file.

    Raises:
        FileFormatError: no PLY header, or a damaged one.
    """
    with path.open("rb") as stream:
        start = stream.read(MAX_HEADER_BYTES)
    end = start.find(b"end_header")
    line_end = start.find(b"\n", end)
    if not start.startswith(b"ply") or end < 0 or line_end < 0:
        raise FileFormatError(path, "has no PLY header")
    kind, comments = "", []
    tables: list[tuple[str, int, list[tuple[str, str]], bool]] = []
    try:
        for line in start[:end].decode("latin-1").splitlines():
            words = line.split()
            if words[:1] == ["format"]:
                kind = words[1]
            elif words[:1] == ["comment"]:
                comments.append(line.partition("comment")[2].strip())
            elif words[:1] == ["element"]:
                tables.append((words[1], int(words[2]), [], False))
            elif words[:1] == ["property"]:
                name, count, fields, lists = tables.pop()
                if words[1] == "list":
                    tables.append((name, count, [*fields, (words[-1], "")], True))
                else:
                    tables.append((name, count, [*fields, (words[2], TYPES[words[1]])], lists))
    except (IndexError, ValueError, KeyError) as error:
        raise FileFormatError(path, f"damaged PLY header: {error!r}") from error
    order = ">" if kind == "binary_big_endian" else "<"
    elements: dict[str, PlyElement] = {}
    offset = line_end + 1
    for name, count, fields, lists in tables:
        names = tuple(field for field, _ in fields)
        if len(set(names)) < len(names) or name in elements or count < 0:
            raise FileFormatError(path, f"damaged PLY header: element {name}")
        row = None if lists else np.dtype([(field, order + code) for field, code in fields])
        elements[name] = PlyElement(name, count, row, offset, names)
        offset = -1 if row is None or offset < 0 else offset + count * row.itemsize
    return PlyHeader(kind, elements, tuple(comments))


def ply_rows(path: Path, header: PlyHeader, name: str) -> np.ndarray:
    """Return the rows of an element, mapped from the file.

    Raises:
        FileFormatError: text instead of binary, lists, or more rows than the file holds.
    """
    element = header.elements[name]
    if header.format not in ("binary_little_endian", "binary_big_endian"):
        raise FileFormatError(
            path,
            f"splats in PLY format {header.format!r}; valid: binary_little_endian, "
            "binary_big_endian",
        )
    if element.row is None or element.offset < 0:
        raise FileFormatError(path, f"its element {name} holds or follows lists, unlike splats")
    body = path.stat().st_size - element.offset
    if element.count * element.row.itemsize > body:
        raise FileFormatError(path, f"declares {element.count:,} × {name} in {body:,} bytes")
    if not element.count:
        return np.zeros(0, element.row)
    return np.memmap(path, element.row, "r", element.offset, (element.count,))
