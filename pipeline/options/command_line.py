"""The command line that options came from."""

import shlex
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from ...formats.core.checkout import program

# Of these, a command that runs an item again has its own.
LEFT_OUT = {
    "only", "explain", "retry_quarantined", "wait", "json", "max_failed",
    "workers", "executor", "ray_address", "slurm", "dry_run",
}  # fmt: skip


def command_line(options: Any) -> str:
    """Return a shell command with the same effect as `options`, from any folder.

    Args:
        options: An instance of a class of `pipeline.options` whose command has its name in lower
            case letters.
    """
    words = [program(), type(options).__name__.lower()]
    for one in fields(options):
        value = getattr(options, one.name)
        default = None if one.default is MISSING else one.default
        if one.name in LEFT_OUT or value is None or value == default:
            continue
        if "Positional" in str(one.type):
            words.append(str(value))
        elif value is True or value is False:
            words.append(f"--{'' if value else 'no-'}{one.name.replace('_', '-')}")
        elif isinstance(value, tuple | list):
            words += [f"--{one.name.replace('_', '-')}", *map(str, value)]
        else:
            words += [f"--{one.name.replace('_', '-')}", str(value)]
    return f"cd {shlex.quote(str(Path.cwd()))} && {shlex.join(words)}"
