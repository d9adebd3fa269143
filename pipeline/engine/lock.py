"""One process at a time in a run folder, on one machine or on several that share the folder.

The lock is a file that names its holder. Where the file system supports `flock`, the kernel holds
it and drops it with the process, however that ends. Network file systems may lack `flock`, or keep
it within one machine; there the holder renews the file's time, and a holder that has not done so
for `STALE_S` is taken for dead.
"""

import contextlib
import errno
import fcntl
import logging
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from ...formats.core.atomic import TEMPORARY_PREFIX
from ...formats.core.errors import InputError
from .holder import Holder, renew

log = logging.getLogger(__name__)

LOCK_NAME = ".vlnpe-lock"
RENEW_S = 10.0
STALE_S = 90.0  # the holder may be suspended or its network down for a while
POLL_S = 1.0
GLANCES, GLANCE_S = 3, 0.1
SETTLE_S = 0.5  # between taking a stale lock over and believing it
UNSUPPORTED = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP, errno.EINVAL}


class LockedError(InputError):
    """Another process works in the folder."""


@contextlib.contextmanager
def lock(folder: Path, *, wait: bool = False) -> Iterator[None]:
    """Hold the lock of a folder; raise LockedError if another process does, or `wait` for it."""
    path = folder / LOCK_NAME
    tries = 0
    while (held := _try(path)) is None:
        tries += 1
        if tries <= GLANCES:  # the holder may be about to leave
            time.sleep(GLANCE_S)
            continue
        if not wait:
            raise LockedError(_refusal(folder, waitable=True))
        if tries == GLANCES + 1:
            log.warning("%s is in use by %s: waiting for it to end", folder, _who(folder))
        time.sleep(POLL_S)
    with held:
        yield


def refuse_if_locked(folder: Path) -> None:
    """Raise LockedError if a living process works in `folder`; changes nothing."""
    if is_locked(folder):
        raise LockedError(_refusal(folder, waitable=False))


def is_locked(folder: Path) -> bool:
    """Return whether a living process holds the lock of `folder`."""
    path = folder / LOCK_NAME
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        supported = True
    except OSError as error:
        if error.errno not in UNSUPPORTED:
            return True
        supported = False
    finally:
        os.close(descriptor)
    holder = Holder.read(path)
    return holder is not None and not _is_dead(holder, path, supported)


def sweep_unlocked(root: Path) -> None:
    """Remove unfinished files of dead processes under `root`, whose lock this process holds.

    Folders in it that are runs of their own may be in use by a living process; they are left alone.
    """
    for folder, folders, files in root.walk():
        for name in [*folders]:
            if name.startswith(TEMPORARY_PREFIX):
                shutil.rmtree(folder / name, ignore_errors=True)
                folders.remove(name)
            elif is_locked(folder / name):
                folders.remove(name)
        for name in files:
            if name.startswith(TEMPORARY_PREFIX):
                (folder / name).unlink(missing_ok=True)


def _who(folder: Path) -> str:
    return str(Holder.read(folder / LOCK_NAME) or "another process")


def _refusal(folder: Path, *, waitable: bool) -> str:
    advice = "; wait for it to end (--wait does), or choose another folder" if waitable else ""
    return f"{folder} is in use by {_who(folder)}{advice or '; wait for it to end'}"


class _Held(contextlib.ExitStack):
    """A lock that this process holds until the block ends."""

    def __init__(self, path: Path, holder: Holder, descriptor: int):
        super().__init__()
        self._path, self._holder, self._descriptor = path, holder, descriptor
        self._ended = renew(
            holder,
            str(path.parent),
            read=lambda: Holder.read(path),
            touch=lambda: os.utime(path),
            every_s=RENEW_S,
        )
        self.callback(self._release)

    def _release(self) -> None:
        self._ended.set()
        current = Holder.read(self._path)
        if current is not None and current.token == self._holder.token:
            with contextlib.suppress(OSError):
                self._path.unlink()
        os.close(self._descriptor)


def _try(path: Path) -> _Held | None:
    """Take the lock if no living process holds it."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    held: _Held | None = None
    try:
        held = _take(path, descriptor)
    finally:
        if held is None:
            os.close(descriptor)
    return held


def _take(path: Path, descriptor: int) -> _Held | None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        supported = True
    except OSError as error:
        if error.errno not in UNSUPPORTED:
            return None
        supported = False
    try:
        if not os.path.samestat(os.fstat(descriptor), path.stat()):
            return None  # its holder has just removed it: try again
    except FileNotFoundError:
        return None
    before = Holder.read(path)
    if before is not None and not _is_dead(before, path, supported):
        return None
    holder = Holder.this()
    if supported:
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, holder.line(), 0)
        os.fsync(descriptor)
        return _Held(path, holder, descriptor)
    if before is None and path.stat().st_size and not _is_old(path):
        return None  # it is being written
    temporary = path.with_name(f"{TEMPORARY_PREFIX}{LOCK_NAME}.{holder.token}")
    temporary.write_bytes(holder.line())
    temporary.replace(path)
    time.sleep(SETTLE_S)  # of several that take over at once, the last one has it
    current = Holder.read(path)
    return _Held(path, holder, descriptor) if current == holder else None


def _is_dead(holder: Holder, path: Path, supported: bool) -> bool:
    """Return whether the holder named in a lock has died, as far as this machine knows.

    Args:
        supported: Whether `flock` works here, and did not find the lock held.
    """
    if holder.is_here():
        return supported or not holder.is_alive_here()
    return _is_old(path)


def _is_old(path: Path) -> bool:
    """Return whether the lock has not been renewed, by the file system's clock, not by ours."""
    try:
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=TEMPORARY_PREFIX) as probe:
            now_s = os.fstat(probe.fileno()).st_mtime
        return abs(now_s - path.stat().st_mtime) > STALE_S
    except OSError:
        return False
