"""MCAP: path traversal, decompression bombs, false sizes and counts, recursion, NaN."""

import io
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard

from tests.formats.convert.test_convert import export_mcap
from tests.security.hostile import DEEP_JSON, not_files, put, refusal
from tests.support.mcap_copies import rewritten
from tests.support.rollouts import make_rollout
from vlnpe.formats.convert.episodes import mcap_from_unit, unit_from_mcap
from vlnpe.formats.mcap.episode import FRAMES_ATTACHMENT, VIEW_METADATA
from vlnpe.formats.mcap.facts import METADATA_NAME
from vlnpe.formats.mcap.recording import read_recording
from vlnpe.formats.mcap.rollout import read_rollout, write_rollout
from vlnpe.formats.untrusted.arrays import read_arrays

MAGIC = b"\x89MCAP0\r\n"


@not_files
def test_only_regular_files_are_read(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    complaint = put(kind, path)
    assert complaint in refusal(lambda: read_recording(path)).reason


def record(opcode: int, body: bytes, length: int | None = None) -> bytes:
    return struct.pack("<BQ", opcode, len(body) if length is None else length) + body


def text(value: bytes) -> bytes:
    return struct.pack("<I", len(value)) + value


def chunk(data: bytes, size: int, compression: bytes = b"zstd", stated: int | None = None) -> bytes:
    head = struct.pack("<QQQI", 0, 0, size, 0) + text(compression)
    return record(6, head + struct.pack("<Q", len(data) if stated is None else stated) + data)


def mcap(*records: bytes) -> bytes:
    end = record(15, struct.pack("<I", 0)) + record(2, struct.pack("<QQI", 0, 0, 0))
    return MAGIC + record(1, text(b"") + text(b"")) + b"".join(records) + end + MAGIC


ZEROS = zstandard.compress(bytes(50 << 20))
UNSIZED = zstandard.ZstdCompressor(write_content_size=False).compress(bytes(50 << 20))
HOSTILE = {
    "a chunk that grows": mcap(chunk(ZEROS, 50 << 20)),
    "a chunk that grows more than it says": mcap(chunk(ZEROS, 100)),
    "a chunk of unstated size that grows": mcap(chunk(UNSIZED, 100)),
    "many chunks that grow": mcap(*[chunk(zstandard.compress(bytes(900_000)), 900_000)] * 20),
    "a chunk of exabytes": mcap(chunk(b"x", 1 << 62)),
    "a chunk of exabytes on disk": mcap(chunk(b"x", 1, stated=1 << 62)),
    "another compression": mcap(chunk(b"x" * 100, 100, b"lz4")),
    "a long name of a compression": mcap(chunk(b"x", 100, b"x" * 100_000)),
    "a record of exabytes": MAGIC + record(1, b"", 1 << 62),
    "a text of gigabytes": MAGIC + record(1, struct.pack("<I", 2**32 - 1)),
    "a message of no channel": mcap(record(5, struct.pack("<HIQQ", 7, 0, 0, 0))),
    "a count that lies": mcap(
        record(11, struct.pack("<QHIIIIQQ", 10**15, 0, 0, 0, 0, 0, 0, 0) + text(b""))
    ),
    "no end": MAGIC + record(1, text(b"") + text(b"")),
    "nothing": b"",
    "zeros": bytes(10_000),
    "metadata that is no text": mcap(record(12, text(b"\xff\xfe") + text(b""))),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_false_sizes_and_counts_are_refused(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VLNPE_LIMITS", f"mcap_bytes={10 << 20}")
    path = tmp_path / "a.mcap"
    path.write_bytes(HOSTILE[kind])
    refusal(lambda: read_recording(path))


def test_a_sparse_file_of_a_terabyte_is_refused(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as stream:
        stream.truncate(1 << 40)
    assert "too large" in refusal(lambda: read_recording(tmp_path / "a.mcap")).reason


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export_mcap(tmp_path_factory.mktemp("mcap"), make_rollout(1.0))


def with_facts(sound: Path, out: Path, change: Callable[[dict[str, Any]], Any], of: str) -> Path:
    def changed(name: str, value: str) -> str:
        if name != of:
            return value
        facts = json.loads(value)
        change(facts)
        return json.dumps(facts)

    return rewritten(sound, out, changed)


CLIMBING = [
    "../../owned.mp4",
    "/tmp/owned.mp4",
    "a/b.mp4",
    "..",
    ".mp4",
    "",
    "a\\b.mp4",
    5,
    None,
    "x" * 500 + ".mp4",
]


@pytest.mark.parametrize("name", CLIMBING)
@pytest.mark.parametrize("key", ["rgb", "depth"])
def test_videos_are_written_nowhere_else(key: str, name: Any, sound: Path, tmp_path: Path) -> None:
    path = with_facts(
        sound, tmp_path / "a.mcap", lambda facts: facts[key].update(file=name), VIEW_METADATA
    )
    before = set(tmp_path.rglob("*"))
    assert "file" in refusal(lambda: unit_from_mcap(path, tmp_path / "deep" / "out" / "u")).reason
    left = {p for p in tmp_path.rglob("*") if p.is_file()} - before
    assert not left


@pytest.mark.parametrize("name", CLIMBING[:6])
def test_label_videos_are_written_nowhere_else(name: str, sound: Path, tmp_path: Path) -> None:
    path = with_facts(
        sound,
        tmp_path / "a.mcap",
        lambda facts: facts.update(rgb2={"file": name, "codec": "png"}),
        VIEW_METADATA,
    )
    refusal(lambda: unit_from_mcap(path, tmp_path / "deep" / "out" / "u"))
    assert not [p for p in tmp_path.rglob("*") if p.is_file() and p != path]


def test_a_kept_rollout_writes_nowhere_else(sound: Path, tmp_path: Path) -> None:
    unit_from_mcap(sound, tmp_path / "u")
    blind = tmp_path / "u" / "rollout.mcap"
    spoilt = with_facts(
        blind, tmp_path / "b.mcap", lambda f: f["rgb"].update(file="../../owned.mp4"), VIEW_METADATA
    )
    spoilt.rename(blind)
    refusal(lambda: mcap_from_unit(tmp_path / "u", tmp_path / "deep" / "out.mcap"))
    assert not list(tmp_path.rglob("owned*"))


@pytest.mark.parametrize("value", [DEEP_JSON, "[" * 80 + "]" * 80, "9" * 5000, "[]", "5", "", "\0"])
@pytest.mark.parametrize("name", [METADATA_NAME, VIEW_METADATA])
def test_damaged_metadata_is_named(name: str, value: str, sound: Path, tmp_path: Path) -> None:
    path = rewritten(sound, tmp_path / "a.mcap", lambda n, old: value if n == name else old)
    refusal(lambda: unit_from_mcap(path, tmp_path / "u"))


def npz_bomb() -> bytes:
    """An archive whose arrays are many times what they take on disk."""
    stream = io.BytesIO()
    np.savez_compressed(stream, sample_index=np.zeros(5 << 20, np.uint8))
    return stream.getvalue()


@pytest.mark.parametrize("data", [npz_bomb(), b"", b"PK\x03\x04", b"\x93NUMPY", npz_bomb()[:-10]])
def test_damaged_attachments_are_named(
    data: bytes, sound: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VLNPE_LIMITS", f"array_bytes={1 << 20}")
    path = rewritten(
        sound,
        tmp_path / "a.mcap",
        attachment=lambda n, old: data if n == FRAMES_ATTACHMENT else old,
    )
    refusal(lambda: unit_from_mcap(path, tmp_path / "u"))


def test_pickled_arrays_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", allow_pickle=True, a=np.array([{}], dtype=object))
    refusal(lambda: read_arrays(tmp_path / "a.npz"))


@pytest.mark.parametrize(
    "change",
    [
        {"samples": 10**15},
        {"samples": float("nan")},
        {"joint_names": 5},
        {"actions": [[9, 0, 1]]},
        {"actions": [[1, -5, 10**12]]},
        {"episode": {"x": 1}},
        {"episode": []},
        {"end_reason": "x" * 100_000},
        {"format_version": "9" * 100_000},
        {"metrics": {"x" * 100_000: 1}},
        {"metrics": None},
    ],
)
def test_false_facts_are_named(change: dict[str, Any], tmp_path: Path) -> None:
    write_rollout(tmp_path / "good.mcap", make_rollout(0.2))
    path = with_facts(
        tmp_path / "good.mcap", tmp_path / "a.mcap", lambda f: f.update(change), METADATA_NAME
    )
    refusal(lambda: read_rollout(path))
