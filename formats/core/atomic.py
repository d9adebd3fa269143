"""Atomic output: a reader sees a whole file or folder, or none; digests of files."""

import contextlib
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

TEMPORARY_PREFIX = ".vlnpe-tmp-"


def sweep(root: Path) -> None:
    """Remove unfinished files of killed processes under `root`; no one else may be writing."""
    for path in [*root.rglob(f"{TEMPORARY_PREFIX}*")]:
        _remove(path)


def sweep_beside(outputs: Iterable[Path]) -> None:
    """Remove unfinished files and folders of dead processes that were writing `outputs`."""
    names_in: dict[Path, set[tuple[str, str]]] = {}
    for path in outputs:
        # As `atomic_file` and `atomic_folder` name them, around a random part.
        names = {(path.stem, "".join(path.suffixes)), (path.name, ""), (f"{path.name}.old", "")}
        names_in.setdefault(path.parent, set()).update(names)
    for folder, names in names_in.items():
        for path in [*folder.glob(f"{TEMPORARY_PREFIX}*")]:
            parts = path.name.removeprefix(TEMPORARY_PREFIX).split(".")
            for k in range(1, len(parts)):
                rest = "".join(f".{part}" for part in parts[k + 1 :])
                if (".".join(parts[:k]), rest) in names:
                    _remove(path)
                    break


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def fsync_path(path: Path) -> None:
    """Flush a file's or a folder's entry to disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; on success fsync it and rename it into place.

    The temporary name keeps the suffix, because encoders choose their format by it. On any error
    the temporary file is removed and `path` is untouched.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor, name = tempfile.mkstemp(
        dir=path.parent, prefix=f"{TEMPORARY_PREFIX}{path.stem}.", suffix="".join(path.suffixes)
    )
    os.close(descriptor)
    temporary = Path(name)
    try:
        yield temporary
        # mkstemp makes private files; results should follow the user's umask like any other.
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        fsync_path(temporary)
        temporary.replace(path)
        fsync_path(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder beside `path`; on success it replaces `path` whole."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(dir=path.parent, prefix=f"{TEMPORARY_PREFIX}{path.name}."))
    temporary.chmod(0o755)
    try:
        yield temporary
        for entry in temporary.rglob("*"):
            if entry.is_file():
                fsync_path(entry)
        if path.exists():
            old = Path(
                tempfile.mkdtemp(dir=path.parent, prefix=f"{TEMPORARY_PREFIX}{path.name}.old.")
            )
            path.replace(old / path.name)
            temporary.replace(path)
            shutil.rmtree(old)
        else:
            temporary.replace(path)
        fsync_path(path.parent)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file atomically; one that holds `data` already keeps its modification time."""
    if path.is_file() and path.stat().st_size == len(data) and path.read_bytes() == data:
        return
    with atomic_file(path) as temporary:
        temporary.write_bytes(data)


def write_json(path: Path, value: Any) -> None:
    """Write `value` as indented JSON, atomically, with sorted keys; see `write_bytes`."""
    write_bytes(path, (json.dumps(value, indent=2, sort_keys=True) + "\n").encode())


def file_digest(path: Path) -> str:
    """Return the SHA-256 hex digest of a file's content."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
