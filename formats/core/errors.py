"""Typed errors raised by all packages.

A command exits with code 2 on `InputError`: the message is one line that names what is wrong,
which value was given and what is valid. Anything a single work item raises is quarantined by the
runner and never ends the run.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any


class VlnpeError(Exception):
    """Base class of all errors raised by vlnpe."""


class InputError(VlnpeError):
    """Invalid user input."""


class FileFormatError(InputError):
    """A file is damaged or is not in the expected format.

    Attributes:
        path: The offending file.
        reason: One line, without the file name.
    """

    def __init__(self, path: Path | str, reason: str):
        self.path = Path(path)
        self.reason = reason
        super().__init__(f"{self.path}: {reason}")

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        """Support pickling, so that the error can be raised in a worker process."""
        return type(self), (self.path, self.reason)


class SceneError(InputError):
    """A scene was read but cannot be used for navigation (no floor, implausible scale, …)."""


class UnknownNameError(InputError):
    """A name is not registered.

    The message lists the valid names, so that users can fix the call without reading the source.
    """

    def __init__(self, kind: str, name: str, valid: Iterable[str]):
        self.kind, self.name, self.valid = kind, name, sorted(valid)
        super().__init__(f"unknown {kind} {name!r}; valid: {', '.join(self.valid)}")

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        """Support pickling, so that the error can be raised in a worker process."""
        return type(self), (self.kind, self.name, self.valid)


class DivergedError(VlnpeError):
    """The physics simulation diverged (NaN or implausibly large values)."""
