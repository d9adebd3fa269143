"""One process at a time in a run folder of an object store.

The lock is an object that only one process can create; it names its holder, who renews it. A
holder of this machine that is dead is replaced at once, one of another machine when the lock has
not been renewed while this process watched for `STALE_S`: no two clocks are compared.
"""

import contextlib
import itertools
import logging
import time
from collections.abc import Iterator

from ..engine.holder import Holder, renew
from ..engine.lock import LOCK_NAME, LockedError
from .objects import ObjectFolder, StoreError

log = logging.getLogger(__name__)

RENEW_S = 20.0
STALE_S = 100.0
POLL_S = 5.0


@contextlib.contextmanager
def hold(store: ObjectFolder, *, wait: bool = False) -> Iterator[None]:
    """Hold the lock of a run folder; raise LockedError, or `wait`, if another process does."""
    holder = Holder.this()
    # The count changes the lock's content, which is how another process sees that it is renewed.
    contents = (holder.line() + b"\n%d" % count for count in itertools.count())
    watched, since_s, warned = None, 0.0, False
    while not store.create(LOCK_NAME, next(contents)):
        content = store.read(LOCK_NAME)
        if content is None:
            continue
        other = Holder.parse(content)
        if content != watched:
            watched, since_s = content, time.monotonic()
        dead_here = other is not None and other.is_here() and not other.is_alive_here()
        if dead_here or time.monotonic() - since_s > STALE_S:
            store.remove([LOCK_NAME])
            continue
        if not wait:
            raise LockedError(
                f"{store.url} is in use by {other or 'another process'}; wait for it to end "
                f"(--wait does, and continues {STALE_S:.0f} s after a process has died), or "
                "choose another folder"
            )
        if not warned:
            log.warning("%s is in use by %s: waiting for it to end", store.url, other)
            warned = True
        time.sleep(POLL_S)
    ended = renew(
        holder,
        store.url,
        read=lambda: Holder.parse(store.read(LOCK_NAME) or b""),
        touch=lambda: store.write(LOCK_NAME, next(contents)),
        every_s=RENEW_S,
    )
    try:
        yield
    finally:
        ended.set()
        with contextlib.suppress(StoreError):
            if Holder.parse(store.read(LOCK_NAME) or b"") == holder:
                store.remove([LOCK_NAME])
