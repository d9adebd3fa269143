"""Open files from untrusted sources: regular files only, of bounded size, inside their folder.

A link that the user names is followed: it is the user's choice. A link inside a folder that was
downloaded is followed only within that folder. Opening never blocks on a FIFO and never reads a
device.
"""

import os
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath, PureWindowsPath
from tokenize import TokenError
from typing import BinaryIO

from ..core.errors import FileFormatError

# Parsers raise these for damaged files: headers may be Python literals, lengths and texts anything.
PARSER_ERRORS = (
    *(ArithmeticError, AttributeError, EOFError, LookupError, MemoryError, OSError, RuntimeError),
    *(SyntaxError, TypeError, ValueError, TokenError, struct.error, zipfile.BadZipFile, zlib.error),
)
_BLOCK = 1 << 20
_LFS_START = b"version https://git-lfs.github.com/spec/"
_LFS_BYTES = 1024  # a pointer is shorter
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


def check_input(path: Path, *, root: Path | None = None, max_bytes: int | None = None) -> int:
    """Return the size in bytes of a regular file."""
    try:
        size = _check(path, path.stat(), root, max_bytes)
        # All readers come by here, also those whose library opens the file.
        if size < _LFS_BYTES:
            with os.fdopen(_open(path), "rb") as stream:
                if stream.read(len(_LFS_START)) == _LFS_START:
                    raise FileFormatError(path, "Git LFS pointer; run `git lfs pull`")
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from error
    return size


def open_input(path: Path, *, root: Path | None = None, max_bytes: int | None = None) -> BinaryIO:
    """Open a regular file for reading, without blocking (a FIFO would wait for a writer)."""
    check_input(path, root=root, max_bytes=max_bytes)
    try:
        descriptor = _open(path)
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from error
    try:
        _check(path, os.fstat(descriptor), root, max_bytes)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_start(path: Path, count: int) -> bytes:
    """Return up to the first `count` bytes of a regular file."""
    with open_input(path) as stream:
        return stream.read(count)


def read_input(path: Path, *, root: Path | None = None, max_bytes: int) -> bytes:
    """Return the content of a regular file, which may not grow beyond `max_bytes` meanwhile."""
    with open_input(path, root=root, max_bytes=max_bytes) as stream:
        try:
            # At once where the size is known; a buffer of `max_bytes` would take that much memory.
            parts = [stream.read(os.fstat(stream.fileno()).st_size)]
            total = len(parts[0])
            while total <= max_bytes and (more := stream.read(min(_BLOCK, max_bytes + 1 - total))):
                parts.append(more)
                total += len(more)
        except OSError as error:
            raise _unreadable(path, error) from error
    if total > max_bytes:
        raise _too_large(path, total, max_bytes)
    return parts[0] if len(parts) == 1 else b"".join(parts)


def check_links(root: Path) -> None:
    """Check that a folder contains only files and folders that lie in it: no link out, no FIFO."""
    for path in walk(root):
        try:
            mode = path.lstat().st_mode
            if stat.S_ISLNK(mode):
                require_inside(path, root)
                mode = path.stat().st_mode
        except OSError as error:
            raise _unreadable(path, error) from error
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
            raise FileFormatError(path, f"is {_kind(mode)}; valid: a regular file")


def walk(root: Path) -> Iterator[Path]:
    """Yield everything below a folder, sorted within each; links to folders are not entered."""
    for parent, names, others in os.walk(root):
        names.sort()
        yield from (Path(parent, name) for name in sorted([*names, *others]))


def require_inside(path: Path, root: Path) -> None:
    """Check that a path lies in a folder after links are followed.

    A snapshot of the Hugging Face hub's cache consists of links to the `blobs` beside it, which
    are its own.
    """
    try:
        target, inside = path.resolve(), root.resolve()
    except (OSError, RuntimeError, ValueError) as error:
        raise _unreadable(path, error) from error
    blobs = [p.parent / "blobs" for p in inside.parents if p.name == "snapshots"]
    if not any(target.is_relative_to(folder) for folder in (inside, *blobs)):
        raise FileFormatError(path, f"leads out of {root}; valid: files in it")


def is_text(path: Path) -> bool:
    """Return whether a path is valid UTF-8; others can be neither printed nor put into a file."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def is_relative(name: str) -> bool:
    """Return whether a path leads neither up nor to an absolute place, on any system."""
    windows = PureWindowsPath(name)
    absolute = PurePosixPath(name).is_absolute() or windows.anchor
    return not absolute and ".." not in windows.parts and "\0" not in name


def _open(path: Path) -> int:
    # Without O_NONBLOCK a FIFO put here since it was checked would wait for a writer.
    return os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))


def _check(path: Path, status: os.stat_result, root: Path | None, max_bytes: int | None) -> int:
    if not stat.S_ISREG(status.st_mode):
        raise FileFormatError(path, f"is {_kind(status.st_mode)}; valid: a regular file")
    if root is not None:
        require_inside(path, root)
    if max_bytes is not None and status.st_size > max_bytes:
        raise _too_large(path, status.st_size, max_bytes)
    return status.st_size


def _kind(mode: int) -> str:
    return next((name for test, name in _KINDS if test(mode)), "no regular file")


def _too_large(path: Path, size: int, max_bytes: int) -> FileFormatError:
    return FileFormatError(path, f"is too large ({size:,} bytes); valid: up to {max_bytes:,}")


def _unreadable(path: Path, error: Exception) -> FileFormatError:
    if isinstance(error, FileNotFoundError):
        return FileFormatError(path, "no such file")
    reason = error.strerror if isinstance(error, OSError) else str(error)
    return FileFormatError(path, f"cannot be read: {reason}")
