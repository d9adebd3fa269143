"""A scene in LeRobot v2.1's shape, as InternNav's loaders read it: tables and metadata."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from .subset import folder_of, write_lines
from .walks import Walk

RGB, DEPTH = "observation.images.rgb", "observation.images.depth"


def write_table(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write columns (N, …) as nested lists: loaders take matrices apart row by row."""
    folder_of(path.parent)
    arrays = [_nested(values) for values in columns.values()]
    pq.write_table(pa.Table.from_arrays(arrays, names=list(columns)), path)


def write_meta(
    folder: Path,
    walk: Walk,
    episodes: Sequence[tuple[str, int]],
    features: Mapping[str, Any],
    statistics: Sequence[Mapping[str, Any]],
) -> None:
    """Write `meta/` of a scene.

    Args:
        walk: One of its episodes, for robot, camera and rate.
        episodes: Task and number of rows of each.
        features: Entries of info.json.
        statistics: A line of episodes_stats.jsonl for each episode.
    """
    meta = folder_of(folder / "meta")
    tasks = list(dict.fromkeys(task for task, _ in episodes))
    write_lines(
        meta / "episodes.jsonl",
        (
            {"episode_index": number, "tasks": [task], "length": length}
            for number, (task, length) in enumerate(episodes)
        ),
    )
    write_lines(
        meta / "tasks.jsonl", ({"task_index": k, "task": task} for k, task in enumerate(tasks))
    )
    write_lines(meta / "episodes_stats.jsonl", statistics)
    info = {
        "codebase_version": "v2.1",
        "robot_type": walk.unit.robot,
        "total_episodes": len(episodes),
        "total_frames": sum(length for _, length in episodes),
        "total_tasks": len(tasks),
        "chunks_size": 1000,
        "fps": walk.unit.frames_per_second,
        "splits": {"train": f"0:{len(episodes)}"},
        "features": dict(features),
        "camera": walk.camera.to_json(),
    }
    (meta / "info.json").write_text(json.dumps(info, indent=2) + "\n")


def picture_features(
    walk: Walk, suffix: str, per_metre: int, range_m: tuple[float, float], beyond: str
) -> dict[str, Any]:
    """Return the entries of the images, which state the unit and range of depth."""
    camera = walk.camera
    size = [camera.height_px, camera.width_px]
    names = ["height", "width", "channels"]
    depth = {
        "is_depth_map": True,
        "dtype": "uint16",
        "depth_unit_m": 1 / per_metre,
        "depth_min_m": range_m[0],
        "depth_max_m": range_m[1],
        "beyond": beyond,
        "invalid": 0,
    }
    return {
        f"{RGB}{suffix}": {"dtype": "image", "shape": [*size, 3], "names": names},
        f"{DEPTH}{suffix}": {"dtype": "image", "shape": [*size, 1], "names": names, "info": depth},
    }


def column_features(columns: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Return the entries of the columns."""
    return {
        name: {"dtype": str(values.dtype), "shape": list(values.shape[1:]) or [1], "names": None}
        for name, values in columns.items()
    }


def _nested(values: NDArray[Any]) -> pa.Array:
    flat = pa.array(np.ascontiguousarray(values).reshape(-1))
    for size in values.shape[:0:-1]:
        flat = pa.FixedSizeListArray.from_arrays(flat, size)
    return flat
