"""The options of every command, one dataclass per command.

`vlnpe COMMAND --help` imports nothing else, so these modules import no numerical library. Defaults
that belong to such modules are repeated here; a test compares them.
"""

import contextlib
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from ...formats.core.errors import InputError, did_you_mean

MOST_PORTS = 65535
_COMPARED = 1000  # names in a folder that a missing one is compared with


def must_exist(*paths: Path | None) -> None:
    """Raise InputError if one of some paths is missing; `check` of options calls it.

    A command's libraries take seconds to import, so a mistyped path is reported before.
    """
    for path in paths:
        if path is not None and not path.exists():
            beside: list[str] = []
            with contextlib.suppress(OSError):
                beside = [p.name for p in islice(path.parent.iterdir(), _COMPARED)]
            raise InputError(f"{path}: no such file or folder{did_you_mean(path.name, beside)}")


def check_given(episodes: Sequence[Path]) -> None:
    """Raise InputError if a command that reads episode files was given none."""
    if not episodes:
        raise InputError("no episode file; valid: one or more VLN-CE files (.json or .json.gz)")


def check_is_no_folder(option: str, path: Path | None) -> None:
    """Raise InputError if an option names a folder as the file to write."""
    if path is not None and path.is_dir():
        raise InputError(f"{option} {path}: is a folder; valid: a file")


def check_port(port: int) -> None:
    """Raise InputError if there is no such port."""
    if not 0 <= port <= MOST_PORTS:
        raise InputError(f"--port {port}; valid: 0 to {MOST_PORTS}")


def check_numbers(options: Any, least: int, *names: str) -> None:
    """Raise InputError if one of some options is given and below the least valid number."""
    for name in names:
        if (value := getattr(options, name)) is not None and value < least:
            raise InputError(f"--{name.replace('_', '-')} {value}; valid: {least} or more")
