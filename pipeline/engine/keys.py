"""Digests that tell whether a work item must run again."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

PACKAGE_ROOT = Path(__file__).resolve().parents[2]
CODE_SUFFIXES = {".py", ".xml", ".onnx", ".json"}


def digest(*parts: Any) -> str:
    """SHA-256 hex of any nesting of dataclasses, mappings, sequences, paths and JSON values."""
    text = json.dumps([_plain(p) for p in parts], sort_keys=True, allow_nan=True)
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def code_version(*places: str) -> str:
    """SHA-256 hex of the source, models and policies in some files or folders of the package.

    For provenance; keys use `formats.core.source`.

    Args:
        places: relative to the package, e.g. `formats` or `collectors/replay.py`.

    Raises:
        FileNotFoundError: a place does not exist (it was renamed, and the key would go blind).
    """
    state = hashlib.sha256()
    for place in places:
        root = PACKAGE_ROOT / place
        if not root.exists():
            raise FileNotFoundError(root)
        for path in [root] if root.is_file() else sorted(root.rglob("*")):
            if path.suffix in CODE_SUFFIXES and path.is_file():
                state.update(path.relative_to(PACKAGE_ROOT).as_posix().encode())
                state.update(path.read_bytes())
    return state.hexdigest()


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {"__type__": type(value).__qualname__, **fields}
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    return value
