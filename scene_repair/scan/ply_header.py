"""The header of a PLY file: which elements it promises."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...formats.core.errors import FileFormatError

MAX_HEADER_BYTES = 1 << 16
SIZES = {
    "char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2,
    "uint16": 2, "int": 4, "uint": 4, "int32": 4, "uint32": 4, "float": 4, "float32": 4,
    "double": 8, "float64": 8,
}  # fmt: skip


@dataclass(frozen=True)
class PlyElement:
    """One kind of rows: how many, and at least how many bytes each takes."""

    name: str
    count: int
    least_bytes: int
    properties: tuple[str, ...]


def read_header(path: Path) -> list[PlyElement]:
    """The elements that the file promises, after looking that it is long enough for them.

    Raises:
        FileFormatError: no PLY header, or it promises more than the file can hold.
    """
    with path.open("rb") as stream:
        start = stream.read(MAX_HEADER_BYTES)
    head, end, _ = start.partition(b"end_header")
    if not start.startswith(b"ply") or not end:
        raise FileFormatError(path, "has no PLY header")
    lines = [line.split() for line in head.decode("latin-1").splitlines()]
    binary = any(line[:2] == ["format", "binary_little_endian"] for line in lines) or any(
        line[:2] == ["format", "binary_big_endian"] for line in lines
    )
    found: list[PlyElement] = []
    try:
        for line in lines:
            if line[:1] == ["element"]:
                found.append(PlyElement(line[1], int(line[2]), 0, ()))
            elif line[:1] == ["property"] and found:
                last = found.pop()
                # A list takes at least its count; text at least a digit and a blank.
                size = SIZES[line[2] if line[1] == "list" else line[1]] if binary else 2
                properties = (*last.properties, line[-1])
                found.append(PlyElement(last.name, last.count, last.least_bytes + size, properties))
    except (IndexError, ValueError, KeyError) as error:
        raise FileFormatError(path, f"damaged PLY header: {error!r}") from error
    body = path.stat().st_size - len(head) - len(end)
    for element in found:
        if element.count < 0 or element.count * max(element.least_bytes, 1) > body:
            raise FileFormatError(
                path, f"promises {element.count:,} × {element.name} in {body:,} bytes"
            )
    return found


def has_faces(path: Path) -> bool:
    """Whether the file promises faces (or triangle strips), or nothing at all.

    Raises:
        FileFormatError: no PLY header, or it promises more than the file can hold.
    """
    counts = {element.name: element.count for element in read_header(path)}
    return counts.get("face", 0) > 0 or counts.get("tristrips", 0) > 0 or not counts.get("vertex")


def splat_kind(path: Path) -> str:
    """Return which kind of Gaussian splats the file holds, empty if it holds none.

    Raises:
        FileFormatError: no PLY header, or it promises more than the file can hold.
    """
    properties = {name for element in read_header(path) for name in element.properties}
    if {"packed_position", "packed_scale"} <= properties:
        return "compressed PLY, as SuperSplat writes it"
    if {"f_dc_0", "opacity", "scale_0", "rot_0"} <= properties:
        return "PLY of 3D Gaussian splatting"
    return ""
