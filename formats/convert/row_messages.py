"""A dataset's frame rows as MCAP messages, exact to the bit, readable by any Protobuf reader."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
import pyarrow as pa
from google.protobuf import descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import (
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)

from ..core.errors import FileFormatError
from ..lerobot.layout import Features
from ..lerobot.units.rows import number_schema, row_arrays, unit_rows
from ..mcap.camera_streams import topic_messages
from ..mcap.recording import Contents, Recording, nanoseconds
from ..mcap.topics import Write

ROW_TOPIC = "/dataset/frame"
SCHEMA_NAME = "vlnpe.DatasetFrame"
_TYPES = {"float32": FieldDescriptorProto.TYPE_FLOAT, "int64": FieldDescriptorProto.TYPE_INT64}


def row_messages(
    recording: Recording, rows: pa.Table, features: Features, frames_per_second: int
) -> Iterator[Write]:
    """Yield one message per frame row, on `ROW_TOPIC`; images are left out.

    Raises:
        ValueError: a feature of a type that messages do not have.
    """
    file = _definition(features)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(SCHEMA_NAME))
    definition = FileDescriptorSet(file=[file]).SerializeToString(deterministic=True)
    channel = foxglove.Channel(
        ROW_TOPIC,
        schema=foxglove.Schema(name=SCHEMA_NAME, encoding="protobuf", data=definition),
        message_encoding="protobuf",
        context=recording.context,
    )
    arrays = row_arrays(rows)
    for i in range(rows.num_rows):
        fields = {_field(key): np.ravel(values[i]).tolist() for key, values in arrays.items()}
        data = kind(**fields).SerializeToString(deterministic=True)
        at = nanoseconds(i / frames_per_second)
        yield at, lambda data=data, at=at: channel.log(data, log_time=at)


def read_rows(contents: Contents, path: Path, features: Features, count: int) -> pa.Table:
    """Return the inverse of `row_messages`.

    Raises:
        FileFormatError: messages are missing, or do not have the features' fields.
    """
    messages: list[Any] = topic_messages(contents, path, ROW_TOPIC, count)
    try:
        columns = {}
        for key in number_schema(features).names:
            values = [list(getattr(message, _field(key))) for message in messages]
            size = int(np.prod(features[key]["shape"]))
            columns[key] = np.array(values, features[key]["dtype"]).reshape(count, size)
        return unit_rows(columns, features)
    except (AttributeError, KeyError, TypeError, ValueError, pa.ArrowException) as error:
        raise FileFormatError(path, f"{ROW_TOPIC} does not fit its features: {error!r}") from error


def _definition(features: Features) -> FileDescriptorProto:
    file = FileDescriptorProto(name="vlnpe/dataset_frame.proto", package="vlnpe", syntax="proto3")
    message = file.message_type.add(name=SCHEMA_NAME.partition(".")[2])
    for number, key in enumerate(number_schema(features).names, 1):
        dtype = features[key]["dtype"]
        if dtype not in _TYPES:
            raise ValueError(f"feature {key} of type {dtype}; valid: {', '.join(_TYPES)}")
        message.field.add(
            name=_field(key),
            number=number,
            label=FieldDescriptorProto.LABEL_REPEATED,
            type=_TYPES[dtype],
        )
    return file


def _field(key: str) -> str:
    return key.replace(".", "_")
