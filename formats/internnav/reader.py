"""Read the VLN-PE layout, checking all that its loaders take for granted."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FileFormatError
from ..untrusted.arrays import map_array
from ..untrusted.documents import read_json_object
from ..untrusted.tables import read_table
from . import layout
from .episode_tasks import read_tasks
from .layout import COLUMNS, read_lines

MAX_DEPTH = 3  # folders between a root and its scenes' trajectories
MAX_NUMBER = 1e6  # of metres, radians or rows: more is damage
MAX_ROWS = 100_000  # of an episode
_UNIT_NORM = 1e-3
_TRAJECTORY = re.compile(r"(trajectory|episode|traj)?[_-]?\d+")


@dataclass(frozen=True)
class SceneFolder:
    """A folder with data/, meta/ and videos/: a scene's, or one trajectory's.

    Attributes:
        folder: where it lies.
        scan, scene: names, from the folders' names; `scan` may be empty.
        episodes: numbers of its episodes, in order.
    """

    folder: Path
    scan: str
    scene: str
    episodes: tuple[int, ...]


@dataclass(frozen=True)
class LayoutEpisode:
    """One episode; T rows.

    Attributes:
        columns: those of `COLUMNS`, (T,) or (T, D), and others that are there.
        rgb: (T, H, W, 3) uint8; lies on disk.
        depth: (T, H, W) float, metres / 10; lies on disk.
        tasks: instructions without repetitions.
        finish_status, fail_reason: as written; "" where unknown.
        info: meta/info.json.
        timestamp_step_s: seconds between rows by their timestamps; None if unknown.
        unit: index of the unit that our own writer had, or None.
    """

    columns: dict[str, NDArray[Any]]
    rgb: NDArray[np.uint8]
    depth: NDArray[Any]
    tasks: tuple[str, ...]
    finish_status: str
    fail_reason: str
    info: dict[str, Any]
    timestamp_step_s: float | None
    unit: dict[str, Any] | None


def find_scenes(root: Path) -> list[SceneFolder]:
    """Return all scenes under `root`: of a whole dataset, one scan, one scene or one trajectory.

    Raises:
        FileFormatError: there is none.
    """
    scenes = []
    for folder in dataset_folders(root):
        if (folder / "data").is_dir():
            episodes = sorted(
                int(path.stem.partition("_")[2])
                for path in folder.glob("data/chunk-*/episode_*.parquet")
                if path.stem.partition("_")[2].isdigit()
            )
            place = folder.resolve()
            if _TRAJECTORY.fullmatch(place.name):
                place = place.parent
            scenes.append(SceneFolder(folder, place.parent.name, place.name, tuple(episodes)))
    if not scenes:
        raise FileFormatError(root, f"contains no VLN-PE scene (a folder with {layout.INFO_PATH})")
    return scenes


def is_layout(root: Path) -> bool:
    """Return whether a folder has VLN-PE's layout, and not only other LeRobot v2.1 datasets.

    Frames of the layout are .npy files, and its features have the names that InternNav reads.

    Raises:
        FileFormatError: If a meta/info.json is damaged.
    """
    return any(_is_scene(folder) for folder in dataset_folders(root))


def dataset_folders(root: Path) -> Iterator[Path]:
    """Yield every folder with meta/info.json that is `root` or lies up to `MAX_DEPTH` below it."""
    return (f for f in _folders(root, MAX_DEPTH) if (f / layout.INFO_PATH).is_file())


def read_layout_episode(folder: Path, number: int) -> LayoutEpisode:
    """Read and check one episode of a scene's folder.

    Raises:
        FileFormatError: a file is missing or corrupt, numbers of rows differ, or values are
            impossible.
    """
    info = read_json_object(folder / layout.INFO_PATH, root=folder)
    columns = _read_columns(folder / _place(layout.DATA_PATH, number), folder)
    rgb = map_array(folder / _place(layout.VIDEO_PATH, number, layout.RGB_KEY), root=folder)
    depth_path = folder / _place(layout.VIDEO_PATH, number, layout.DEPTH_KEY)
    depth = map_array(depth_path, root=folder)
    if depth.ndim == 4 and depth.shape[3] == 1:
        depth = depth[..., 0]
    if rgb.ndim != 4 or depth.ndim not in (3, 4):
        raise FileFormatError(
            folder,
            f"episode {number}: colour {rgb.shape}, depth {depth.shape}; valid: (T, H, W, …)",
        )
    count = len(columns["observation.action"])
    if not count == len(rgb) == len(depth):
        raise FileFormatError(
            folder,
            f"episode {number}: {count} rows, {len(rgb)} colour and {len(depth)} depth frames",
        )
    if rgb.dtype != np.uint8 or rgb.ndim != 4 or rgb.shape[3] != 3:
        raise FileFormatError(
            folder, f"episode {number}: colour {rgb.dtype} {rgb.shape}; valid: (T, H, W, 3) uint8"
        )
    if depth.dtype.kind != "f" or depth.shape != rgb.shape[:3]:
        raise FileFormatError(
            depth_path, f"{depth.dtype} {depth.shape}; valid: floats {rgb.shape[:3]}"
        )
    tasks = read_tasks(folder, number, columns.get("task_index"))
    stamps = columns.get("timestamp")
    if stamps is not None and (stamps.dtype.kind not in "iuf" or stamps.ndim != 1):
        raise FileFormatError(folder, f"episode {number}: timestamp; valid: one number a row")
    step = float(np.median(np.diff(stamps))) if stamps is not None and count > 1 else None
    return LayoutEpisode(
        columns=columns,
        rgb=rgb,
        depth=depth,
        tasks=tasks.texts,
        finish_status=tasks.finish_status,
        fail_reason=tasks.fail_reason,
        info=info,
        timestamp_step_s=step,
        unit=_kept_unit(folder, number),
    )


def read_dataset_facts(folder: Path) -> dict[str, Any] | None:
    """Return the facts of the dataset that our own writer kept, or None.

    Raises:
        FileFormatError: damaged.
    """
    path = folder / layout.DATASET_PATH
    return read_json_object(path, root=folder) if path.is_file() else None


def _is_scene(folder: Path) -> bool:
    if any(folder.glob("videos/*/*/*.npy")):
        return True
    features = read_json_object(folder / layout.INFO_PATH).get("features")
    return isinstance(features, dict) and not {*COLUMNS} - {*features}


def _folders(root: Path, depth: int) -> Iterator[Path]:
    yield root
    if depth and root.is_dir() and not (root / "meta").is_dir():
        for path in sorted(root.iterdir()):
            if path.is_dir() and not path.is_symlink():
                yield from _folders(path, depth - 1)


def _place(template: str, number: int, key: str = "") -> str:
    chunk = number // layout.EPISODES_PER_CHUNK
    return template.format(episode_chunk=chunk, episode_index=number, video_key=key)


def _read_columns(path: Path, folder: Path) -> dict[str, NDArray[Any]]:
    table = read_table(path, root=folder)
    missing = sorted(set(COLUMNS) - set(table.schema.names))
    if missing:
        raise FileFormatError(path, f"no column {missing[0]}")
    if not 0 < table.num_rows <= MAX_ROWS:
        raise FileFormatError(path, f"{table.num_rows:,} rows; valid: 1 … {MAX_ROWS:,}")
    columns = {}
    for name in table.schema.names:
        try:
            values = np.array(table[name].to_pylist())
        except ValueError as error:
            raise FileFormatError(path, f"column {name} has rows of different lengths") from error
        if name in COLUMNS:
            dtype, size = COLUMNS[name]
            if values.dtype.kind not in "iuf" or values.size != size * len(values):
                raise FileFormatError(path, f"column {name}; valid: {size} numbers per row")
            if not np.all(np.isfinite(values)):
                raise FileFormatError(path, f"column {name} is not finite everywhere")
            if np.any(np.abs(values) > MAX_NUMBER):
                raise FileFormatError(
                    path, f"column {name} contains {np.abs(values).max():.3g}, which is implausible"
                )
            values = values.astype(dtype).reshape((-1, size) if size > 1 else (-1,))
        columns[name] = values
    for name in ("observation.camera_orientation", "observation.robot_orientation"):
        norm = np.linalg.norm(columns[name], axis=1)
        if np.any(np.abs(norm - 1.0) > _UNIT_NORM):
            worst = float(norm[np.argmax(np.abs(norm - 1.0))])
            raise FileFormatError(path, f"column {name}: a quaternion of length {worst:.3g}")
    actions = columns["observation.action"]
    invalid = (actions < 0) | (actions > 3)
    if np.any(invalid):
        raise FileFormatError(path, f"action {actions[invalid][0]}; valid: 0 to 3")
    return columns


def _kept_unit(folder: Path, number: int) -> dict[str, Any] | None:
    path = folder / layout.UNITS_PATH
    if not path.is_file():
        return None
    for line in read_lines(path):
        if line.get("episode_index") == number:
            return line.get("unit")
    raise FileFormatError(path, f"no episode {number}")
