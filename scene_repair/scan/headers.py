"""Check the headers of mesh and point cloud files before a library relies on them."""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ...formats.core.errors import FileFormatError

MAX_PLY_HEADER_BYTES = 1 << 16
SIZES = {
    "char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2,
    "uint16": 2, "int": 4, "uint": 4, "int32": 4, "uint32": 4, "float": 4, "float32": 4,
    "double": 8, "float64": 8,
}  # fmt: skip
MAX_PCD_HEADER_BYTES = 1 << 14
MAX_POINTS = 200_000_000
KINDS = ("ascii", "binary", "binary_compressed")
STL_HEADER, STL_TRIANGLE = 84, 50
MAX_GROUPS = 50_000
OFF_HEADER = 65_536
MAX_TRIANGLES = 20_000_000
BLOCK = 8 << 20


@dataclass(frozen=True)
class PlyElement:
    """One PLY element: its number of rows, and the least number of bytes of each."""

    name: str
    count: int
    least_bytes: int
    properties: tuple[str, ...]


def read_header(path: Path) -> list[PlyElement]:
    """Return the elements that a PLY file declares, and check that it is long enough for them.

    Raises:
        FileFormatError: no PLY header, or it promises more than the file can hold.
    """
    with path.open("rb") as stream:
        start = stream.read(MAX_PLY_HEADER_BYTES)
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
                path, f"declares {element.count:,} × {element.name} in {body:,} bytes"
            )
    return found


def has_faces(path: Path) -> bool:
    """Return whether a PLY file declares faces or triangle strips, or no vertices either.

    Raises:
        FileFormatError: no PLY header, or it promises more than the file can hold.
    """
    counts = {element.name: element.count for element in read_header(path)}
    return counts.get("face", 0) > 0 or counts.get("tristrips", 0) > 0 or not counts.get("vertex")


def check_pcd(path: Path) -> None:
    """Check the header of a PCD file.

    Raises:
        FileFormatError: no PCD header, no coordinates, or more points than the file can hold.
    """
    with path.open("rb") as stream:
        start = stream.read(MAX_PCD_HEADER_BYTES)
    facts: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in facts:
        end = start.find(b"\n", at)
        if end < 0:
            raise FileFormatError(path, "has no PCD header")
        words = start[at:end].decode("latin-1").split()
        at = end + 1
        if words and not words[0].startswith("#"):
            facts[words[0]] = words[1:]
    try:
        fields, kind = facts["FIELDS"], facts["DATA"][0]
        sizes = [int(v) for v in facts["SIZE"]]
        counts = [int(v) for v in facts.get("COUNT", ["1"] * len(fields))]
        grid = int(facts["WIDTH"][0]) * int(facts["HEIGHT"][0])
        points = int(facts["POINTS"][0]) if "POINTS" in facts else grid
    except (KeyError, IndexError, ValueError) as error:
        raise FileFormatError(path, f"damaged PCD header: {error!r}") from error
    if not {"x", "y", "z"} <= set(fields):
        raise FileFormatError(path, f"has fields {' '.join(fields)}; needed: x y z")
    if kind not in KINDS:
        raise FileFormatError(path, f"unknown PCD data {kind!r}; valid: {', '.join(KINDS)}")
    if not len(fields) == len(sizes) == len(counts) == len(facts.get("TYPE", [])):
        raise FileFormatError(path, "damaged PCD header: FIELDS, SIZE, TYPE and COUNT disagree")
    if any(s not in (1, 2, 4, 8) for s in sizes) or any(not 1 <= c <= 4096 for c in counts):
        raise FileFormatError(path, "damaged PCD header: impossible SIZE or COUNT")
    if not 0 <= points <= MAX_POINTS or grid != points:
        raise FileFormatError(path, f"declares {points:,} points, but {grid:,} by width and height")
    body = path.stat().st_size - at
    row = sum(s * c for s, c in zip(sizes, counts, strict=True))
    needed = {"ascii": 2 * len(fields), "binary": row}.get(kind, 0) * points
    if kind == "binary_compressed":
        packed, unpacked = struct.unpack("<II", (start[at : at + 8] + b"\0" * 8)[:8])
        if unpacked != row * points:
            raise FileFormatError(
                path, f"unpacks to {unpacked:,} bytes instead of the declared {row * points:,}"
            )
        needed = packed + 8
    if needed > body:
        raise FileFormatError(path, f"declares {points:,} points in {body:,} bytes")


def check_ply(path: Path) -> None:
    """Refuse a PLY file that declares more than it can contain.

    Raises:
        FileFormatError: names what is wrong.
    """
    counts = {element.name: element.count for element in read_header(path)}
    if counts.get("face", 0) > MAX_TRIANGLES:
        raise FileFormatError(
            path, f"declares {counts['face']:,} faces; valid: up to {MAX_TRIANGLES:,}"
        )


def check_stl(path: Path) -> None:
    """Refuse a binary STL file whose count does not fit its length.

    Raises:
        FileFormatError: names what is wrong.
    """
    size = path.stat().st_size
    with path.open("rb") as stream:
        start = stream.read(STL_HEADER)
    if len(start) < 15:
        raise FileFormatError(path, f"is not an STL file: it has {size} bytes")
    if start.lstrip().lower().startswith(b"solid") and b"\0" not in start:
        return
    if len(start) < STL_HEADER:
        raise FileFormatError(path, f"is not an STL file: it has {size} bytes")
    (count,) = struct.unpack_from("<I", start, 80)
    if count > MAX_TRIANGLES or STL_HEADER + STL_TRIANGLE * count > size:
        raise FileFormatError(path, f"declares {count:,} triangles in {size:,} bytes")


def check_obj(path: Path) -> None:
    """Refuse an OBJ file of very many groups, which would be read one by one.

    Raises:
        FileFormatError: names what is wrong.
    """
    groups = 0
    last = b"\n"
    with path.open("rb") as stream:
        while block := stream.read(BLOCK):
            joined = last + block
            groups += sum(joined.count(key) for key in (b"\no ", b"\ng ", b"\nusemtl "))
            last = joined[-8:] if b"\n" not in joined[-8:] else joined[joined.rindex(b"\n") :]
    if groups > MAX_GROUPS:
        raise FileFormatError(
            path, f"contains {groups:,} groups; valid: up to {MAX_GROUPS:,} (join them first)"
        )


def check_off(path: Path) -> None:
    """Refuse an OFF file that declares more than it can contain.

    Raises:
        FileFormatError: names what is wrong.
    """
    with path.open("rb") as stream:
        lines = stream.read(OFF_HEADER).splitlines()
    # Comments may stand between the signature and the numbers, and have numbers in them.
    words = [word for line in lines for word in line.partition(b"#")[0].split()]
    numbers = [w for w in words[:4] if w.isdigit()]
    size = path.stat().st_size
    if len(numbers) >= 2 and 4 * (int(numbers[0]) + int(numbers[1])) > size:
        raise FileFormatError(
            path,
            f"declares {numbers[0].decode()} points and {numbers[1].decode()} faces in "
            f"{size:,} bytes",
        )


CHECKS: dict[str, Callable[[Path], None]] = {
    ".ply": check_ply,
    ".stl": check_stl,
    ".obj": check_obj,
    ".off": check_off,
}
