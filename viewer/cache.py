"""What takes seconds to prepare for the browser is kept in the user's cache."""

import hashlib
import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..formats.core.atomic import write_bytes
from ..formats.core.checkout import user_cache

MOST = 16  # files, of some MB each


def cached(key: str, make: Callable[[], dict[str, bytes]]) -> dict[str, bytes]:
    """Return what `make` returns, or returned earlier for the same key."""
    path = user_cache() / "viewer" / f"{hashlib.sha256(key.encode()).hexdigest()[:24]}.npz"
    try:
        with np.load(path, allow_pickle=False) as stored:
            return {name: stored[name].tobytes() for name in stored.files}
    except (OSError, ValueError, zipfile.BadZipFile):  # none yet, or damaged
        made = make()
    stream = io.BytesIO()
    arrays = {name: np.frombuffer(data, np.uint8) for name, data in made.items()}
    np.savez(stream, allow_pickle=False, **arrays)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, stream.getvalue())
        files = sorted(path.parent.glob("*.npz"), key=lambda file: -file.stat().st_mtime)
        for old in files[MOST:]:
            old.unlink(missing_ok=True)
    except OSError:  # a cache that cannot be written is none
        pass
    return made


def stamp(folder: Path) -> str:
    """Return what changes when a file in a folder is written again."""
    files = sorted(p for p in folder.rglob("*.*") if p.is_file())
    return repr([(str(path), path.stat().st_size, path.stat().st_mtime_ns) for path in files])
