"""Typed errors raised by all packages.

A command exits with code 2 on `InputError`: the message is one line that names what is wrong,
which value was given and what is valid. Anything a single work item raises is quarantined by the
runner and never ends the run.
"""

import difflib
import re
import reprlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .checkout import program, setup_command

MAX_SHOWN = 40  # names in an error message
MAX_REASON = 800  # characters
LEAST_LIKENESS = 0.7  # of a name to be suggested; `tent` and `apartment` have 0.62
MAX_SPELLED = 80  # characters of a name that is compared with the valid ones
MAX_LINE = 160  # characters of another library's message
_ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")


class VlnpeError(Exception):
    """Base class of all errors raised by vlnpe.

    Attributes:
        hints: Lines for a terminal beneath the message, e.g. commands that help.
    """

    hints: tuple[str, ...] = ()

    def __reduce__(self) -> tuple[Any, ...]:
        """Support pickling whatever `__init__` takes, so that worker processes can raise it."""
        return _restored, (type(self), str(self), vars(self))


def _restored(kind: type[VlnpeError], message: str, state: dict[str, Any]) -> VlnpeError:
    error = kind.__new__(kind, message)
    vars(error).update(state)
    return error


class InputError(VlnpeError):
    """Invalid user input."""


class FileFormatError(InputError):
    """A file is damaged or is not in the expected format.

    Attributes:
        reason: One line, without the file name.
    """

    def __init__(self, path: Path | str, reason: str):
        self.path = Path(path)
        reason = without_addresses(reason)
        # Reasons may quote the file.
        reason = reason if len(reason) <= MAX_REASON else f"{reason[:MAX_REASON]}…"
        self.reason = reason
        # A name that is not UTF-8 could not be printed.
        name = str(self.path).encode(errors="backslashreplace").decode()
        super().__init__(f"{name}: {reason}")


class SceneError(InputError):
    """A scene was read but cannot be used for navigation (no floor, implausible scale, …)."""


class UnknownNameError(InputError):
    """A name is not registered.

    The message suggests the closest valid name and lists all, so that users can fix the call
    without reading the source.
    """

    def __init__(self, kind: str, name: str, valid: Iterable[str]):
        self.kind, self.name, self.valid = kind, name, sorted(valid)
        shown = self.valid[:MAX_SHOWN]
        if more := len(self.valid) - len(shown):
            shown.append(f"… and {more} more")
        hint = did_you_mean(name, self.valid)
        super().__init__(f"unknown {kind} {brief(name)}{hint}; valid: {', '.join(shown)}")


class MissingExtraError(InputError):
    """Optional dependencies of vlnpe are not installed.

    Attributes:
        user: The start of a sentence: what needs them.
        extras: Their names in pyproject.toml.
    """

    def __init__(self, user: str, *extras: str):
        self.user, self.extras = user, extras
        command = setup_command(extras) or f"{program()} doctor prints how to"
        names, more = ", ".join(f"`{extra}`" for extra in extras), len(extras) > 1
        needed = f"need the extras {names}" if more else f"needs the extra {names}"
        what = "them" if more else "it"
        super().__init__(f"{user} {needed}; to install {what}: {command}")


class DivergedError(VlnpeError):
    """The physics simulation diverged (NaN or implausibly large values)."""


def check_name(kind: str, name: str, valid: Iterable[str]) -> None:
    """Raise UnknownNameError unless `name` is one of `valid`; `kind` says of what, in words."""
    names = tuple(valid)
    if name not in names:
        raise UnknownNameError(kind, name, names)


def did_you_mean(name: str, valid: Iterable[str]) -> str:
    """Return ` (did you mean x?)` for the closest of `valid`; nothing if none is close."""
    spelled = {name.casefold(): name for name in valid}
    near = difflib.get_close_matches(name[:MAX_SPELLED].casefold(), spelled, 1, LEAST_LIKENESS)
    return f" (did you mean {spelled[near[0]]}?)" if near else ""


def without_addresses(text: str) -> str:
    """Return a message without places in memory, so that two runs give the same one."""
    return _ADDRESS.sub("", text)


def first_line(error: BaseException) -> str:
    """Return the first line of another library's message; its type if it has none."""
    lines = without_addresses(str(error)).strip().splitlines()
    return (lines[0][:MAX_LINE] if lines else "") or type(error).__name__


def one_line(error: BaseException) -> str:
    """Return another library's whole message in one line of at most 300 characters."""
    return " ".join(str(error).split())[:300]


def brief(value: Any) -> str:
    """Return a value for an error message: never long, whatever it is and however it nests."""
    most = dict.fromkeys(("maxlevel", "maxdict", "maxlist", "maxtuple"), 3)
    try:
        text = reprlib.Repr(**most, maxstring=40, maxother=40).repr(value)
    except ValueError:  # an integer of thousands of digits
        text = f"a {type(value).__name__} of thousands of digits"
    return text if len(text) <= 120 else text[:117] + "..."
