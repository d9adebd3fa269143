"""The manifest's JSON with its own SHA-256, and the journal's lines with their checksums."""

import hashlib
import json
import zlib
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


def journal_line(value: Any) -> bytes:
    """Return a line of the journal: JSON and its CRC-32."""
    text = json.dumps(value, allow_nan=False).encode()
    return b"%s\t%08x\n" % (text, zlib.crc32(text))


def parse_journal_line(line: bytes) -> dict[str, Any]:
    """Return a line of the journal; lines of older versions have no checksum.

    Raises:
        ValueError: If it is damaged or cut short.
    """
    text, separator, checksum = line.rpartition(b"\t")
    if separator and int(checksum, 16) != zlib.crc32(text):
        raise ValueError("checksum")
    return json.loads(text if separator else line)
