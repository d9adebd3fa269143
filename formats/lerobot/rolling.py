"""A Parquet writer that begins a new file when the current one is full."""

from pathlib import Path
from typing import IO, Any, Self

import pyarrow as pa
import pyarrow.parquet as pq

from .episode_columns import EPISODE_COLUMNS
from .layout import EPISODES_PATH, FileLimits, FilePlace

# A row group costs a footer entry per column, and episodes have some 200 columns.
EPISODES_PER_GROUP = 100


class RollingParquet:
    """Write tables, one row group each, into `chunk-…/file-….parquet` of limited size."""

    def __init__(self, root: Path, template: str, limits: FileLimits):
        self._root, self._template, self._limits = root, template, limits
        self._place = FilePlace()
        self._file: IO[bytes] | None = None
        self._writer: pq.ParquetWriter | None = None
        self._groups = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def upcoming(self) -> FilePlace:
        """Return where the next table will go; closes a full file."""
        if self._file is not None and self._groups:
            size = self._file.tell()
            if size + size / self._groups >= self._limits.data_mb * 1024 * 1024:
                self._close()
                self._place = self._place.next(self._limits)
        return self._place

    def write(self, table: pa.Table) -> FilePlace:
        """Append `table` as a row group; return the file it went to."""
        place = self.upcoming()
        if self._writer is None:
            path = self._root / place.path(self._template)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("wb")
            self._writer = pq.ParquetWriter(
                self._file, table.schema, compression="snappy", use_dictionary=True
            )
        self._writer.write_table(table)
        self._groups += 1
        return place

    def _close(self) -> None:
        if self._writer is not None:
            self._writer.close()
        if self._file is not None:
            self._file.close()
        self._writer, self._file, self._groups = None, None, 0


class EpisodeTable:
    """Write meta/episodes, some rows at a time."""

    def __init__(self, root: Path, limits: FileLimits):
        self._writer = RollingParquet(root, EPISODES_PATH, limits)
        self._rows: list[tuple[dict[str, Any], dict[str, Any]]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        with self._writer:
            if kind is None:
                self._flush()

    def add(self, row: dict[str, Any], own: dict[str, Any]) -> None:
        """Append an episode: LeRobot's columns, and ours (`EPISODE_COLUMNS`)."""
        self._rows.append((row, own))
        if len(self._rows) == EPISODES_PER_GROUP:
            self._flush()

    def _flush(self) -> None:
        if not self._rows:
            return
        place, count = self._writer.upcoming(), len(self._rows)
        columns = {key: pa.array([row[key] for row, _ in self._rows]) for key in self._rows[0][0]}
        columns["meta/episodes/chunk_index"] = pa.array([place.chunk_index] * count)
        columns["meta/episodes/file_index"] = pa.array([place.file_index] * count)
        for key, kind in EPISODE_COLUMNS.items():
            columns[key] = pa.array([own[key] for _, own in self._rows], kind)
        self._writer.write(pa.table(columns))
        self._rows.clear()
