"""Ways in which any input may be hostile, and the errors that readers must raise."""

import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from vlnpe.formats.core.errors import FileFormatError


def _fifo(path: Path) -> None:
    os.mkfifo(path)


def _pointer(path: Path) -> None:
    path.write_text(
        f"version https://git-lfs.github.com/spec/v1\noid sha256:{'0' * 64}\nsize 1234567\n"
    )


def _socket(path: Path) -> None:
    # Addresses of sockets are short; temporary folders are not.
    here = Path.cwd()
    os.chdir(path.parent)
    try:
        with socket.socket(socket.AF_UNIX) as server:
            server.bind(path.name)
    finally:
        os.chdir(here)


# What may lie where a file is expected → what the error calls it.
NOT_FILES: dict[str, tuple[Callable[[Path], None], str]] = {
    "a folder": (Path.mkdir, "is a folder"),
    "a FIFO": (_fifo, "is a FIFO"),
    "a socket": (_socket, "is a socket"),
    "a link to /dev/zero": (lambda path: path.symlink_to("/dev/zero"), "is a device"),
    "a Git LFS pointer": (_pointer, "Git LFS pointer; run `git lfs pull`"),
    "a broken link": (lambda path: path.symlink_to("nowhere"), "no such file"),
    "a link to itself": (lambda path: path.symlink_to(path.name), "cannot be read"),
}

not_files = pytest.mark.parametrize("kind", NOT_FILES)

DEEP = 200_000
DEEP_JSON = "[" * DEEP
CLOSED_DEEP_JSON = "[" * 500 + "]" * 500


def put(kind: str, path: Path) -> str:
    """Put something that is no file at `path`; return what the error must say."""
    make, complaint = NOT_FILES[kind]
    make(path)
    return complaint


def refusal(read: Callable[[], object]) -> FileFormatError:
    """Return the typed error that `read` ends in: one short line, which can be printed."""
    with pytest.raises(FileFormatError) as caught:
        read()
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 1000
    text.encode()
    return caught.value
