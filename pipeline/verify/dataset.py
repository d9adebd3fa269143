"""Cross-check the tables, the index, the videos and the splits of one LeRobot dataset."""

import json
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ...formats.lerobot.layout import INFO_PATH, SPLITS_PATH, STATS_PATH, TASKS_PATH
from ...formats.lerobot.splits import is_published_holdout
from ...formats.video.stream import demux_packets, open_video

SEEN = "_seen"  # a hold-out whose name ends so shares its scenes with the training episodes
TIME_TOLERANCE_S = 1e-3


def check_dataset(path: Path) -> None:
    """Check one dataset.

    Raises:
        ValueError: If two of its parts contradict each other.
        Exception: Of any type if a file is damaged.
    """
    info = json.loads((path / INFO_PATH).read_text())
    episodes = _rows(path.glob("meta/episodes/*/*.parquet"))
    lengths = [int(e["length"]) for e in episodes]
    _agree("episodes", {"meta/info.json": info["total_episodes"], "meta/episodes": len(episodes)})
    _agree("frames", {"meta/info.json": info["total_frames"], "meta/episodes": sum(lengths)})
    tasks = pq.read_table(path / TASKS_PATH).to_pydict()
    _agree("tasks", {"meta/info.json": info["total_tasks"], TASKS_PATH: len(tasks["task"])})
    names = dict(zip(tasks["task_index"], tasks["task"], strict=True))
    _check_rows(path, episodes, names, int(info["fps"]))
    _check_videos(path, episodes, int(info["fps"]))
    _check_statistics(path, sum(lengths))
    splits_path = path / SPLITS_PATH
    if splits_path.is_file():
        check_splits(json.loads(splits_path.read_text()), episodes)


def check_splits(
    splits: Mapping[str, Sequence[int]], episodes: Sequence[Mapping[str, Any]]
) -> None:
    """Check that splits partition the episodes and that no path, nor scene, is in two.

    `val_seen` and other hold-outs of that name share scenes with training episodes on purpose.

    Args:
        splits: Indices of the episodes of each split.
        episodes: Rows of meta/episodes, in order; those of other tools lack scene and path.

    Raises:
        ValueError: If they do not.
    """
    listed = sorted(index for indices in splits.values() for index in indices)
    if listed != list(range(len(episodes))):
        raise ValueError(f"{SPLITS_PATH} does not name each of {len(episodes)} episodes once")
    if not episodes or "scene_id" not in episodes[0]:
        return
    scenes, paths = {}, {}
    for name, indices in splits.items():
        members = [episodes[index] for index in indices]
        scenes[name] = {e["scene_id"] for e in members}
        paths[name] = {(e["scene_id"], e["trajectory_id"]) for e in members}
    for first, second in combinations(sorted(splits), 2):
        for scene, trajectory in sorted(paths[first] & paths[second]):
            raise ValueError(f"path {trajectory} of {scene} is in splits {first} and {second}")
        if SEEN in (first[-len(SEEN) :], second[-len(SEEN) :]):
            continue
        if is_published_holdout(first) and is_published_holdout(second):
            continue
        for scene in sorted(scenes[first] & scenes[second]):
            raise ValueError(f"scene {scene} is in splits {first} and {second}")


def _check_rows(
    path: Path, episodes: Sequence[Mapping[str, Any]], tasks: Mapping[int, str], rate_hz: int
) -> None:
    files = sorted(path.glob("data/*/*.parquet"))
    columns = ["timestamp", "frame_index", "episode_index", "index", "task_index"]
    table = pa.concat_tables([pq.read_table(file, columns=columns) for file in files])
    rows = {name: table[name].to_numpy() for name in columns}
    lengths = np.array([int(e["length"]) for e in episodes])
    _agree("frames", {"data": table.num_rows, "meta/episodes": int(lengths.sum())})
    frame = np.concatenate([np.arange(n) for n in lengths])
    expected = {
        "index": np.arange(len(frame)),
        "frame_index": frame,
        "episode_index": np.repeat(np.arange(len(lengths)), lengths),
    }
    for name, values in expected.items():
        _first_wrong(f"data: column {name}", rows[name] != values)
    off_s = np.abs(rows["timestamp"] - frame / rate_hz)
    _first_wrong(f"data: timestamps at {rate_hz} frames/s", off_s > TIME_TOLERANCE_S)
    _first_wrong("data: column task_index", ~np.isin(rows["task_index"], list(tasks)))
    ends = np.cumsum(lengths)
    for k, episode in enumerate(episodes):
        start, end = int(ends[k] - lengths[k]), int(ends[k])
        if (episode["dataset_from_index"], episode["dataset_to_index"]) != (start, end):
            raise ValueError(f"meta/episodes: episode {k} does not span rows {start} to {end}")
        used = {tasks[int(t)] for t in np.unique(rows["task_index"][start:end])}
        if not used <= set(episode["tasks"]):
            raise ValueError(f"episode {k}: its rows have a task that meta/episodes does not name")


def _check_videos(path: Path, episodes: Sequence[Mapping[str, Any]], rate_hz: int) -> None:
    folder = path / "videos"
    keys = sorted(p.name for p in folder.iterdir()) if folder.is_dir() else []
    for key in keys:
        frames: dict[tuple[int, int], int] = {}
        for k, episode in enumerate(episodes):
            column = f"videos/{key}/"
            place = (episode[f"{column}chunk_index"], episode[f"{column}file_index"])
            start_s = frames.get(place, 0) / rate_hz
            frames[place] = frames.get(place, 0) + int(episode["length"])
            spans = (episode[f"{column}from_timestamp"], episode[f"{column}to_timestamp"])
            expected = (start_s, frames[place] / rate_hz)
            if any(abs(a - b) > TIME_TOLERANCE_S for a, b in zip(spans, expected, strict=True)):
                raise ValueError(f"{key}: episode {k} is not at {expected[0]:g} s in its video")
        for (chunk, number), count in frames.items():
            file = folder / key / f"chunk-{chunk:03d}" / f"file-{number:03d}.mp4"
            with open_video(file) as video:
                shown = sum(1 for _ in demux_packets(file, video, video.streams.video[0]))
            _agree("frames", {"meta/episodes": count, f"{key}/{file.name}": shown})


def _check_statistics(path: Path, frames: int) -> None:
    statistics = json.loads((path / STATS_PATH).read_text())
    for name, values in statistics.items():
        count = np.ravel(values["count"])[0]
        # Images are counted by sampled frames or by pixels.
        if not name.startswith("observation.images") and count != frames:
            raise ValueError(f"{STATS_PATH}: {name} counts {count} of {frames} frames")


def _rows(files: Any) -> list[dict[str, Any]]:
    return [row for file in sorted(files) for row in pq.read_table(file).to_pylist()]


def _agree(what: str, counts: Mapping[str, int]) -> None:
    if len(set(counts.values())) > 1:
        listed = ", ".join(f"{count} in {place}" for place, count in counts.items())
        raise ValueError(f"numbers of {what} differ: {listed}")


def _first_wrong(what: str, wrong: np.ndarray) -> None:
    if wrong.any():
        raise ValueError(f"{what}: row {int(np.argmax(wrong))} is wrong")
