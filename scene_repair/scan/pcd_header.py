"""The header of a PCD file, and whether the file is long enough for what it promises."""

from __future__ import annotations

import struct
from pathlib import Path

from ...formats.core.errors import FileFormatError

MAX_HEADER_BYTES = 1 << 14
MAX_POINTS = 200_000_000
KINDS = ("ascii", "binary", "binary_compressed")


def check_pcd(path: Path) -> None:
    """Look at the header before a library believes it.

    Raises:
        FileFormatError: no PCD header, no coordinates, or more points than the file can hold.
    """
    with path.open("rb") as stream:
        start = stream.read(MAX_HEADER_BYTES)
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
        points = int(facts["POINTS"][0]) if "POINTS" in facts else -1
        grid = int(facts["WIDTH"][0]) * int(facts["HEIGHT"][0])
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
    points = grid if points < 0 else points
    if not 0 <= points <= MAX_POINTS or grid != points:
        raise FileFormatError(path, f"promises {points:,} points, {grid:,} by width and height")
    body = path.stat().st_size - at
    row = sum(s * c for s, c in zip(sizes, counts, strict=True))
    needed = {"ascii": 2 * len(fields), "binary": row}.get(kind, 0) * points
    if kind == "binary_compressed":
        packed, unpacked = struct.unpack("<II", (start[at : at + 8] + b"\0" * 8)[:8])
        if unpacked != row * points:
            raise FileFormatError(path, f"unpacks to {unpacked:,} bytes, {row * points:,} promised")
        needed = packed + 8
    if needed > body:
        raise FileFormatError(path, f"promises {points:,} points in {body:,} bytes")
