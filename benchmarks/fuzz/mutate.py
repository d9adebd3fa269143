"""Change a file a little: bytes, words and numbers, JSON values, pieces of another file."""

import json
import re
import struct
from typing import Any

import numpy as np

NUMBERS = (-1, 0, 1, 2, 3, 7, 63, 255, 65535, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1)
WORDS = (
    b"nan", b"inf", b"-1", b"0", b"1", b"4294967295", b"99999999999999999999", b"1e400", b"-0.0",
    b"", b"x", b"../a", b"/etc/passwd", b"[", b"]", b"{", b"}", b"null", b"true", b'"', b"\0",
    b"\\", b"\xff", b"*a", b"&a", b"{0.__class__}", b"\n", b" ", b"<a>", b"9" * 400, b"[" * 300,
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    *NUMBERS, None, True, False, "", "x", "../a", [], {}, [0], {"index": 0}, 0.5, 1e308, -1e308,
    float("nan"), float("inf"), 10**400, [[[[0]]]], "x" * 5000,
)  # fmt: skip
_WORD = re.compile(rb"-?\d[\d.e+-]*|[A-Za-z_:./]+")


def mutated(data: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    """Return a changed copy; `others` are files to take pieces from."""
    for _ in range(1 + int(rng.geometric(0.5))):
        kind = rng.random()
        if kind < 0.35:
            data = _words(data, rng)
        elif kind < 0.55:
            data = _json(data, rng)
        else:
            data = _bytes(data, others, rng)
    return data


def _pick[T](items: tuple[T, ...] | list[T], rng: np.random.Generator) -> T:
    return items[int(rng.integers(len(items)))]


def _bytes(data: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    if not data:
        return bytes(rng.integers(0, 256, 8, dtype=np.uint8))
    # Headers are at the start.
    far = len(data) if rng.random() < 0.5 else min(len(data), 200)
    at = int(rng.integers(far))
    length = int(min(rng.geometric(0.05), len(data) - at))
    kind = int(rng.integers(7))
    if kind == 0:
        return data[:at] + bytes(rng.integers(0, 256, length, dtype=np.uint8)) + data[at + length :]
    if kind == 1:
        return data[:at] + bytes([data[at] ^ (1 << int(rng.integers(8)))]) + data[at + 1 :]
    if kind == 2:
        order, form = _pick(("<", ">"), rng), _pick(("B", "H", "I", "Q"), rng)
        size = struct.calcsize(form)
        number = struct.pack(order + form, _pick(NUMBERS, rng) % (1 << 8 * size))
        return data[:at] + number + data[at + size :]
    if kind == 3:
        return data[:at] + data[at + length :]
    if kind == 4:
        return data[: at + length] + data[at : at + length] * int(rng.integers(1, 20)) + data[at:]
    if kind == 5:
        return data[:at]
    other = _pick(others, rng)
    cut = int(rng.integers(len(other))) if other else 0
    return data[:at] + other[cut : cut + 200] + data[at:]


def _words(data: bytes, rng: np.random.Generator) -> bytes:
    found = list(_WORD.finditer(data[:20_000]))
    if not found:
        return data
    hit = _pick(found, rng)
    word = _pick(WORDS, rng) if rng.random() < 0.7 else _pick(found, rng)[0]
    return data[: hit.start()] + word + data[hit.end() :]


def _json(data: bytes, rng: np.random.Generator) -> bytes:
    """Change a value of a JSON document, or of the first line or chunk that is one."""
    start = data.find(b"{")
    if start < 0:
        return data
    text = data[start:].decode("latin-1")
    try:
        tree, length = json.JSONDecoder().raw_decode(text)
    except (ValueError, RecursionError):
        return data
    places: list[tuple[Any, Any]] = []

    def collect(at: Any, depth: int) -> None:
        if depth > 30:
            return
        pairs = (
            at.items() if isinstance(at, dict) else enumerate(at) if isinstance(at, list) else ()
        )
        for key, value in pairs:
            places.append((at, key))
            collect(value, depth + 1)

    collect(tree, 0)
    if not places:
        return data
    home, key = _pick(places, rng)
    if isinstance(home, dict) and rng.random() < 0.2:
        del home[key]
    else:
        home[key] = _pick(VALUES, rng)
    try:
        new = json.dumps(tree).encode("latin-1", "replace")
    except ValueError:
        return data
    head, tail = data[:start], data[start + length :]
    if head[:4] == b"glTF" and start == 20:
        new += b" " * (-len(new) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 20 + len(new) + len(tail))
        head += struct.pack("<I4s", len(new), b"JSON")
    return head + new + tail
