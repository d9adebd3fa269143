"""Damaged layouts are named."""

import contextlib
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.formats.internnav.layouts import (
    DEPTH,
    RGB,
    make_foreign,
)
from vlnpe.formats.core.errors import FileFormatError, InputError
from vlnpe.formats.internnav.foreign import Assumptions
from vlnpe.formats.internnav.reader import find_scenes
from vlnpe.formats.internnav.to_unit import unit_from_layout
from vlnpe.formats.lerobot import read_episode_unit


def damage_rows(path: Path, name: str, change: Any) -> None:
    table = pq.read_table(path)
    values = change(np.array(table[name].to_pylist()))
    at = table.schema.names.index(name)
    pq.write_table(table.set_column(at, name, pa.array(values.tolist())), path)


def set_entry(value: Any) -> Any:
    def change(values: np.ndarray) -> np.ndarray:
        values[1] = value
        return values

    return change


DAMAGE: dict[str, str] = {
    "cut colour": "truncated or corrupt",
    "pickled depth": "truncated or corrupt",
    "strange header": "truncated or corrupt",
    "negative length": "truncated or corrupt",
    "far away": r"column observation.robot_position contains 1e\+200",
    "no colour": "no such file",
    "fewer rows": "8 rows, 9 colour and 9 depth frames",
    "fewer depths": "9 rows, 9 colour and 7 depth frames",
    "float colour": r"valid: \(T, H, W, 3\) uint8",
    "other size": "valid: floats",
    "no parquet": "not readable",
    "no column": "no column observation.robot_yaw",
    "not finite": "not finite",
    "no rotation": "a quaternion of length 0",
    "strange action": "action 7; valid: 0 to 3",
    "negative action": "action -2; valid: 0 to 3",
    "timestamp of words": "timestamp; valid: one number a row",
    "no statistics, no rows": "no instruction for episode 0",
    "task of words": "task_index 'x'; valid: a whole number",
    "half a task": "task_index 0.5; valid: a whole number",
    "list of tasks": r"task_index \[0, 1\]; valid: its min and max",
    "empty span": r"task_index \[\]; valid: a whole number",
    "unnumbered task": "task_index 'x'; valid: a whole number",
    "rows of words": "task_index of its rows; valid: one whole number per row",
    "no instruction": "no instruction for episode 0",
    "half a line": r"tasks\.jsonl: not JSON",
}


def write_task_statistics(scene: Path, statistics: dict[str, Any]) -> None:
    """Replace the line of episode 0 in episodes_stats.jsonl."""
    path = scene / "meta/episodes_stats.jsonl"
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    lines[0] = {"episode_index": 0, **statistics}
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


def break_layout(scene: Path, damage: str) -> None:
    rows = scene / "data/chunk-000/episode_000000.parquet"
    rgb = scene / f"videos/chunk-000/{RGB}/episode_000000.npy"
    depth = scene / f"videos/chunk-000/{DEPTH}/episode_000000.npy"
    tasks = scene / "meta/tasks.jsonl"
    match damage:
        case "cut colour":
            rgb.write_bytes(rgb.read_bytes()[:-1000])
        case "pickled depth":
            np.save(depth, np.array([{"a": 1}], dtype=object), allow_pickle=True)
        case "strange header":
            rgb.write_bytes(rgb.read_bytes().replace(b"'descr'", b"'\x02escr", 1))
        case "negative length":
            rgb.write_bytes(rgb.read_bytes().replace(b"(9, 64", b"(-9,64", 1))
        case "far away":
            damage_rows(rows, "observation.robot_position", set_entry(1e200))
        case "no colour":
            rgb.unlink()
        case "fewer rows":
            pq.write_table(pq.read_table(rows).slice(0, 8), rows)
        case "fewer depths":
            np.save(depth, np.load(depth)[:7])
        case "float colour":
            np.save(rgb, np.load(rgb).astype(np.float32))
        case "other size":
            np.save(depth, np.load(depth)[:, :32])
        case "no parquet":
            rows.write_bytes(b"PAR1")
        case "no column":
            pq.write_table(pq.read_table(rows).drop_columns(["observation.robot_yaw"]), rows)
        case "not finite":
            damage_rows(rows, "observation.robot_yaw", set_entry(np.nan))
        case "no rotation":
            damage_rows(rows, "observation.robot_orientation", set_entry(0.0))
        case "strange action":
            damage_rows(rows, "observation.action", set_entry(7))
        case "negative action":
            damage_rows(rows, "observation.action", set_entry(-2))
        case "timestamp of words":
            damage_rows(rows, "timestamp", lambda values: np.full(len(values), "x"))
        case "no statistics, no rows":
            write_task_statistics(scene, {})
            (scene / "meta/episodes.jsonl").unlink()
            pq.write_table(pq.read_table(rows).drop_columns(["task_index"]), rows)
        case "task of words":
            write_task_statistics(scene, {"task_index": {"min": "x", "max": 0}})
        case "half a task":
            write_task_statistics(scene, {"task_index": {"min": 0, "max": 0.5}})
        case "list of tasks":
            write_task_statistics(scene, {"task_index": [0, 1]})
        case "empty span":
            write_task_statistics(scene, {"stats": {"task_index": {"min": [], "max": [0]}}})
        case "unnumbered task":
            lines = [json.loads(line) | {"task_index": "x"} for line in tasks.open()]
            tasks.write_text("\n".join(map(json.dumps, lines)))
        case "rows of words":
            write_task_statistics(scene, {})
            damage_rows(rows, "task_index", lambda values: np.full(len(values), "x"))
        case "no instruction":
            tasks.write_text("\n".join(tasks.read_text().splitlines()[2:]) + "\n")
        case "half a line":
            tasks.write_text(tasks.read_text()[:-30])


@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_episodes_are_named(layout: Path, tmp_path: Path, damage: str) -> None:
    (scene,) = find_scenes(make_foreign(layout))
    break_layout(scene.folder, damage)
    with pytest.raises(FileFormatError, match=DAMAGE[damage]):
        unit_from_layout(scene, 0, tmp_path / "out" / "u", Assumptions())
    assert not (tmp_path / "out").exists() or list((tmp_path / "out").iterdir()) == []


@settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data(), foreign=st.booleans())
def test_any_damage_is_named_or_harmless(
    layout: Path, tmp_path: Path, data: st.DataObject, foreign: bool
) -> None:
    scene = tmp_path / "damaged" / "r2r" / "s"
    shutil.rmtree(scene, ignore_errors=True)
    shutil.copytree(layout / "r2r" / "two-rooms", scene)
    if foreign:
        (scene / "meta" / "vlnpe_episodes.jsonl").unlink()
    path = data.draw(st.sampled_from(sorted(p for p in scene.rglob("*") if p.is_file())))
    content = bytearray(path.read_bytes())
    place = data.draw(st.one_of(st.integers(0, 200), st.integers(0, len(content) - 1)))
    content[min(place, len(content) - 1)] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    with contextlib.suppress(FileFormatError, InputError):
        (found,) = find_scenes(scene)
        unit_from_layout(found, 0, tmp_path / "u", Assumptions(robot="h1"))
        read_episode_unit(tmp_path / "u")
