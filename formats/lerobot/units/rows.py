"""Frame rows of a unit: without the columns that depend on the place in a dataset."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa

from ...core.camera import DepthRange
from ...video.depth_codes import codes_to_millimetres, encode_depth_tiff
from ...video.depth_images import CODEC, iterate_depth_files
from ...video.mp4 import iterate_depth_codes
from ...video.stream import probe_video
from ..layout import DATASET_ROWS, DEPTH_KEY, IMAGE_TYPE, Features, row_schema


def unit_schema(features: Features) -> pa.Schema:
    """Return the schema of a unit's frame rows."""
    return row_schema(features, without=tuple(DATASET_ROWS))


def number_schema(features: Features) -> pa.Schema:
    """Return the schema of a unit's frame rows without images."""
    images = tuple(key for key, feature in features.items() if feature["dtype"] == "image")
    return row_schema(features, without=(*DATASET_ROWS, *images))


def unit_rows(columns: Mapping[str, np.ndarray], features: Features) -> pa.Table:
    """Return the frame rows, without images, of arrays (N, D) or (N,), by feature."""
    schema = number_schema(features)
    arrays = []
    for field in schema:
        values = columns[field.name]
        if pa.types.is_fixed_size_list(field.type):
            flat = _numbers(values, field.type.value_type)
            arrays.append(pa.FixedSizeListArray.from_arrays(flat, type=field.type))
        else:
            arrays.append(_numbers(values, field.type))
    return pa.Table.from_arrays(arrays, schema=schema)


def _numbers(values: np.ndarray, kind: pa.DataType) -> pa.Array:
    """Return numbers as an Arrow array (N,), not of truth values, which Arrow packs into bits.

    `pa.array` imports pandas wherever it is installed, which takes a worker 0.3 s.
    """
    flat = np.ascontiguousarray(values).astype(kind.to_pandas_dtype(), casting="same_kind").ravel()
    return pa.Array.from_buffers(kind, len(flat), [None, pa.py_buffer(flat)])


def row_arrays(rows: pa.Table) -> dict[str, np.ndarray]:
    """Return the inverse of `unit_rows`: arrays (N, D), or (N,) of single numbers.

    Images are left out.
    """
    result = {}
    for name in rows.schema.names:
        column = rows[name].combine_chunks()
        if pa.types.is_struct(column.type):
            continue
        if pa.types.is_fixed_size_list(column.type):
            flat = column.flatten().to_numpy(zero_copy_only=False)
            result[name] = flat.reshape(len(rows), column.type.list_size)
        else:
            result[name] = column.to_numpy(zero_copy_only=False)
    return result


def stores_images(features: Features) -> bool:
    """Return whether depth is stored in the rows as images instead of in a video."""
    return features[DEPTH_KEY]["dtype"] == "image"


def with_depth_images(
    rows: pa.Table, features: Features, video: Path, depth_range: DepthRange
) -> pa.Table:
    """Add the frames of a depth video to rows of numbers, as images of whole millimetres.

    One at a time: only their encoded bytes are held.
    """
    schema = unit_schema(features)
    if probe_video(video).codec == CODEC:
        files = iterate_depth_files(video)
    else:
        codes = iterate_depth_codes(video, depth_range)
        files = (encode_depth_tiff(codes_to_millimetres(image, depth_range)) for image in codes)
    data = pa.array(list(files), pa.binary())
    names = pa.array([f"frame-{number:06d}.tiff" for number in range(len(data))])
    images = pa.StructArray.from_arrays([data, names], fields=list(IMAGE_TYPE))
    table = rows.append_column(schema.field(DEPTH_KEY), images).select(schema.names)
    return table.replace_schema_metadata(schema.metadata)
