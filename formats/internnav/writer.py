"""Write episode units as one scene's folder of the VLN-PE layout."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ..convert.stored_depth import depth_video
from ..core.atomic import atomic_folder
from ..core.errors import FileFormatError
from ..core.rollout import EndReason
from ..lerobot import layout as v3
from ..lerobot.episode_columns import camera_of
from ..lerobot.units.unit import EpisodeUnit, read_episode_unit
from ..vlnce.vocabulary import Vocabulary
from . import layout
from .images import write_frames
from .layout import AUTOMATIC_COLUMNS, COLUMNS
from .rows import chosen_rows, row_columns


@dataclass(frozen=True)
class SceneEpisode:
    """A unit and the instructions under which it is to be trained.

    Attributes:
        tasks: at least one; the first is the one that the robot followed.
    """

    folder: Path
    tasks: tuple[str, ...]


def share_instructions(units: Sequence[EpisodeUnit]) -> list[tuple[str, ...]]:
    """Return the instructions of each unit: its own, and those of its path that no other unit has.

    So every paraphrase is trained once, and none can be taken for another episode's.
    """
    taken = {(unit.columns["scene_id"], unit.columns["trajectory_id"], unit.task) for unit in units}
    result = []
    for unit in units:
        path = (unit.columns["scene_id"], unit.columns["trajectory_id"])
        tasks = [unit.task]
        for text in unit.columns["instructions"]:
            if (*path, text) not in taken:
                taken.add((*path, text))
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

    Memory is bounded by the longest episode, not by the number of frames.

    Args:
        out: `<root>/<scan>/<scene>`.
        episodes: of one robot, camera and frame rate.
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
                shown, unit, rows = chosen_rows(unit, every_frame)
                columns = row_columns(unit, rows, number, frames, task_index, depth)
                _write_table(temporary, number, columns)
                write_frames(temporary, number, unit, depth, shown)
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
            kept.append({"episode_index": number, "unit": unit.to_json()})
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
    """Return `finish_status` and `fail_reason` of an end reason, in the loaders' words."""
    if end_reason == EndReason.SUCCESS:
        return "success", "success"
    if end_reason == EndReason.STUCK:
        return "stuck", "stuck"
    return "fail", end_reason


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
    path = root / layout.place(layout.DATA_PATH, number)
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.Table.from_arrays(arrays, schema=schema), path)


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
        # An addition of vlnpe, without which the depth cannot be unprojected.
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


def _write_lines(path: Path, values: Sequence[Mapping[str, Any]]) -> None:
    path.write_text("".join(json.dumps(value, ensure_ascii=False) + "\n" for value in values))
