"""InternData-N1's layout: links, false arrays and tables, pickle, recursion, NaN."""

import json
import os
import shutil
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.formats.internnav.conftest import layout, units, written  # noqa: F401 (fixtures)
from tests.security.hostile import DEEP_JSON, not_files, put, refusal
from vlnpe.formats.internnav.reader import find_scenes, is_layout, read_layout_episode

RGB = "videos/chunk-000/observation.images.rgb/episode_000000.npy"
DEPTH = "videos/chunk-000/observation.images.depth/episode_000000.npy"
ROWS = "data/chunk-000/episode_000000.parquet"
META = (
    "meta/info.json",
    "meta/tasks.jsonl",
    "meta/episodes_stats.jsonl",
    "meta/vlnpe_episodes.jsonl",
)


@pytest.fixture
def scene(layout: Path) -> Path:  # noqa: F811
    (found,) = find_scenes(layout)
    return found.folder


def test_the_sound_scene_is_read(scene: Path) -> None:
    assert len(read_layout_episode(scene, 0).rgb) == 9


@not_files
@pytest.mark.parametrize("name", [RGB, DEPTH, ROWS, "meta/info.json", "meta/tasks.jsonl"])
def test_only_regular_files_are_read(name: str, kind: str, scene: Path) -> None:
    (scene / name).unlink()
    complaint = put(kind, scene / name)
    assert complaint in refusal(lambda: read_layout_episode(scene, 0)).reason


@pytest.mark.parametrize("name", [RGB, DEPTH, ROWS, *META])
def test_links_out_of_the_folder_are_refused(name: str, scene: Path, tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    shutil.move(scene / name, outside)
    (scene / name).symlink_to(outside)
    assert "leads out of" in refusal(lambda: read_layout_episode(scene, 0)).reason


def test_links_in_a_circle_are_not_followed(layout: Path) -> None:  # noqa: F811
    for folder in [layout, *(p for p in layout.rglob("*") if p.is_dir())]:
        (folder / "again").symlink_to(layout)
    assert is_layout(layout)
    assert len(find_scenes(layout)) == 1


def npy(shape: str, dtype: str = "'|u1'", data: bytes = b"", extra: str = "") -> bytes:
    header = f"{{'descr': {dtype}, 'fortran_order': False, 'shape': {shape}, {extra}}}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data


class Evil:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, ("touch owned",)


def pickled(path: Path) -> None:
    with path.open("wb") as stream:
        np.lib.format.write_array(stream, np.array([Evil()], dtype=object), allow_pickle=True)


@pytest.mark.parametrize(
    "content",
    [
        npy("(9, 1000000, 1000000, 3)"),
        npy("(9, 4611686018427387904, 4, 3)"),
        npy("(-9, 64, 96, 3)"),
        npy("(9, 64, 96, 3)", data=b"\0" * 100),
        npy("(" * 3000),
        npy("[" * 9000 + "]" * 9000),
        npy("__import__('os').system('true')"),
        npy("(9,)", dtype="'|O'", data=b"\x80\x04."),
        npy("(9,)", dtype="[('a', '|O')]"),
        npy("(0, 64, 96, 3)"),
        npy("(9, 64, 96, 3)", dtype="'<f8'", data=b"\xff" * (9 * 64 * 96 * 3 * 8)),
        npy("()", data=b"\0"),
        b"\x93NUMPY\x03\x00\xff\xff\xff\xff",
        b"\x93NUMPY",
        b"PK\x03\x04",
        b"\x80\x04\x95",
        b"",
    ],
)
@pytest.mark.parametrize("name", [RGB, DEPTH])
def test_false_arrays_are_refused(name: str, content: bytes, scene: Path) -> None:
    (scene / name).write_bytes(content)
    refusal(lambda: read_layout_episode(scene, 0))


def test_pickle_is_never_loaded(
    scene: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in (RGB, DEPTH):
        pickled(scene / name)
        refusal(lambda: read_layout_episode(scene, 0))
    assert not (tmp_path / "owned").exists()


@pytest.mark.parametrize("name", META)
@pytest.mark.parametrize("text", [DEEP_JSON, "\xff", "9" * 5000, "{", "[]", '"x"', "\0"])
def test_damaged_metadata_is_named(name: str, text: str, scene: Path) -> None:
    (scene / name).write_text(text, "latin-1")
    error = refusal(lambda: read_layout_episode(scene, 0))
    assert error.path == scene / name


@pytest.mark.parametrize(
    "line",
    [
        {"episode_index": 0, "task_index": {"min": 0, "max": 1e308}},
        {"episode_index": 0, "task_index": {"min": float("nan"), "max": 1}},
        {"episode_index": 0, "task_index": {"min": float("-inf"), "max": float("inf")}},
        {"episode_index": 0, "task_index": {"min": [[[[0]]]], "max": ["x" * 10_000]}},
        {"episode_index": 0, "task_index": "x" * 100_000},
        {"episode_index": 0, "stats": 5},
    ],
)
def test_false_statistics_are_named_or_harmless(line: dict[str, Any], scene: Path) -> None:
    (scene / "meta/episodes_stats.jsonl").write_text(json.dumps(line))
    try:
        episode = read_layout_episode(scene, 0)
    except Exception:
        refusal(lambda: read_layout_episode(scene, 0))
    else:
        assert episode.tasks


def changed(scene: Path, name: str, values: Any) -> None:
    table = pq.read_table(scene / ROWS)
    pq.write_table(table.set_column(table.schema.names.index(name), name, values), scene / ROWS)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e300, None, "x", []])
@pytest.mark.parametrize("name", ["observation.robot_yaw", "observation.camera_position"])
def test_numbers_must_be_finite_and_as_many(name: str, value: Any, scene: Path) -> None:
    changed(scene, name, pa.array([value] * 9))
    refusal(lambda: read_layout_episode(scene, 0))


def test_tables_of_few_bytes_and_many_rows_are_refused(
    scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Equal numbers take next to nothing on disk."""
    table = pq.read_table(scene / ROWS)
    many = pa.concat_tables([table.slice(0, 1)] * 1).take(pa.array([0] * 200_000))
    pq.write_table(many, scene / ROWS)
    assert "200,000 rows" in refusal(lambda: read_layout_episode(scene, 0)).reason
    monkeypatch.setenv("VLNPE_LIMITS", "table_bytes=1000000")
    assert "bytes in memory" in refusal(lambda: read_layout_episode(scene, 0)).reason


def test_long_texts_written_once_and_repeated_are_refused(
    scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = pq.read_table(scene / ROWS).take(pa.array([0] * 20_000))
    pq.write_table(table.append_column("note", pa.array(["x" * 10_000] * 20_000)), scene / ROWS)
    assert (scene / ROWS).stat().st_size < 1 << 20
    monkeypatch.setenv("VLNPE_LIMITS", f"table_bytes={50 << 20}")
    assert "bytes in memory" in refusal(lambda: read_layout_episode(scene, 0)).reason
