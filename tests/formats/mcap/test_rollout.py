"""Rollouts come back from MCAP bit by bit, and damage is noticed."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, unknown_fields
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mcap.reader import make_reader
from mcap.records import DataEnd
from mcap.stream_reader import StreamReader

from tests.support.rollouts import make_rollout
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.core.rollout import Rollout
from vlnpe.formats.mcap.rollout import read_rollout, write_rollout

SHARED_FOLDER = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def assert_same(a: object, b: object) -> None:
    """Equal in type, shape and every bit."""
    assert type(a) is type(b)
    if isinstance(a, np.ndarray):
        assert isinstance(b, np.ndarray)
        assert (a.dtype, a.shape) == (b.dtype, b.shape)
        assert a.tobytes() == b.tobytes()
    elif dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            assert_same(getattr(a, field.name), getattr(b, field.name))
    else:
        assert a == b


def message_type(name: str, definition: bytes) -> Any:
    """Return the class of a message that a file's schema describes."""
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(definition).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))


@pytest.mark.parametrize("discrete", [False, True])
def test_a_rollout_comes_back_exactly(tmp_path: Path, discrete: bool) -> None:
    rollout = make_rollout(5.0, 3, discrete=discrete, fall=True)
    write_rollout(tmp_path / "a.mcap", rollout)
    back = read_rollout(tmp_path / "a.mcap")
    assert_same(rollout, back)
    back.position_world_m[0] = 1.0  # arrays are the caller's own


@settings(SHARED_FOLDER, max_examples=25)
@given(data=st.data(), joints=st.integers(0, 40), feet=st.integers(0, 5))
def test_any_numbers_come_back_exactly(
    tmp_path: Path, data: st.DataObject, joints: int, feet: int
) -> None:
    rollout = make_rollout(0.05)
    count = len(rollout.time_s)
    numbers = arrays(np.float64, (count, joints), elements=st.floats(width=64))
    changed = dataclasses.replace(
        rollout,
        joint_names=tuple(f"j{i}" for i in range(joints)),
        joint_position_rad=data.draw(numbers),
        joint_velocity_rad_s=np.full((count, joints), -0.0),
        joint_torque_nm=np.full((count, joints), np.nan),
        foot_names=tuple(f"f{i}" for i in range(feet)),
        foot_contact=data.draw(arrays(np.bool_, (count, feet))),
        foot_force_n=np.full((count, feet), 3.5),
        facts={"text": data.draw(st.text()), "numbers": [1, 0.1, None, True]},
    )
    write_rollout(tmp_path / "a.mcap", changed)
    assert_same(changed, read_rollout(tmp_path / "a.mcap"))


def test_one_sample_is_enough(tmp_path: Path) -> None:
    rollout = make_rollout(0.0)
    write_rollout(tmp_path / "a.mcap", rollout)
    assert_same(rollout, read_rollout(tmp_path / "a.mcap"))


def test_a_foreign_reader_sees_ordered_times_and_known_schemas(tmp_path: Path) -> None:
    rollout = make_rollout(4.0)
    write_rollout(tmp_path / "a.mcap", rollout)
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        schemas = {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()}
        counts = summary.statistics.channel_message_counts
        topics = {c.topic: counts[c.id] for c in summary.channels.values()}
        times = [message.log_time for *_, message in reader.iter_messages(log_time_order=False)]
    assert schemas == {
        "/state": "vlnpe.RobotState",
        "/tf": "foxglove.FrameTransforms",
        "/base/pose": "foxglove.PoseInFrame",
        "/joint_states": "foxglove.JointStates",
        "/events": "foxglove.Log",
    }
    assert topics["/state"] == 401 and topics["/tf"] == 81
    assert times == sorted(times)
    assert times[-1] == 4_000_000_000


def test_the_state_is_readable_by_any_protobuf_reader(tmp_path: Path) -> None:
    rollout = make_rollout(1.0)
    write_rollout(tmp_path / "a.mcap", rollout)
    with (tmp_path / "a.mcap").open("rb") as file:
        messages = list(make_reader(file, validate_crcs=True).iter_messages("/state"))
    schema = messages[0][0]
    assert schema is not None and schema.encoding == "protobuf"
    state_type = message_type(schema.name, schema.data)
    for i in (0, 50, 100):
        state = state_type.FromString(messages[i][2].data)
        assert state.time_s == rollout.time_s[i]
        assert list(state.quat_wxyz) == rollout.quat_wxyz[i].tolist()
        assert list(state.joint_torque_nm) == rollout.joint_torque_nm[i].tolist()
        assert list(state.foot_contact) == rollout.foot_contact[i].tolist()
        assert len(unknown_fields.UnknownFieldSet(state)) == 0


def test_the_same_rollout_gives_the_same_data_section(tmp_path: Path) -> None:
    sums = []
    for name in ("a", "b"):
        write_rollout(tmp_path / name, make_rollout(2.0))
        with (tmp_path / name).open("rb") as file:
            ends = [record for record in StreamReader(file).records if isinstance(record, DataEnd)]
        sums += [end.data_section_crc for end in ends]
    assert sums[0] == sums[1] != 0


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("written") / "a.mcap"
    write_rollout(path, make_rollout(3.0))
    return path.read_bytes()


@pytest.mark.parametrize("part", [0.0, 0.001, 0.01, 0.3, 0.5, 0.9, 0.95, 0.99, 0.9999])
def test_truncated_files_are_refused(written: bytes, tmp_path: Path, part: float) -> None:
    path = tmp_path / "cut.mcap"
    path.write_bytes(written[: int(len(written) * part)])
    with pytest.raises(FileFormatError, match=r"cut\.mcap"):
        read_rollout(path)


@settings(SHARED_FOLDER, max_examples=60)
@given(place=st.floats(0.0, 0.9999), flip=st.integers(1, 255))
def test_a_flipped_byte_is_noticed_or_harmless(
    written: bytes, tmp_path: Path, place: float, flip: int
) -> None:
    damaged = bytearray(written)
    damaged[int(len(written) * place)] ^= flip
    path = tmp_path / "flipped.mcap"
    path.write_bytes(damaged)
    try:
        back = read_rollout(path)
    except FileFormatError:
        return
    assert_same(make_rollout(3.0), back)


@pytest.mark.parametrize("content", [b"", b"no mcap", b"\x89MCAP0\r\n"])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "other.mcap"
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match=r"other\.mcap"):
        read_rollout(path)
    with pytest.raises(FileFormatError, match="no such file"):
        read_rollout(tmp_path / "none.mcap")


def test_an_mcap_without_a_rollout_is_refused(tmp_path: Path) -> None:
    from vlnpe.formats.mcap.recording import open_recording

    with open_recording(tmp_path / "a.mcap") as recording:
        recording.writer.write_metadata("other", {"a": "b"})
    with pytest.raises(FileFormatError, match=r"vlnpe\.rollout is missing"):
        read_rollout(tmp_path / "a.mcap")


def test_a_failing_writer_leaves_nothing(tmp_path: Path) -> None:
    rollout: Rollout = dataclasses.replace(make_rollout(1.0), facts={"bad": object()})
    with pytest.raises(TypeError):
        write_rollout(tmp_path / "a.mcap", rollout)
    assert list(tmp_path.iterdir()) == []
