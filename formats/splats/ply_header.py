"""The header of a PLY file, and its binary rows."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.errors import FileFormatError
from ..untrusted.files import check_input, open_input, read_start

MAX_HEADER_BYTES = 1 << 16
BINARY = ("binary_little_endian", "binary_big_endian")
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
        least_bytes: the fewest bytes of a row.
    """

    name: str
    count: int
    row: np.dtype | None
    offset: int
    properties: tuple[str, ...]
    least_bytes: int


@dataclass(frozen=True)
class PlyHeader:
    """A parsed header: `format` (ascii, binary_little_endian, …) and elements by name."""

    format: str
    elements: dict[str, PlyElement]
    comments: tuple[str, ...]

    def count(self, name: str) -> int:
        """Return the number of rows of an element; 0 if there is no such element."""
        return self.elements[name].count if name in self.elements else 0


def read_ply_header(path: Path) -> PlyHeader:
    """Parse the header of a PLY file."""
    start = read_start(path, MAX_HEADER_BYTES)
    end = start.find(b"end_header")
    line_end = start.find(b"\n", end)
    if not start.startswith(b"ply") or end < 0 or line_end < 0:
        raise FileFormatError(path, "has no PLY header")
    kind, comments = "", []
    # Name, count, and of each property its name, type (empty for lists) and least bytes.
    tables: list[tuple[str, int, list[tuple[str, str, int]]]] = []
    try:
        for line in start[:end].decode("latin-1").splitlines():
            words = line.split()
            if words[:1] == ["format"]:
                kind = words[1]
            elif words[:1] == ["comment"]:
                comments.append(line.partition("comment")[2].strip())
            elif words[:1] == ["element"]:
                tables.append((words[1], int(words[2]), []))
            elif words[:1] == ["property"] and tables:
                listed = words[1] == "list"
                # A list takes at least its count; text at least a digit and a blank.
                code = TYPES[words[2 if listed else 1]]
                least = int(code[1]) if kind in BINARY else 2
                tables[-1][2].append((words[-1], "" if listed else code, least))
    except (IndexError, ValueError, KeyError) as error:
        raise FileFormatError(path, f"damaged PLY header: {error!r}") from error
    order = ">" if kind == "binary_big_endian" else "<"
    elements: dict[str, PlyElement] = {}
    offset, body = line_end + 1, check_input(path) - (end + len(b"end_header"))
    for name, count, fields in tables:
        names = tuple(field for field, _, _ in fields)
        least = sum(size for _, _, size in fields)
        if name in elements or count < 0 or count * max(least, 1) > body:
            raise FileFormatError(path, f"declares {count:,} × {name} in {body:,} bytes")
        row = None
        if len(set(names)) == len(names) and all(code for _, code, _ in fields):
            row = np.dtype([(field, order + code) for field, code, _ in fields])
        elements[name] = PlyElement(name, count, row, offset, names, least)
        offset = -1 if row is None or offset < 0 else offset + count * row.itemsize
    return PlyHeader(kind, elements, tuple(comments))


def ply_rows(path: Path, header: PlyHeader, name: str) -> np.ndarray:
    """Return the rows of an element, mapped from the file."""
    element = header.elements[name]
    if header.format not in BINARY:
        raise FileFormatError(
            path, f"splats in PLY format {header.format!r}; valid: {', '.join(BINARY)}"
        )
    if element.row is None or element.offset < 0:
        raise FileFormatError(path, f"its element {name} holds or follows lists, unlike splats")
    body = check_input(path) - element.offset
    if element.count * element.row.itemsize > body:
        raise FileFormatError(path, f"declares {element.count:,} × {name} in {body:,} bytes")
    if not element.count:
        return np.zeros(0, element.row)
    with open_input(path) as stream:
        return np.memmap(stream, element.row, "r", element.offset, (element.count,))
