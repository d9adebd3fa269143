"""Read Parquet files from untrusted sources, within a limit of memory."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ..core.errors import FileFormatError, one_line
from .files import check_input
from .limits import limits

_BYTES_PER_VALUE = 8


def read_schema(path: Path, *, root: Path | None = None) -> pa.Schema:
    """Return the schema of a Parquet file."""
    check_input(path, root=root)
    try:
        return pq.read_schema(path)
    except (OSError, ValueError, pa.ArrowException) as error:
        raise FileFormatError(path, f"not readable ({one_line(error)})") from error


def read_table(
    path: Path,
    columns: Sequence[str] | None = None,
    *,
    filters: Any = None,
    root: Path | None = None,
) -> pa.Table:
    """Return a Parquet file's table, of all columns or of some.

    Repeated values take next to nothing in a file; how much the table takes in memory is
    estimated first. `filters` are those of `pyarrow.parquet.read_table`.
    """
    check_input(path, root=root)
    try:
        with pq.ParquetFile(path) as file:
            check_size(path, file, columns)
        names = None if columns is None else [*columns]
        table = pq.read_table(path, columns=names, filters=filters)
        table.validate(full=True)  # texts that are not UTF-8 would fail where they are used
        return table
    except (OSError, ValueError, KeyError, pa.ArrowException) as error:
        raise FileFormatError(path, f"not readable ({one_line(error)})") from error


def check_size(path: Path, file: pq.ParquetFile, columns: Sequence[str] | None = None) -> None:
    """Check that columns of an open Parquet file stay below the limit `table_bytes` in memory."""
    metadata, cap = file.metadata, limits().table_bytes
    names = None if columns is None else set(columns)
    total, texts = 0, dict[str, int]()
    for group in range(metadata.num_row_groups):
        for number in range(metadata.num_columns):
            column = metadata.row_group(group).column(number)
            name = column.path_in_schema.split(".")[0]
            if names is not None and name not in names:
                continue
            plain = column.num_values * _BYTES_PER_VALUE
            total += max(plain, column.total_uncompressed_size)
            # Texts of a dictionary, each of them perhaps as long as the whole of it.
            coded = any("DICTIONARY" in encoding for encoding in column.encodings)
            if column.physical_type == "BYTE_ARRAY" and coded:
                most = column.num_values * column.total_uncompressed_size
                texts[column.path_in_schema] = texts.get(column.path_in_schema, 0) + most
    if total <= cap < total + sum(texts.values()):
        total += _text_bytes(path, list(texts))
    if total > cap:
        raise FileFormatError(
            path, f"takes {total:,} bytes in memory; valid: up to {cap:,} (limit table_bytes)"
        )


def _text_bytes(path: Path, columns: list[str]) -> int:
    """Return an upper bound of what text columns take when their dictionaries are written out."""
    total = 0
    with pq.ParquetFile(path, read_dictionary=columns) as file:
        for batch in file.iter_batches(columns=columns):
            for values in batch.columns:
                if not pa.types.is_dictionary(values.type):
                    total += values.nbytes
                elif len(values.dictionary):
                    longest = max(len(text.as_buffer() or b"") for text in values.dictionary)
                    total += longest * len(values)
    return total
