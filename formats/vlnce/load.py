"""Load the JSON document of a VLN-CE episode file, within limits that no honest file reaches."""

import gzip
import zlib
from pathlib import Path
from typing import Any

from ..core.errors import FileFormatError
from ..untrusted.documents import DocumentScanner, parse_json
from ..untrusted.files import open_input
from ..untrusted.limits import VARIABLE, Limits, limits

_READ_BYTES = 1 << 20
# Every usable episode has it once.
_EPISODE_KEY = b'"start_rotation"'


def load_document(path: Path, caps: Limits | None = None) -> dict[str, Any]:
    """Load an episode file, gzip or plain JSON (distinguished by content, not by name).

    Size, values and episodes are counted while it is decompressed, before anything is parsed.
    """
    caps = caps or limits()
    document = load_json(path, caps)
    if not isinstance(document, dict) or not isinstance(document.get("episodes"), list):
        raise FileFormatError(path, 'not a VLN-CE episode file: no list "episodes" at the top')
    if len(document["episodes"]) > caps.vlnce_episodes:
        raise _too_many(path, caps.vlnce_episodes)
    return document


def load_json(path: Path, caps: Limits) -> Any:
    """Load any JSON document of an episode file's size, gzip or plain."""
    scanner = DocumentScanner(path, caps.vlnce_values)
    return parse_json(path, _read(path, caps, scanner), max_depth=caps.depth, scanner=scanner)


def _read(path: Path, caps: Limits, scanner: DocumentScanner) -> bytearray:
    data, episodes, searched = bytearray(), 0, 0
    with open_input(path) as raw:
        try:
            zipped = raw.read(2) == b"\x1f\x8b"
            raw.seek(0)
            stream = gzip.GzipFile(fileobj=raw) if zipped else raw
            while part := stream.read(_READ_BYTES):
                if len(data) + len(part) > caps.vlnce_bytes:
                    raise FileFormatError(
                        path, f"more than {caps.vlnce_bytes:,} bytes when decompressed, the limit"
                    )
                scanner.feed(part)
                data += part
                episodes += data.count(_EPISODE_KEY, searched)
                searched = max(searched, len(data) - len(_EPISODE_KEY) + 1)
                if episodes > caps.vlnce_episodes:
                    raise _too_many(path, caps.vlnce_episodes)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise FileFormatError(path, f"broken gzip: {error}") from error
        except OSError as error:
            raise FileFormatError(path, f"cannot be read: {error.strerror}") from error
    return data


def _too_many(path: Path, episodes: int) -> FileFormatError:
    return FileFormatError(
        path,
        f"more than {episodes:,} episodes, the limit; split the file, or raise vlnce_episodes "
        f"in {VARIABLE}",
    )
