"""Compare the files of a run with the records that its manifest keeps of them."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from ...formats.core.atomic import TEMPORARY_PREFIX
from ...formats.process.progress import progress_bar
from ...instruction_gen.review.decisions import DecisionFile
from ..context import LEDGERS
from ..engine.files import FileRecord, resized
from ..engine.ledger import JOURNAL_NAME, MANIFEST_NAME, QUARANTINE_NAME, Ledger
from ..engine.lock import LOCK_NAME
from ..stages.datasets.reviewed import REVIEW_NAME
from ..store.address import MARKER_NAME

# The files of the ledger and of the store, and the one that people edit: none has a record.
UNRECORDED = {
    *(MANIFEST_NAME, JOURNAL_NAME, QUARANTINE_NAME),
    *(LOCK_NAME, MARKER_NAME, REVIEW_NAME),
}


@dataclass(frozen=True)
class Check:
    """One output and what is wrong with it; an empty problem means that it is sound.

    Attributes:
        unfinished: Whether the only problem is an unfinished run, which its command completes.
    """

    what: str
    problem: str = ""
    unfinished: bool = False


def check_files(ledger: Ledger, below: str = "") -> list[Check]:
    """Hash every recorded file, and look for files without a record.

    Args:
        below: Check this folder of the run alone, by its path relative to the run folder.
    """
    records = {
        name: record
        for name, record in ledger.files().items()
        if not below or Path(name).is_relative_to(below)
    }
    checks = []
    for name in progress_bar("hash", len(records), items=sorted(records)):
        checks.append(Check(name, _difference(ledger.root / name, records[name])))
    return [*checks, *_unknown(ledger.root, below, records)]


def check_ledger(ledger: Ledger) -> list[Check]:
    """Check what a ledger wrote about itself; its manifest was checked when it was opened."""
    last = (ledger.root / JOURNAL_NAME).read_bytes().count(b"\n") + 1 if ledger.damaged_lines else 0
    checks = [
        Check(
            f"{JOURNAL_NAME}, line {number}",
            "damaged or cut short; its item runs again",
            unfinished=number == last,
        )
        for number in ledger.damaged_lines
    ]
    if ledger.unfinished:
        stopped = f"it has not ended; to finish it: {ledger.unfinished}"
        checks.append(Check("the run", stopped, unfinished=True))
    quarantine = ledger.root / QUARANTINE_NAME
    listed = quarantine.read_bytes() if quarantine.is_file() else b""
    # While a run is unfinished, its last items are in the journal alone.
    if listed != ledger.quarantine_text() and not (ledger.root / JOURNAL_NAME).is_file():
        checks.append(Check(QUARANTINE_NAME, f"missing, or not what {MANIFEST_NAME} says"))
    review = ledger.root / REVIEW_NAME
    if review.is_file():
        checks.append(Check(REVIEW_NAME, problem_of(lambda: DecisionFile(review).read())))
    return checks


def nested_runs(root: Path) -> list[Path]:
    """Return the folders below a run folder that are runs of their own, such as evaluations."""
    return sorted(
        path.parent
        for path in root.rglob(MANIFEST_NAME)
        if path.parent != root and LEDGERS not in path.relative_to(root).parts
    )


def _difference(path: Path, record: FileRecord) -> str:
    """Return how a file differs from its record; empty if it does not."""
    try:
        if problem := resized(path, record):
            return problem
        if FileRecord.of(path) != record:
            return "damaged: its SHA-256 is not that of what was written"
    except OSError as error:
        return f"not readable ({error.strerror or error})"
    return ""


def _unknown(root: Path, below: str, records: Mapping[str, FileRecord]) -> Iterator[Check]:
    """Yield a check for each file that no record names."""
    apart = nested_runs(root)
    recorded = {root / name for name in records} | _recorded_beside(root)
    for path in sorted((root / below).rglob("*")):
        relative = path.relative_to(root)
        if path.is_dir() or path in recorded or LEDGERS in relative.parts:
            continue
        if relative.as_posix() in UNRECORDED or any(path.is_relative_to(run) for run in apart):
            continue
        if any(part.startswith(TEMPORARY_PREFIX) for part in relative.parts):
            problem = "left by a process that was killed; the next run removes it"
        else:
            problem = (
                "not in the manifest: nothing that finished in this run wrote it; if a run was "
                "stopped, run its command again"
            )
        yield Check(relative.as_posix(), problem, unfinished=True)


def _recorded_beside(root: Path) -> set[Path]:
    """Return files in the run that single outputs' ledgers, in `.vlnpe/<name>/`, know of."""
    result: set[Path] = set()
    for manifest in root.rglob(f"{LEDGERS}/*/{MANIFEST_NAME}"):
        ledger = Ledger(manifest.parent)
        result |= {(ledger.root / name).resolve() for name in ledger.files()}
    return result


def problem_of(check: Callable[[], object]) -> str:
    """Call `check` and return what it raised, in a line; nothing it can raise ends a verification.

    Readers of damaged bytes raise what their libraries raise, which is anything.
    """
    try:
        check()
    except Exception as error:
        text = " ".join(str(error).split())
        return text or repr(error)
    return ""
