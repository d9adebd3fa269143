"""Parse JSON and TOML from untrusted sources, within limits of size, nesting and values."""

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import FileFormatError
from .files import read_input
from .limits import limits

_BLOCK = 1 << 20
_OPENING = (ord("["), ord("{"))
_NOT_BRACKETS = bytes(set(range(256)) - set(b"[]{}"))


class DocumentScanner:
    """Counts the values and the nesting of a JSON document block by block, before it is parsed.

    Brackets and commas within texts count, too, so both numbers are upper bounds. Values are keys,
    numbers, texts, lists and objects, roughly; `path` is for errors.
    """

    def __init__(self, path: Path, max_values: int):
        self.path, self.max_values = path, max_values
        self.values = 0
        self.depth = 0
        self._open = 0

    def feed(self, block: bytes | bytearray | memoryview) -> None:
        """Count the next block, and raise FileFormatError if that makes too many values."""
        block = bytes(block)
        self.values += sum(block.count(sign) for sign in (b",", b"[", b"{"))
        if self.values > self.max_values:
            raise FileFormatError(
                self.path, f"has more than {self.max_values:,} values, which is the limit"
            )
        brackets = np.frombuffer(block.translate(None, _NOT_BRACKETS), dtype=np.uint8)
        if len(brackets):
            steps = np.where(np.isin(brackets, _OPENING), 1, -1)
            levels = self._open + np.cumsum(steps)
            self.depth = max(self.depth, int(levels.max()))
            self._open = int(levels[-1])


def parse_json(
    path: Path,
    data: bytes | bytearray,
    *,
    max_values: int | None = None,
    max_depth: int | None = None,
    scanner: DocumentScanner | None = None,
) -> Any:
    """Return the value of a JSON document in UTF-8; `path` is for errors.

    Args:
        max_values, max_depth: instead of `json_values` and `depth` of the limits.
        scanner: one that has seen all of `data`; by default it is scanned here.
    """
    max_depth = max_depth or limits().depth
    if scanner is None:
        scanner = DocumentScanner(path, max_values or limits().json_values)
        view = memoryview(data)
        for start in range(0, len(view), _BLOCK):
            scanner.feed(view[start : start + _BLOCK])
    too_deep = FileFormatError(path, f"nested too deeply; valid: up to {max_depth} levels")
    try:
        # UTF-16 and -32, which `json` would take from bytes, would not have been counted.
        value = json.loads(data.decode("utf-8-sig"))
    except ValueError as error:  # also bad UTF-8, and integers of thousands of digits
        raise FileFormatError(path, f"not JSON: {error}") from error
    except RecursionError as error:
        raise too_deep from error
    if scanner.depth > max_depth and deeper_than(value, max_depth):
        raise too_deep
    return value


def read_json(path: Path, *, root: Path | None = None) -> Any:
    """Return the value of a JSON file."""
    return parse_json(path, read_input(path, root=root, max_bytes=limits().json_bytes))


def read_json_object(path: Path, *, root: Path | None = None) -> dict[str, Any]:
    """Return the object of a JSON file."""
    value = read_json(path, root=root)
    if not isinstance(value, dict):
        raise FileFormatError(path, f"not a JSON object, but {type(value).__name__}")
    return value


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file."""
    caps = limits()
    data = read_input(path, max_bytes=caps.text_bytes)
    too_deep = FileFormatError(path, f"nested too deeply; valid: up to {caps.depth} levels")
    try:
        value = tomllib.loads(data.decode())
    except RecursionError as error:
        raise too_deep from error
    except ValueError as error:
        raise FileFormatError(path, f"not valid TOML: {error}") from error
    if deeper_than(value, caps.depth):
        raise too_deep
    return value


def deeper_than(value: Any, depth: int) -> bool:
    """Return whether a value nests more than `depth` lists and mappings."""
    layer = [value] if isinstance(value, dict | list) else []
    for _ in range(depth):
        layer = [
            child
            for inner in layer
            for child in (inner.values() if isinstance(inner, dict) else inner)
            if isinstance(child, dict | list)
        ]
        if not layer:
            return False
    return bool(layer)
