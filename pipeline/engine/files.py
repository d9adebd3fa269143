"""Size and SHA-256 of every file that an item wrote, so that later damage can be found."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from ...formats.core.atomic import TEMPORARY_PREFIX, file_digest

ITSELF = "."  # name of an output that is a file, among the files of that output

# The files of one output by their path relative to it.
Records = dict[str, str]


@dataclass(frozen=True)
class FileRecord:
    """Size and digest of a file when it was finished."""

    size: int
    sha256: str

    @staticmethod
    def of(path: Path) -> "FileRecord":
        """Read a file.

        Raises:
            OSError: If it cannot be read.
        """
        return FileRecord(path.stat().st_size, file_digest(path))

    @staticmethod
    def parse(text: str) -> "FileRecord":
        """Return what `str` of a record gave.

        Raises:
            ValueError: If `text` is no record.
        """
        size, sha256 = text.split(" ")
        return FileRecord(int(size), sha256)

    def __str__(self) -> str:
        """Return one short line for the manifest."""
        return f"{self.size} {self.sha256}"


def resized(path: Path, record: FileRecord) -> str:
    """Return how a file is damaged, missing or of another size; empty if neither. It is not read.

    Raises:
        OSError: If it cannot be looked at.
    """
    if not path.is_file():
        return "missing"
    size = path.stat().st_size
    return "" if size == record.size else f"has {size} bytes, {record.size} were written"


def lost(root: Path, output: str, records: Records) -> str:
    """Return which file of an output is missing, or how its size changed; empty if none.

    Args:
        records: Of its files. Contents are not read: hashing all at each start would take long.
    """
    if not (root / output).exists():
        return f"{output} is missing"
    for name, record in records.items():
        path = path_in_run(output, name)
        if problem := resized(root / path, FileRecord.parse(record)):
            return f"{path} is missing" if problem == "missing" else f"{path} {problem}"
    return ""


def records_of(output: Path) -> Records:
    """Return the record of each file of an output, a file or a folder; none if it is missing."""
    if output.is_file():
        return {ITSELF: str(FileRecord.of(output))}
    return {
        path.relative_to(output).as_posix(): str(FileRecord.of(path)) for path in files_in(output)
    }


def path_in_run(output: str, name: str) -> str:
    """Return the path of a file of an output, relative to the folder of the ledger."""
    return os.path.normpath(f"{output}/{name}")


def files_in(folder: Path) -> list[Path]:
    """Return the finished files below a folder, in order."""
    return sorted(
        path
        for path in folder.rglob("*")
        if path.is_file()
        and not any(part.startswith(TEMPORARY_PREFIX) for part in path.relative_to(folder).parts)
    )


def all_records(outputs: Iterable[Path]) -> dict[Path, Records]:
    """Return the records of an item's outputs."""
    return {output: records_of(output) for output in outputs}
