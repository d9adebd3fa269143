"""Lines of journals: JSON with a checksum; a kill cuts the last one short at most."""

import json
import zlib
from typing import Any


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
