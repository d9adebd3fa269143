"""The process that holds a lock: who it is, whether it lives, and how it renews the lock."""

import contextlib
import json
import logging
import os
import platform
import signal
import threading
import uuid
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from ...formats.core.errors import InputError

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Holder:
    """The process that holds a lock.

    Attributes:
        boot: Identifies the machine's current boot, and the container, where available.
        started: Start time of the process, as the system counts it: ids are used again.
        token: Unique to this holding.
    """

    host: str
    boot: str
    pid: int
    started: str
    token: str

    @staticmethod
    def this() -> "Holder":
        """Return a new holder for this process."""
        return Holder(
            platform.node(), _boot(), os.getpid(), _started(os.getpid()), uuid.uuid4().hex
        )

    @staticmethod
    def read(path: Path) -> "Holder | None":
        """Return the holder of the lock `path`; None if there is none, or it cannot be read."""
        try:
            return Holder.parse(path.read_bytes())
        except OSError:
            return None

    @staticmethod
    def parse(content: bytes) -> "Holder | None":
        """Return the holder that the first line of a lock names; None if it names none."""
        try:
            return Holder(**json.loads(content.split(b"\n")[0]))
        except (TypeError, ValueError):
            return None

    def line(self) -> bytes:
        """Return the first line of a lock, which `parse` reads."""
        return json.dumps(asdict(self)).encode()

    def is_here(self) -> bool:
        """Return whether it is, or was, a process of this machine since the machine's last boot."""
        return self.host == platform.node() and self.boot == _boot()

    def is_alive_here(self) -> bool:
        """Return whether it is a living process, if it is one of this machine."""
        return bool(self.started) and self.started == _started(self.pid)

    def __str__(self) -> str:
        """Return the process and its machine, for an error message."""
        return f"process {self.pid} on {self.host}"


def renew(
    holder: Holder,
    place: str,
    *,
    read: Callable[[], Holder | None],
    touch: Callable[[], object],
    every_s: float,
) -> threading.Event:
    """Start a thread that renews a lock, and stops this process if another one took it over.

    Args:
        place: What is locked, for an error message.
        read: Return the holder that the lock names; None if it names none.

    Returns:
        An event that ends the thread when it is set.
    """
    ended = threading.Event()

    def work() -> None:
        while not ended.wait(every_s):
            with contextlib.suppress(OSError, InputError):  # disk full, network down: for a while
                current = read()
                if current is not None and current.token != holder.token:
                    log.error("%s took over %s; this run stops", current, place)
                    os.kill(os.getpid(), signal.SIGTERM)
                    return
                if not ended.is_set():
                    touch()

    threading.Thread(target=work, daemon=True).start()
    return ended


def _boot() -> str:
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        # Containers of one machine do not see each other's processes.
        return f"{boot} {Path('/proc/self/ns/pid').readlink()}"
    except OSError:
        return ""


def _started(pid: int) -> str:
    """Return when a process of this machine started; empty if there is no such process."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
        return stat.rpartition(")")[2].split()[19]
    except (OSError, IndexError):
        pass
    try:  # systems without /proc
        os.kill(pid, 0)
    except ProcessLookupError:
        return ""
    except OSError:
        pass
    return "unknown" if not Path("/proc/self/stat").exists() else ""
