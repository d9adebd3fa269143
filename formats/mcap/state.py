"""The robot's state at one sample as a Protobuf message with exact doubles.

All messages of a rollout have the same length, so that they are made and read as one array: each
is its field tags and lengths, which never change, with the numbers between them. Any Protobuf
reader (Foxglove's plots, too) reads them by the schema in the file.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.descriptor_pb2 import (
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from numpy.typing import NDArray

from ..core.arrays import U8
from ..core.errors import FileFormatError
from ..core.rollout import Rollout

SCHEMA_NAME = "vlnpe.RobotState"
DOUBLE, BOOL = FieldDescriptorProto.TYPE_DOUBLE, FieldDescriptorProto.TYPE_BOOL
FIXED64, LENGTH_DELIMITED = 1, 2  # wire types


@dataclass(frozen=True)
class _Field:
    """A field of the message: a rollout's array, one row per message."""

    name: str
    dtype: str
    scalar: bool = False


# In order of field numbers, which must never change. `time_s` first; vectors are packed.
_VECTORS = (
    *("position_world_m", "quat_wxyz", "linear_velocity_base_m_s", "angular_velocity_base_rad_s"),
    *("joint_position_rad", "joint_velocity_rad_s", "joint_torque_nm", "command"),
)
FIELDS = (
    _Field("time_s", "<f8", scalar=True),
    *(_Field(name, "<f8") for name in _VECTORS),
    _Field("foot_contact", "|b1"),
    _Field("imu", "<f8"),
    _Field("floor_z_m", "<f8", scalar=True),
    _Field("foot_force_n", "<f8"),
)


def state_schema() -> bytes:
    """Return the message's definition, a serialised FileDescriptorSet."""
    file = FileDescriptorProto(name="vlnpe/robot_state.proto", package="vlnpe", syntax="proto3")
    message = file.message_type.add(name=SCHEMA_NAME.partition(".")[2])
    once, repeated = FieldDescriptorProto.LABEL_OPTIONAL, FieldDescriptorProto.LABEL_REPEATED
    for number, item in enumerate(FIELDS, 1):
        label, kind = once if item.scalar else repeated, DOUBLE if item.dtype == "<f8" else BOOL
        message.field.add(name=item.name, number=number, label=label, type=kind)
    return FileDescriptorSet(file=[file]).SerializeToString(deterministic=True)


def encode_states(rollout: Rollout) -> list[bytes]:
    """Return one message per sample."""
    count = len(rollout.time_s)
    parts = []
    for number, item in enumerate(FIELDS, 1):
        values = np.asarray(getattr(rollout, item.name), dtype=item.dtype).reshape(count, -1)
        payload = np.ascontiguousarray(values).view(np.uint8).reshape(count, -1)
        head = np.frombuffer(_head(number, item, payload.shape[1]), np.uint8)
        parts += [np.broadcast_to(head, (count, len(head))), payload]
    return [row.tobytes() for row in np.concatenate(parts, axis=1)]


def decode_states(messages: list[bytes], path: Path) -> dict[str, NDArray[Any]]:
    """Return rollout arrays by name from the messages of one rollout."""
    if not messages or len({len(message) for message in messages}) != 1:
        raise FileFormatError(path, "state messages are missing or of different lengths")
    rows = np.frombuffer(b"".join(messages), np.uint8).reshape(len(messages), -1)
    arrays, at = {}, 0
    for number, item in enumerate(FIELDS, 1):
        if item.name == "foot_force_n" and at == rows.shape[1]:  # recorded before forces were
            arrays[item.name] = np.full(arrays["foot_contact"].shape, np.nan)
            break
        size, start = _read_head(rows[0], at, number, item, path)
        if np.any(rows[:, at:start] != rows[0, at:start]):
            raise FileFormatError(path, f"state field {item.name} changes its size")
        payload = np.ascontiguousarray(rows[:, start : start + size])
        values = payload.view(item.dtype).reshape(len(messages), -1)
        # A copy: arrays over a file's bytes would be read-only.
        arrays[item.name] = (values[:, 0] if item.scalar else values).copy()
        at = start + size
    if at != rows.shape[1]:
        raise FileFormatError(path, "state messages have unknown fields")
    return arrays


def _head(number: int, item: _Field, size: int) -> bytes:
    if item.scalar:
        return bytes([number << 3 | FIXED64])
    length = bytearray()
    while size >= 0x80:
        length.append(size & 0x7F | 0x80)
        size >>= 7
    return bytes([number << 3 | LENGTH_DELIMITED, *length, size])


def _read_head(row: U8, at: int, number: int, item: _Field, path: Path) -> tuple[int, int]:
    """Return the size of a field's payload and where it starts."""
    size, shift, start = 8 if item.scalar else 0, 0, at + 1
    if not item.scalar:
        while start < len(row):
            byte = int(row[start])
            size |= (byte & 0x7F) << shift
            shift, start = shift + 7, start + 1
            if byte < 0x80:
                break
    tag = row[at : at + 1].tolist() == list(_head(number, item, size)[:1])
    if not tag or start + size > len(row) or size % np.dtype(item.dtype).itemsize:
        raise FileFormatError(path, f"state field {number} is not {item.name}")
    return size, start
