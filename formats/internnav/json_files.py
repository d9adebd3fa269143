"""JSON and JSON lines of the VLN-PE layout's metadata, which may be damaged."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..core.errors import FileFormatError


def read_json(path: Path) -> dict[str, Any]:
    """One object.

    Raises:
        FileFormatError: missing, no JSON, or no object.
    """
    try:
        value = json.loads(path.read_text())
    except (OSError, ValueError, RecursionError) as error:
        raise FileFormatError(path, f"not readable ({error})") from error
    if not isinstance(value, dict):
        raise FileFormatError(path, "no JSON object")
    return value


def read_lines(path: Path) -> list[dict[str, Any]]:
    """One object per line.

    Raises:
        FileFormatError: missing, or a line that is no JSON object.
    """
    try:
        values = [json.loads(line) for line in path.read_text().splitlines() if line.strip()]
    except (OSError, ValueError, RecursionError) as error:
        raise FileFormatError(path, f"not readable ({error})") from error
    if not all(isinstance(value, dict) for value in values):
        raise FileFormatError(path, "a line that is no JSON object")
    return values
