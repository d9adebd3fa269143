"""The LeRobot v3.0 layout: names of files, limits, and the schema of the frame rows."""

import json
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

CODEBASE_VERSION = "v3.0"
CHUNK_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
DATA_PATH = "data/" + CHUNK_FILE + ".parquet"
VIDEO_PATH = "videos/{video_key}/" + CHUNK_FILE + ".mp4"
EPISODES_PATH = "meta/episodes/" + CHUNK_FILE + ".parquet"
INFO_PATH = "meta/info.json"
STATS_PATH = "meta/stats.json"
TASKS_PATH = "meta/tasks.parquet"
PROVENANCE_PATH = "meta/provenance.json"  # ours: unknown keys in info.json are lost on rewrite
SPLITS_PATH = "meta/splits.json"  # ours: LeRobot's own splits are index ranges

RGB_KEY = "observation.images.rgb"
DEPTH_KEY = "observation.images.depth"

# Columns that LeRobot adds to every dataset, in its order. The first two belong to an episode,
# the others depend on its place in a dataset.
EPISODE_ROWS = {"timestamp": "float32", "frame_index": "int64"}
DATASET_ROWS = {"episode_index": "int64", "index": "int64", "task_index": "int64"}

Features = dict[str, dict[str, Any]]

# An image within a row: an encoded file, and its name with the format as its suffix.
IMAGE_TYPE = pa.struct([("bytes", pa.binary()), ("path", pa.string())])


@dataclass(frozen=True)
class FileLimits:
    """Sizes at which a new file begins; the defaults are LeRobot's."""

    files_per_chunk: int = 1000
    data_mb: float = 100
    video_mb: float = 200


@dataclass(frozen=True)
class FilePlace:
    """Position of a file in the chunked layout."""

    chunk_index: int = 0
    file_index: int = 0

    def next(self, limits: FileLimits) -> "FilePlace":
        """Return the place of the file after this one."""
        if self.file_index + 1 == limits.files_per_chunk:
            return FilePlace(self.chunk_index + 1, 0)
        return FilePlace(self.chunk_index, self.file_index + 1)

    def path(self, template: str, **names: str) -> str:
        """Fill a path template."""
        return template.format(chunk_index=self.chunk_index, file_index=self.file_index, **names)


def automatic_features() -> Features:
    """Return the entries of info.json for the automatic columns."""
    return {
        key: {"dtype": dtype, "shape": [1], "names": None}
        for key, dtype in (EPISODE_ROWS | DATASET_ROWS).items()
    }


def row_schema(features: Features, without: tuple[str, ...] = ()) -> pa.Schema:
    """Return the schema of the frame rows, with the metadata by which `datasets` types them."""
    fields, hub_features = [], {}
    for key, feature in features.items():
        if feature["dtype"] == "video" or key in without:
            continue
        if feature["dtype"] == "image":
            fields.append(pa.field(key, IMAGE_TYPE))
            hub_features[key] = {"_type": "Image"}
            continue
        value = {"dtype": feature["dtype"], "_type": "Value"}
        if list(feature["shape"]) == [1]:
            fields.append(pa.field(key, _arrow_type(feature["dtype"])))
            hub_features[key] = value
        else:
            (size,) = feature["shape"]
            element = pa.field("element", _arrow_type(feature["dtype"]))
            fields.append(pa.field(key, pa.list_(element, size)))
            hub_features[key] = {"feature": value, "length": size, "_type": "List"}
    return pa.schema(fields, {"huggingface": json.dumps({"info": {"features": hub_features}})})


def tasks_table(tasks: list[str]) -> pa.Table:
    """Return the tasks in index order, as pandas would store a frame with the index `task`."""

    def column(name: str, pandas_type: str, numpy_type: str) -> dict[str, Any]:
        types = {"pandas_type": pandas_type, "numpy_type": numpy_type}
        return {"name": name, "field_name": name, **types, "metadata": None}

    pandas = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [column("task_index", "int64", "int64"), column("task", "unicode", "object")],
        "attributes": {},
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": "2.2.0",
    }
    schema = pa.schema(
        [("task_index", pa.int64()), ("task", pa.string())], {"pandas": json.dumps(pandas)}
    )
    return pa.table([pa.array(range(len(tasks)), pa.int64()), pa.array(tasks, pa.string())], schema)


def _arrow_type(dtype: str) -> pa.DataType:
    return {"float32": pa.float32(), "int64": pa.int64()}[dtype]
