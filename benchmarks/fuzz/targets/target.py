"""A reader to fuzz, with small sound files to begin from."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vlnpe.formats.core.errors import InputError


@dataclass(frozen=True)
class Target:
    """A reader.

    Attributes:
        seeds: sound files.
        read: what is done with one; it may raise typed errors.
    """

    seeds: list[bytes]
    read: Callable[[bytes], object]


def saved(path: Path, read: Callable[[Path], object]) -> Callable[[bytes], object]:
    path.parent.mkdir(parents=True, exist_ok=True)

    def write_and_read(data: bytes) -> object:
        path.write_bytes(data)
        return read(path)

    return write_and_read


def typed(read: Callable[[bytes], object], *others: type[Exception]) -> Callable[[bytes], object]:
    """Return `read` with the errors that its callers expect as typed ones."""

    def typed(data: bytes) -> object:
        try:
            return read(data)
        except (ValueError, *others) as error:
            raise InputError(" ".join(str(error).split())[:200]) from error

    return typed
