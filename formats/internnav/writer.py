"""Write episode units as one scene's folder of the VLN-PE layout."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.lib.format import open_memmap
from numpy.typing import NDArray

from ..convert.frame_rollout import frame_rollout, frame_view
from ..convert.stored_depth import depth_range_of, depth_video
from ..convert.units import UnitParts
from ..core.atomic import atomic_folder
from ..core.errors import FileFormatError
from ..core.frames import OPTICAL_IN_BODY, matrix_to_quat, quat_multiply, quat_to_yaw
from ..core.rollout import EndReason
from ..lerobot import layout as v3
from ..lerobot.episode_columns import camera_of
from ..lerobot.statistics import column_statistics
from ..lerobot.unit import EpisodeUnit, read_episode_unit
from ..lerobot.unit_rows import row_arrays
from ..rendered.discrete_steps import discrete_steps, planar_poses
from ..rendered.table import planar_motion
from ..video.mp4 import iterate_depth_video, iterate_rgb_video
from ..vlnce.vocabulary import Vocabulary
from . import layout
from .layout import AUTOMATIC_COLUMNS, COLUMNS

# Body axes (x forward, z up) in the optical frame.
_BODY_IN_OPTICAL = matrix_to_quat(OPTICAL_IN_BODY.T)


@dataclass(frozen=True)
class SceneEpisode:
    """A unit and the instructions under which it is to be trained.

    Attributes:
        folder: the unit's.
        tasks: at least one; the first is what the robot was told.
    """

    folder: Path
    tasks: tuple[str, ...]


def share_instructions(units: Sequence[EpisodeUnit]) -> list[tuple[str, ...]]:
    """Instructions of each unit: its own, and those of its path that no other unit was told.

    So every paraphrase is trained once, and none can be taken for another episode's.
    """
    told = {(unit.columns["scene_id"], unit.columns["trajectory_id"], unit.task) for unit in units}
    result = []
    for unit in units:
        path = (unit.columns["scene_id"], unit.columns["trajectory_id"])
        tasks = [unit.task]
        for text in unit.columns["instructions"]:
            if (*path, text) not in told:
                told.add((*path, text))
                tasks.append(text)
        result.append(tuple(tasks))
    return result


def write_scene(
    out: Path,
    episodes: Sequence[SceneEpisode],
    vocabulary: Vocabulary,
    dataset: Mapping[str, Any] | None = None,
    every_frame: bool = False,
) -> int:
    """Write one scene's folder, replaced as a whole; return the number of rows.

    Memory does not grow with the number of frames, but for one episode's.

    Args:
        out: `<root>/<scan>/<scene>`.
        episodes: of one robot, camera and frame rate.
        vocabulary: for the instructions' tokens.
        dataset: facts of the dataset they come from (JSON values).
        every_frame: one row per frame, with `action.discrete`, instead of one per discrete step
            (see `formats.rendered.discrete_steps`).

    Raises:
        FileFormatError: a unit is damaged or differs from the first; with `every_frame`, one that
            has no discrete actions.
    """
    units = [read_episode_unit(episode.folder) for episode in episodes]
    first, frames, task_index = units[0], 0, 0
    with atomic_folder(out) as temporary:
        (temporary / "meta").mkdir()
        tasks: list[dict[str, Any]] = []
        lines: list[dict[str, Any]] = []
        statistics: list[dict[str, Any]] = []
        kept: list[dict[str, Any]] = []
        for number, (unit, episode) in enumerate(zip(units, episodes, strict=True)):
            if (unit.robot, unit.features) != (first.robot, first.features):
                raise FileFormatError(
                    unit.folder, f"robot or features differ from those of {first.folder.name}"
                )
            with depth_video(unit) as depth:
                shown, unit, rows = _chosen_rows(unit, every_frame)
                columns = _columns(unit, rows, number, frames, task_index, depth)
                _write_table(temporary, number, columns)
                _write_frames(temporary, number, unit, depth, shown)
            own = [_task(unit, task_index + k, t, vocabulary) for k, t in enumerate(episode.tasks)]
            tasks += own
            lines.append(
                {"episode_index": number, "tasks": list(episode.tasks), "length": unit.length}
            )
            last = task_index + len(own) - 1
            statistics.append(
                {
                    "episode_index": number,
                    "stats": {k: _statistics(values) for k, values in columns.items()},
                    "task_index": {"min": task_index, "max": last, "count": unit.length},
                }
            )
            kept.append({"episode_index": number, "unit": UnitParts.of(unit).to_json()})
            frames, task_index = frames + unit.length, last + 1
        _write_lines(temporary / layout.TASKS_PATH, tasks)
        _write_lines(temporary / layout.EPISODES_PATH, lines)
        _write_lines(temporary / layout.STATS_PATH, statistics)
        _write_lines(temporary / layout.UNITS_PATH, kept)
        if dataset is not None:
            (temporary / layout.DATASET_PATH).write_text(json.dumps(dict(dataset), indent=2))
        info = _info(first, len(units), frames, task_index)
        (temporary / layout.INFO_PATH).write_text(json.dumps(info, indent=4) + "\n")
    return frames


def finish_status(end_reason: str) -> tuple[str, str]:
    """`finish_status` and `fail_reason` of an end reason, in the loaders' words."""
    if end_reason == EndReason.SUCCESS:
        return "success", "success"
    if end_reason == EndReason.STUCK:
        return "stuck", "stuck"
    return "fail", end_reason


def _chosen_rows(
    unit: EpisodeUnit, every_frame: bool
) -> tuple[NDArray[np.int64], EpisodeUnit, dict[str, NDArray[Any]]]:
    """Which frames the rows show, the unit as if it had these alone, and its columns then."""
    rows = row_arrays(unit.rows())
    if every_frame:
        if "action.discrete" not in rows:
            raise FileFormatError(
                unit.folder,
                f"no action.discrete at {unit.frames_per_second} frames/s; valid: 4 frames/s",
            )
        return np.arange(unit.length), unit, rows
    steps = discrete_steps(planar_poses(rows["observation.state"]))
    count = len(steps.frame)
    rows = {key: values[steps.frame] for key, values in rows.items()}
    state = rows["observation.state"].astype(np.float64)
    index = np.arange(count)
    changed: dict[str, NDArray[Any]] = {
        "action": planar_motion(state[:, :3], state[:, 3:7]),
        "action.discrete": steps.action[:, None],
        "timestamp": index / unit.frames_per_second,
        "frame_index": index,
    }
    rows |= {
        k: v.astype(rows[k].dtype).reshape(rows[k].shape) for k, v in changed.items() if k in rows
    }
    known = {k: column_statistics(v) for k, v in rows.items() if k in unit.statistics}
    stepped = replace(unit, length=count, statistics=unit.statistics | known)
    return steps.frame, stepped, rows | {"action.discrete": changed["action.discrete"]}


def _columns(
    unit: EpisodeUnit,
    rows: Mapping[str, NDArray[Any]],
    number: int,
    frames: int,
    task: int,
    depth: Path,
) -> dict[str, NDArray[Any]]:
    """The loaders' columns, LeRobot's, and the unit's own."""
    rollout, view = frame_rollout(unit, rows), frame_view(unit, rows, depth)
    camera = quat_multiply(view.arrays["camera_quat_wxyz"], _BODY_IN_OPTICAL)
    count = unit.length
    index = np.arange(count)
    columns: dict[str, NDArray[Any]] = {
        "observation.camera_position": view.arrays["camera_position_world_m"],
        "observation.camera_orientation": camera,
        "observation.camera_yaw": quat_to_yaw(camera),
        "observation.robot_position": rollout.position_world_m,
        "observation.robot_orientation": rollout.quat_wxyz,
        "observation.robot_yaw": quat_to_yaw(rollout.quat_wxyz),
        "observation.progress": np.ravel(rows["observation.progress"]),
        "observation.step": index,
        "observation.action": np.ravel(rows["action.discrete"]),
        "timestamp": index / unit.frames_per_second,
        "frame_index": index,
        "episode_index": np.full(count, number),
        "index": index + frames,
        "task_index": np.full(count, task),
    }
    # Names that both layouts use hold the same numbers in both.
    return columns | {key: values for key, values in rows.items() if key not in columns}


def _write_table(root: Path, number: int, columns: Mapping[str, NDArray[Any]]) -> None:
    known = COLUMNS | AUTOMATIC_COLUMNS
    kinds = {
        name: known.get(name) or (str(values.dtype), int(np.prod(values.shape[1:])))
        for name, values in columns.items()
    }
    schema = layout.table_schema(kinds)
    arrays = []
    for name, (dtype, size) in kinds.items():
        values = np.ascontiguousarray(columns[name], dtype=dtype).reshape(-1)
        flat = pa.array(values)
        field = schema.field(name)
        arrays.append(
            flat if size == 1 else pa.FixedSizeListArray.from_arrays(flat, type=field.type)
        )
    path = root / _place(layout.DATA_PATH, number)
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.Table.from_arrays(arrays, schema=schema), path)


def _write_frames(
    root: Path, number: int, unit: EpisodeUnit, depth: Path, shown: NDArray[np.int64]
) -> None:
    """Write the frames of the ascending numbers `shown`, some of which may repeat."""
    repeats = np.bincount(shown).tolist()
    colours = iterate_rgb_video(unit.video(v3.RGB_KEY))
    _write_images(root, number, layout.RGB_KEY, unit.length, _repeated(colours, repeats))
    depths = (stored_depth(image) for image in iterate_depth_video(depth, depth_range_of(unit)))
    _write_images(root, number, layout.DEPTH_KEY, unit.length, _repeated(depths, repeats))


def _repeated(images: Iterable[NDArray[Any]], repeats: Sequence[int]) -> Iterator[NDArray[Any]]:
    """Yield each image as many times as told; those behind the last number not at all."""
    for image, times in zip(images, repeats, strict=False):
        for _ in range(times):
            yield image


def stored_depth(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Depth [m], 0 = nothing there, as the layout stores it."""
    scaled = np.where(depth_m > 0, depth_m / np.float32(layout.DEPTH_UNIT_M), np.float32(1))
    return np.minimum(scaled, np.float32(1)).astype(np.float32)


def _write_images(
    root: Path, number: int, key: str, count: int, images: Iterable[NDArray[Any]]
) -> None:
    path = root / _place(layout.VIDEO_PATH, number, video_key=key)
    path.parent.mkdir(parents=True, exist_ok=True)
    out: Any = None
    done = 0
    for image in images:
        if out is None:
            out = open_memmap(path, "w+", image.dtype, (count, *image.shape))
        out[done] = image
        done += 1
    if done != count:
        raise FileFormatError(path, f"{done} images, the unit has {count} frames")
    out.flush()


def _task(unit: EpisodeUnit, index: int, text: str, vocabulary: Vocabulary) -> dict[str, Any]:
    status, reason = finish_status(unit.columns["end_reason"])
    return {
        "task_index": index,
        "task": text,
        "instruction_text": text,
        "instruction_tokens": vocabulary.encode(text, layout.TOKENS),
        "finish_status": status,
        "fail_reason": reason,
        "episode_id": unit.columns["episode_id"],
        "trajectory_id": unit.columns["trajectory_id"],
    }


def _info(unit: EpisodeUnit, episodes: int, frames: int, tasks: int) -> dict[str, Any]:
    known = COLUMNS | AUTOMATIC_COLUMNS
    features: dict[str, Any] = {
        name: {"dtype": dtype, "shape": [size], "names": None}
        for name, (dtype, size) in known.items()
    }
    height, width, _ = unit.features[v3.RGB_KEY]["shape"]
    names = ["height", "width", "channels"]
    for key, channels in ((layout.RGB_KEY, 3), (layout.DEPTH_KEY, 1)):
        features[key] = {"dtype": "image", "shape": [height, width, channels], "names": names}
    return {
        "codebase_version": layout.VERSION,
        "robot_type": unit.robot,
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": tasks,
        "total_videos": 2 * episodes,
        "total_chunks": -(-episodes // layout.EPISODES_PER_CHUNK),
        "chunks_size": layout.EPISODES_PER_CHUNK,
        "fps": unit.frames_per_second,
        "splits": {"train": f"0:{episodes}"},
        "data_path": layout.DATA_PATH,
        "video_path": layout.VIDEO_PATH,
        "features": features,
        # Ours: without it nobody can unproject the depth.
        "camera": camera_of(unit.columns).to_json(),
    }


def _statistics(values: NDArray[Any]) -> dict[str, Any]:
    flat = np.asarray(values, np.float64).reshape(len(values), -1)
    return {
        "min": flat.min(axis=0).tolist(),
        "max": flat.max(axis=0).tolist(),
        "mean": flat.mean(axis=0).tolist(),
        "std": flat.std(axis=0).tolist(),
        "count": [len(flat)],
    }


def _place(template: str, number: int, **names: str) -> str:
    chunk = number // layout.EPISODES_PER_CHUNK
    return template.format(episode_chunk=chunk, episode_index=number, **names)


def _write_lines(path: Path, values: Sequence[Mapping[str, Any]]) -> None:
    path.write_text("".join(json.dumps(value, ensure_ascii=False) + "\n" for value in values))
