"""Check the headers of mesh and point cloud files before a library relies on them."""

import struct
from collections.abc import Callable
from pathlib import Path

from ...formats.core.errors import FileFormatError
from ...formats.splats.ply_header import read_ply_header
from ...formats.untrusted.files import check_input, open_input, read_start

MAX_PCD_HEADER_BYTES = 1 << 14
MAX_POINTS = 200_000_000
KINDS = ("ascii", "binary", "binary_compressed")
STL_HEADER, STL_TRIANGLE = 84, 50
MAX_GROUPS = 50_000
OFF_HEADER = 65_536
MAX_TRIANGLES = 20_000_000
BLOCK = 8 << 20


def has_faces(path: Path) -> bool:
    """Return whether a PLY file declares faces or triangle strips, or no vertices either."""
    header = read_ply_header(path)
    return header.count("face") > 0 or header.count("tristrips") > 0 or not header.count("vertex")


def check_pcd(path: Path) -> None:
    """Raise FileFormatError if a PCD file has no coordinates, or fewer points than it declares."""
    start = read_start(path, MAX_PCD_HEADER_BYTES)
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
    body = check_input(path) - at
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
    """Raise FileFormatError if a PLY file declares more than it can contain."""
    faces = read_ply_header(path).count("face")
    if faces > MAX_TRIANGLES:
        raise FileFormatError(path, f"declares {faces:,} faces; valid: up to {MAX_TRIANGLES:,}")


def check_stl(path: Path) -> None:
    """Raise FileFormatError if the count of a binary STL file does not fit its length."""
    size, start = check_input(path), read_start(path, STL_HEADER)
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
    """Raise FileFormatError if an OBJ file has very many groups, which are read one by one."""
    groups = 0
    last = b"\n"
    with open_input(path) as stream:
        while block := stream.read(BLOCK):
            joined = last + block
            groups += sum(joined.count(key) for key in (b"\no ", b"\ng ", b"\nusemtl "))
            last = joined[-8:] if b"\n" not in joined[-8:] else joined[joined.rindex(b"\n") :]
    if groups > MAX_GROUPS:
        raise FileFormatError(
            path, f"contains {groups:,} groups; valid: up to {MAX_GROUPS:,} (join them first)"
        )


def check_off(path: Path) -> None:
    """Raise FileFormatError if an OFF file declares more than it can contain."""
    lines = read_start(path, OFF_HEADER).splitlines()
    # Comments may stand between the signature and the numbers, and have numbers in them.
    words = [word for line in lines for word in line.partition(b"#")[0].split()]
    numbers = [w for w in words[:4] if w.isdigit()]
    size = check_input(path)
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
