"""Names, columns and conventions of the VLN-PE layout.

    <root>/<scan>/<scene>/
      data/chunk-000/episode_000000.parquet
      videos/chunk-000/observation.images.rgb/episode_000000.npy     (T, H, W, 3) uint8
      videos/chunk-000/observation.images.depth/episode_000000.npy   (T, H, W) float32, metres / 10
      meta/{info.json, episodes.jsonl, episodes_stats.jsonl, tasks.jsonl}

`scan` says whose data it is: `r2r` (the humanoid), `r2r_aliengo`, `r2r_flash` (no physics).
A row is one discrete action: what is observed precedes `observation.action`. Poses are in the
world, z up, quaternions wxyz; the camera's frame looks along its x axis, z up.
"""

import json
from pathlib import Path
from typing import Any

import pyarrow as pa

from ..core.errors import FileFormatError
from ..untrusted.documents import parse_json
from ..untrusted.files import read_input
from ..untrusted.limits import limits

VERSION = "v2.1"
EPISODES_PER_CHUNK = 1000
DATA_PATH = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
VIDEO_PATH = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.npy"
INFO_PATH = "meta/info.json"
TASKS_PATH = "meta/tasks.jsonl"
EPISODES_PATH = "meta/episodes.jsonl"
STATS_PATH = "meta/episodes_stats.jsonl"
# Ours: what the layout has no place for, so that our own data loses nothing but pixels.
UNITS_PATH = "meta/vlnpe_episodes.jsonl"
DATASET_PATH = "meta/vlnpe_dataset.json"
VOCABULARY_NAME = "instruction_vocab.json"

RGB_KEY = "observation.images.rgb"
DEPTH_KEY = "observation.images.depth"
DEPTH_UNIT_M = 10.0  # stored depth is metres over this; 1 is that far or farther, or nothing there

IMAGE_SIZE_PX = 256  # what InternNav's encoders take; its files may hold other sizes
TOKENS = 200  # of an instruction, padded with 0
VOCABULARY_SIZE = 2504  # words that InternNav's CMA and Seq2Seq have embeddings for

# Columns that the loaders read: name → (number type, size).
COLUMNS: dict[str, tuple[str, int]] = {
    "observation.camera_position": ("float64", 3),
    "observation.camera_orientation": ("float64", 4),
    "observation.camera_yaw": ("float64", 1),
    "observation.robot_position": ("float64", 3),
    "observation.robot_orientation": ("float64", 4),
    "observation.robot_yaw": ("float64", 1),
    "observation.progress": ("float64", 1),
    "observation.step": ("int64", 1),
    "observation.action": ("int64", 1),
}
AUTOMATIC_COLUMNS: dict[str, tuple[str, int]] = {
    "timestamp": ("float32", 1),
    "frame_index": ("int64", 1),
    "episode_index": ("int64", 1),
    "index": ("int64", 1),
    "task_index": ("int64", 1),
}
_ARROW = {"float64": pa.float64(), "float32": pa.float32(), "int64": pa.int64()}

# The second part of a loader's key is the scene, its parts are joined by "_", and these are taken.
_RESERVED_SCENES = ("flash", "aliengo")


SCANS = ("r2r", "r2r_aliengo", "r2r_flash")


def scan_name(robot: str, controller: str) -> str:
    """Return the folder of a robot's data, one of `SCANS`, the only ones that loaders read.

    Left to themselves they read `r2r` alone, and the others when they are asked for.
    """
    if controller == "flash":
        return "r2r_flash"
    return "r2r_aliengo" if robot == "aliengo" else "r2r"


def scene_name(scene_id: str) -> str:
    """Return a scene's folder: the last part of its id, without what the loaders split keys by."""
    name = scene_id.rstrip("/").rpartition("/")[2].partition(".")[0].replace("_", "-")
    return f"{name}-scene" if name in _RESERVED_SCENES else name


def arrow_type(dtype: str, size: int) -> pa.DataType:
    """Return the type of a parquet column."""
    return _ARROW[dtype] if size == 1 else pa.list_(pa.field("element", _ARROW[dtype]), size)


def table_schema(columns: dict[str, tuple[str, int]]) -> pa.Schema:
    """Return the schema of an episode's Parquet file, with metadata for `datasets`."""
    fields, hub = [], {}
    for name, (dtype, size) in columns.items():
        fields.append(pa.field(name, arrow_type(dtype, size)))
        value: dict[str, Any] = {"dtype": dtype, "_type": "Value"}
        hub[name] = value if size == 1 else {"feature": value, "length": size, "_type": "Sequence"}
    return pa.schema(fields, {"huggingface": json.dumps({"info": {"features": hub}})})


def place(template: str, number: int, **names: str) -> str:
    """Return the path of an episode's file, one of the templates above filled in."""
    chunk = number // EPISODES_PER_CHUNK
    return template.format(episode_chunk=chunk, episode_index=number, **names)


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Return one object per line.

    Raises:
        FileFormatError: missing, or a line is not a JSON object.
    """
    data = read_input(path, root=scene_folder(path), max_bytes=limits().json_bytes)
    values = [parse_json(path, line) for line in data.splitlines() if line.strip()]
    if not all(isinstance(value, dict) for value in values):
        raise FileFormatError(path, "a line is not a JSON object")
    return values


def scene_folder(path: Path) -> Path:
    """Return the scene's folder of a file in its `meta`."""
    return path.parents[1]
