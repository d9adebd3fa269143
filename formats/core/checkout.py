"""The checkout that vlnpe runs from, the commands that complete its environment, its cache."""

import os
import shlex
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]  # or site-packages/vlnpe, where it was installed


def user_cache() -> Path:
    """Return the folder of what vlnpe keeps between runs for a user; it need not exist."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "vlnpe"


def setup_command(extras: Sequence[str] = ()) -> str:
    """Return the shell command that installs the core and some extras; empty without a checkout."""
    if not (CHECKOUT / "uv.lock").is_file():
        return ""
    folder = [] if Path.cwd() == CHECKOUT else ["-C", str(CHECKOUT)]
    variables = [f"EXTRA={','.join(extras)}"] if extras else []
    return shlex.join(["make", *folder, "setup", *variables])


def install_command(requirements: Sequence[str]) -> str:
    """Return the shell command that adds packages to this environment, which may have no pip."""
    if uv := find_uv():
        return shlex.join([uv, "pip", "install", "--python", sys.executable, *requirements])
    return shlex.join([sys.executable, "-m", "pip", "install", *requirements])


def find_uv(tool: str = "uv") -> str | None:
    """Return the path of uv (or `uvx`): the user's, or the copy in .tools."""
    own = CHECKOUT / ".tools" / "bin" / tool
    return shutil.which(tool) or (str(own) if own.is_file() else None)


def program_in_checkout() -> str:
    """Return how a shell in the checkout finds vlnpe; `vlnpe` if its environment is elsewhere."""
    own = Path(sys.executable).with_name("vlnpe")
    inside = own.is_file() and own.is_relative_to(CHECKOUT)
    return str(own.relative_to(CHECKOUT)) if inside else "vlnpe"


def program() -> str:
    """Return how a shell with this folder and `PATH` finds vlnpe."""
    own = Path(sys.executable).with_name("vlnpe")
    if shutil.which("vlnpe") or not own.is_file():
        return "vlnpe"
    return str(own.relative_to(Path.cwd()) if own.is_relative_to(Path.cwd()) else own)
