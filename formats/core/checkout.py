"""The checkout that vlnpe runs from, and the command that completes its environment."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]  # or site-packages/vlnpe, where it was installed


def setup_command(extras: Sequence[str] = ()) -> str:
    """Return the shell command that installs the core and some extras; empty without a checkout."""
    if not (CHECKOUT / "uv.lock").is_file():
        return ""
    folder = [] if Path.cwd() == CHECKOUT else ["-C", str(CHECKOUT)]
    wanted = [f"EXTRA={','.join(extras)}"] if extras else []
    return shlex.join(["make", *folder, "setup", *wanted])
