"""Read files of an untrusted ZIP archive into memory; nothing is unpacked to disk."""

import zipfile
from collections.abc import Iterable
from pathlib import Path

from ..core.errors import FileFormatError, one_line
from .files import PARSER_ERRORS, open_input
from .limits import limits


def read_zip(path: Path, names: Iterable[str]) -> dict[str, bytes]:
    """Return files of an archive by name; together they may not exceed the limit `array_bytes`."""
    cap = limits().array_bytes
    with open_input(path, max_bytes=cap) as stream:
        try:
            with zipfile.ZipFile(stream) as archive:
                members = [archive.getinfo(name) for name in names]
                total = sum(member.file_size for member in members)
                if total > cap:
                    raise FileFormatError(
                        path,
                        f"unpacks to {total:,} bytes; valid: up to {cap:,} (limit array_bytes)",
                    )
                result = {}
                for member in members:
                    with archive.open(member) as file:
                        # No more than stated, whatever the compressed bytes would grow to.
                        result[member.filename] = file.read(member.file_size)
                return result
        except PARSER_ERRORS as error:
            raise FileFormatError(
                path, f"damaged archive ({type(error).__name__}: {one_line(error)})"
            ) from error
