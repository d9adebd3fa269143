"""Looking at plain mesh files before a library believes their headers."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

from ...formats.core.errors import FileFormatError
from .ply_header import read_header

STL_HEADER, STL_TRIANGLE = 84, 50
MAX_GROUPS = 50_000
OFF_HEADER = 65_536
MAX_TRIANGLES = 20_000_000
BLOCK = 8 << 20


def check_ply(path: Path) -> None:
    """Refuse a PLY file that promises more than it can hold, or only strips.

    Raises:
        FileFormatError: names what is wrong.
    """
    counts = {element.name: element.count for element in read_header(path)}
    if counts.get("face", 0) > MAX_TRIANGLES:
        raise FileFormatError(path, f"promises {counts['face']:,} faces; valid: {MAX_TRIANGLES:,}")


def check_stl(path: Path) -> None:
    """Refuse a binary STL file whose count does not fit its length.

    Raises:
        FileFormatError: names what is wrong.
    """
    size = path.stat().st_size
    with path.open("rb") as stream:
        start = stream.read(STL_HEADER)
    if len(start) < 15:
        raise FileFormatError(path, f"is no STL file: {size} bytes")
    if start.lstrip().lower().startswith(b"solid") and b"\0" not in start:
        return
    if len(start) < STL_HEADER:
        raise FileFormatError(path, f"is no STL file: {size} bytes")
    (count,) = struct.unpack_from("<I", start, 80)
    if count > MAX_TRIANGLES or STL_HEADER + STL_TRIANGLE * count > size:
        raise FileFormatError(path, f"promises {count:,} triangles in {size:,} bytes")


def check_obj(path: Path) -> None:
    """Refuse an OBJ file that consists of very many objects, which would be read one by one.

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
            path, f"holds {groups:,} groups; valid: up to {MAX_GROUPS:,} (join them first)"
        )


def check_off(path: Path) -> None:
    """Refuse an OFF file that promises more than it can hold.

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
            f"promises {numbers[0].decode()} points and {numbers[1].decode()} faces in "
            f"{size:,} bytes",
        )


CHECKS: dict[str, Callable[[Path], None]] = {
    ".ply": check_ply,
    ".stl": check_stl,
    ".obj": check_obj,
    ".off": check_off,
}
