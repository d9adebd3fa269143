"""A run folder of an object store, worked on in a local scratch folder.

The store is the truth: `pull` brings the scratch folder up to its manifest, and what this machine
finished is uploaded after every stage and once a minute. The manifest is uploaded last, and before
a file that it names is replaced or removed, so that at any moment every row of the store's manifest
has its files; a machine that dies loses the items of its last minute at most.
"""

import contextlib
import hashlib
import json
import logging
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Set
from functools import partial
from pathlib import Path

from ...formats.core.atomic import write_bytes, write_json
from ..engine.files import FileRecord, Records, path_in_run
from ..engine.ledger import JOURNAL_NAME, MANIFEST_NAME, QUARANTINE_NAME, Ledger, Row
from .address import MARKER_NAME, scratch_folder
from .holding import hold
from .objects import ObjectFolder, StoreError

log = logging.getLogger(__name__)

UPLOAD_EVERY_S = 60.0


class MirroredLedger(Ledger):
    """A ledger whose files and rows are copied to an object store as they are finished."""

    def __init__(self, root: Path, store: ObjectFolder, uploaded: Mapping[str, FileRecord]):
        """Open the ledger of a scratch folder that `pull` has brought up to the store.

        Args:
            uploaded: Records of the files that the store holds, as `pull` returned them.
        """
        super().__init__(root)
        self._store = store
        self._uploaded = dict(uploaded)
        self._written = b""  # the manifest that this process uploaded last
        self._next_s = time.monotonic() + UPLOAD_EVERY_S

    def add(self, row: Row, files: Mapping[str, Records] | None = None) -> None:
        """Record a finished item; upload what is finished once a minute."""
        super().add(row, files)
        if time.monotonic() > self._next_s:
            self.save()

    def save(self) -> None:
        """Fold the journal into the manifest and upload what is new.

        Without the network the run goes on, and the next call tries again.
        """
        super().save()
        try:
            self.upload()
        except StoreError as error:
            log.warning("upload failed, will be retried: %s", error)
        self._next_s = time.monotonic() + UPLOAD_EVERY_S

    def finish(self) -> None:
        """Complete the copy."""
        try:
            self.upload()
        except StoreError as error:
            raise StoreError(
                f"{error}. Finished work is kept in {self.root}; the same command uploads it"
            ) from error

    def upload(self) -> None:
        """Bring the store up to this ledger."""
        manifest = self.manifest_text()
        if manifest == self._written:
            return
        store, root, files = self._store, self.root, self.files()
        waiting = {
            name: root / name
            for name, record in files.items()
            if self._uploaded.get(name) != record and (root / name).is_file()
        }
        gone = self._uploaded.keys() - files.keys()
        if gone or any(name in self._uploaded for name in waiting):
            store.write(MANIFEST_NAME, self.manifest_text(without=waiting.keys()))
        store.upload(waiting)
        store.remove(sorted(gone))
        store.write(QUARANTINE_NAME, self.quarantine_text())
        store.write(MANIFEST_NAME, manifest)
        there = self._uploaded.keys() | waiting.keys()
        self._uploaded = {name: record for name, record in files.items() if name in there}
        self._written = manifest
        _mark(root, manifest)


@contextlib.contextmanager
def mirrored(url: str, *, wait: bool = False) -> Iterator[tuple[Path, Callable[[Path], Ledger]]]:
    """Lock a run folder of a store and bring its scratch folder up to it.

    Yields:
        The scratch folder, and a function that opens its ledger.
    """
    store, scratch = ObjectFolder.open(url), scratch_folder(url)
    with hold(store, wait=wait):
        uploaded = pull(store, scratch)
        yield scratch, partial(MirroredLedger, store=store, uploaded=uploaded)


def pull(store: ObjectFolder, scratch: Path) -> dict[str, FileRecord]:
    """Bring a scratch folder up to the manifest of the store.

    What this machine finished and could not upload stays, unless another machine has done the same
    item since.

    Returns:
        Records of the files that the store holds and its manifest names.
    """
    manifest = store.read(MANIFEST_NAME)
    if manifest is None:
        if _marked(scratch):
            log.warning(
                "%s contains no run: continuing with the contents of %s", store.url, scratch
            )
        return {}
    there = _ledger_of(manifest)
    held = _held(store, there)
    if not _is_current(scratch, manifest):
        _pull(store, scratch, manifest, there, held)
    return {name: record for name, record in there.files().items() if name in held}


def _pull(
    store: ObjectFolder, scratch: Path, manifest: bytes, there: Ledger, held: Set[str]
) -> None:
    """Bring a scratch folder up to a manifest of the store; see `pull`."""
    here, names = Ledger(scratch), there.files()
    before = here.files()
    missing = {
        name: scratch / name
        for name, record in names.items()
        if before.get(name) != record or not _has_size(scratch / name, record)
    }
    own = _only_here(here, there)
    scratch.mkdir(parents=True, exist_ok=True)
    # A killed download must not leave files that an old manifest calls by another content.
    for name in (JOURNAL_NAME, MANIFEST_NAME, MARKER_NAME):
        (scratch / name).unlink(missing_ok=True)
    if lost := missing.keys() - held:
        log.warning(
            "%s: %d files of its manifest are missing or have changed size, e.g. %s; "
            "their items run again",
            *(store.url, len(lost), min(lost)),
        )
    store.download({name: path for name, path in missing.items() if name in held})
    own_files = {path for row, files in own for path in _paths(files)}
    for name in before.keys() - names.keys() - own_files:
        (scratch / name).unlink(missing_ok=True)
    write_bytes(scratch / MANIFEST_NAME, manifest)
    _mark(scratch, manifest)
    ledger = Ledger(scratch)
    for row, files in own:
        ledger.add(row, files)


@contextlib.contextmanager
def local_copy(url: str) -> Iterator[Path]:
    """Yield a temporary local copy of all that a run folder of a store holds."""
    store = ObjectFolder.open(url)
    names = [name for name in store.names() if not Path(name).name.startswith(".vlnpe-")]
    if MANIFEST_NAME not in names:
        raise StoreError(f"{url}: not a run folder ({MANIFEST_NAME} is missing)")
    with tempfile.TemporaryDirectory(prefix="vlnpe-") as folder:
        store.download({name: Path(folder) / name for name in names})
        yield Path(folder)


def fetched(url: str) -> Path:
    """Return the scratch folder of a run folder of a store, brought up to it for reading."""
    store, scratch = ObjectFolder.open(url), scratch_folder(url)
    manifest = store.read(MANIFEST_NAME)
    if manifest is None:
        raise StoreError(f"{url}: not a run folder ({MANIFEST_NAME} is missing)")
    if not _is_current(scratch, manifest):
        there = _ledger_of(manifest)
        _pull(store, scratch, manifest, there, _held(store, there))
    return scratch


def _held(store: ObjectFolder, there: Ledger) -> set[str]:
    """Return the names of the files of a ledger that the store holds with their recorded sizes."""
    sizes, files = store.sizes(), there.files()
    return {n for n in sizes.keys() & files.keys() if sizes[n] in (None, files[n].size)}


def _is_current(scratch: Path, manifest: bytes) -> bool:
    """Return whether a scratch folder holds what this manifest of the store describes."""
    digest = hashlib.sha256(manifest).hexdigest()
    return digest == _marked(scratch) and (scratch / MANIFEST_NAME).is_file()


def _only_here(here: Ledger, there: Ledger) -> list[tuple[Row, dict[str, Records]]]:
    """Return the finished items of the scratch folder that the store does not have."""
    return [
        (row, here.records(row))
        for row in here.all_rows()
        if row.status == "done" and there.row(row.stage, row.item) is None
    ]


def _paths(files: Mapping[str, Records]) -> set[str]:
    return {path_in_run(out, name) for out, records in files.items() for name in records}


def _has_size(path: Path, record: FileRecord) -> bool:
    return path.is_file() and path.stat().st_size == record.size


def _ledger_of(manifest: bytes) -> Ledger:
    """Return the ledger that a manifest describes, without its files."""
    with tempfile.TemporaryDirectory() as folder:
        write_bytes(Path(folder) / MANIFEST_NAME, manifest)
        return Ledger(Path(folder))


def _mark(scratch: Path, manifest: bytes) -> None:
    write_json(scratch / MARKER_NAME, {"manifest_sha256": hashlib.sha256(manifest).hexdigest()})


def _marked(scratch: Path) -> str:
    """Return the SHA-256 of the manifest that the store held at last; empty if unknown."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        return str(json.loads((scratch / MARKER_NAME).read_text())["manifest_sha256"])
    return ""
