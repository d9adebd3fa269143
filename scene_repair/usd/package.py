"""USDZ packages: ZIP files with uncompressed members."""

import zipfile
from pathlib import Path, PurePosixPath

from ...formats.core.errors import FileFormatError
from ...formats.untrusted.files import check_input, open_input

MAX_MEMBERS, MAX_MEMBER_BYTES = 100_000, 2 << 30


def check_package(path: Path) -> list[str]:
    """Return the names of the members; raise FileFormatError if one is compressed or outside."""
    size = check_input(path)
    try:
        with open_input(path) as stream, zipfile.ZipFile(stream) as package:
            members = package.infolist()
    # zipfile raises half a dozen types on damaged bytes.
    except Exception as error:
        raise FileFormatError(path, f"damaged package: {error}") from error
    if not members or len(members) > MAX_MEMBERS:
        raise FileFormatError(path, f"package of {len(members)} members; valid: 1 … {MAX_MEMBERS}")
    for member in members:
        name = member.filename
        if member.compress_type != zipfile.ZIP_STORED:
            raise FileFormatError(
                path, f"member {name!r} is compressed ({member.file_size:,} bytes); USDZ forbids it"
            )
        if member.flag_bits & 1:
            raise FileFormatError(path, f"member {name!r} is encrypted; USDZ forbids it")
        if member.file_size != member.compress_size:
            raise FileFormatError(path, f"member {name!r} has contradictory sizes")
        if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts or "\\" in name:
            raise FileFormatError(path, f"member {name!r} leads out of the package")
    total = sum(member.file_size for member in members)
    if total > size:
        raise FileFormatError(
            path, f"members of {total:,} bytes in total in a file of {size:,} bytes"
        )
    return [member.filename for member in members]


def read_member(path: Path, name: str) -> bytes:
    """Return the bytes of a member of a checked package; raise FileFormatError if damaged."""
    try:
        with open_input(path) as stream, zipfile.ZipFile(stream) as package:
            size = package.getinfo(name).file_size
            if size > MAX_MEMBER_BYTES:
                raise ValueError(f"{size:,} bytes; valid: up to {MAX_MEMBER_BYTES:,}")
            return package.read(name)
    except Exception as error:
        raise FileFormatError(path, f"member {name!r} cannot be read: {error}") from error
