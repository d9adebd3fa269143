"""Rows of an episode from a damaged file; the readers of torch are tested in `test_loaders`."""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from vlnpe.datasets.episode_index import DatasetIndex, EpisodeEntry
from vlnpe.datasets.episode_reader import EpisodeReader
from vlnpe.formats.core.errors import FileFormatError


@pytest.mark.parametrize(("text", "valid"), [("ö".encode(), True), ("ö".encode("latin-1"), False)])
def test_texts_that_are_not_utf8_are_named(text: bytes, valid: bool, tmp_path: Path) -> None:
    path = tmp_path / "rows.parquet"
    offsets = pa.array([0, len(text)], pa.int32()).buffers()[1]
    notes = pa.StringArray.from_buffers(1, offsets, pa.py_buffer(text))
    pq.write_table(pa.table({"index": [0], "note": notes}), path)
    features = {"note": {"dtype": "string", "shape": [1]}}
    reader = EpisodeReader(DatasetIndex(tmp_path, {"features": features, "fps": 4}, pa.table({})))
    entry = EpisodeEntry(
        number=0,
        length=1,
        first_frame=0,
        rows=path,
        videos={},
        uid="train/house/0",
        trajectory="house/0",
        scene="house",
        split="train",
        robot="aliengo",
        controller="path",
        light="baked",
        end_reason="success",
        instructions=(),
        camera="ego",
        actions_derived=False,
    )
    if valid:
        assert reader.rows(entry, ["note"])["note"].tolist() == [["ö"]]
    else:
        with pytest.raises(FileFormatError, match=r"rows\.parquet.*UTF"):
            reader.rows(entry, ["note"])
