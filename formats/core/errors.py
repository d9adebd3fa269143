"""The typed errors that every room raises.

A command exits with code 2 on `InputError`: the message is one line that names what is wrong,
which value was given and what is valid. Anything a single work item raises is quarantined by the
runner and never ends the run.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path


class VlnpeError(Exception):
    """Base class of all errors that vlnpe raises on purpose."""


class InputError(VlnpeError):
    """What the user gave cannot be used."""


class FileFormatError(InputError):
    """A file cannot be read as what it claims to be.

    Attributes:
        path: the offending file.
        reason: one line, without the file's name.
    """

    def __init__(self, path: Path | str, reason: str):
        self.path = Path(path)
        self.reason = reason
        super().__init__(f"{self.path}: {reason}")

    def __reduce__(self):
        """Survive the way from a worker process."""
        return type(self), (self.path, self.reason)


class SceneError(InputError):
    """A scene was read, but no robot could live in it (no floor, impossible scale, …)."""


class UnknownNameError(InputError):
    """A name is in no registry.

    The message lists the valid names, so that a user can mend the call without the source.
    """

    def __init__(self, kind: str, name: str, valid: Iterable[str]):
        self.kind, self.name, self.valid = kind, name, sorted(valid)
        super().__init__(f"unknown {kind} {name!r}; valid: {', '.join(self.valid)}")

    def __reduce__(self):
        """Survive the way from a worker process."""
        return type(self), (self.kind, self.name, self.valid)


class DivergedError(VlnpeError):
    """Physics produced NaN or exploded."""
