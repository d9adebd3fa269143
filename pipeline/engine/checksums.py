"""The manifest's JSON with its own SHA-256."""

import hashlib
import json
from pathlib import Path
from typing import Any

from ...formats.core.errors import FileFormatError


def json_text(value: Any) -> bytes:
    """Return a value as indented JSON with sorted keys, for `signed`."""
    return (json.dumps(value, indent=2, sort_keys=True) + "\n").encode()


_OPEN = b"{\n"

# Members of a manifest apart from its digest.
UNSIGNED = {"files", "parts", "rows", "finished", "unfinished"}


def signed(body: bytes) -> bytes:
    """Return a JSON object, as `json_text` writes it, with a first member that is its SHA-256."""
    digest = hashlib.sha256(body).hexdigest()
    return _OPEN + f'  "sha256": "{digest}",\n'.encode() + body.removeprefix(_OPEN)


def read_signed(path: Path) -> dict[str, Any]:
    """Return the JSON object in a file that `signed` made; older files are not signed.

    Raises:
        ValueError: If it is not JSON.
    """
    raw = path.read_bytes()
    content = json.loads(raw)
    _, _, rest = raw.removeprefix(_OPEN).partition(b"\n")
    # A damaged name of the first member must not pass for a file without one.
    if raw != signed(_OPEN + rest) and not content.keys() <= UNSIGNED:
        raise FileFormatError(
            path,
            "its content does not match its own SHA-256: it was damaged or edited. Restore it "
            "from a copy, or delete its second line to use it as it is",
        )
    return content
