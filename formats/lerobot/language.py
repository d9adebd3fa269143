"""LeRobot's column `language_persistent`: all texts of a path, and the parts of its instruction.

LeRobot knows it since 0.6 and repeats the same rows in every frame of an episode. Rows of style
`task_aug` are wordings of the task, the task itself first; rows of style `subtask` are the parts of
the instruction, each from the time at which the part before was done.
"""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..core.rollout import Rollout
from .layout import Features

COLUMN = "language_persistent"
FEATURES: Features = {COLUMN: {"dtype": "language", "shape": [1], "names": None}}
_TEXT, _TIME = ({"dtype": kind, "_type": "Value"} for kind in ("string", "float32"))
_HUB = {"role": _TEXT, "content": _TEXT, "style": _TEXT, "timestamp": _TIME, "camera": _TEXT} | {
    "tool_calls": {"feature": _TEXT, "_type": "List"}
}
_ROW = pa.struct(
    [
        pa.field("role", pa.string()),
        pa.field("content", pa.string()),
        pa.field("style", pa.string()),
        pa.field("timestamp", pa.float32()),
        pa.field("camera", pa.string()),
        pa.field("tool_calls", pa.list_(pa.string())),
    ]
)
_REACHED_M = 0.1
_AHEAD_M = 1.5  # of the path searched for a robot's next place


def with_language(schema: pa.Schema) -> pa.Schema:
    """Return the schema of frame rows with the language column."""
    hub = json.loads(schema.metadata[b"huggingface"])
    hub["info"]["features"][COLUMN] = {"feature": _HUB, "_type": "List"}
    more = schema.append(pa.field(COLUMN, pa.list_(_ROW)))
    return more.with_metadata({"huggingface": json.dumps(hub)})


def language_column(columns: Mapping[str, Any], task: str, frames: int) -> pa.Array:
    """Return the column of an episode.

    Args:
        columns: Values of `EPISODE_COLUMNS`.
        task: The episode's instruction.
        frames: Number of its frames.
    """
    texts = dict.fromkeys([task, *columns["instructions"]])
    rows = [_row("user", text, "task_aug", 0.0) for text in texts]
    parts = zip(columns["subtasks"], columns["subtask_from_s"], strict=True)
    rows += [_row("assistant", text, "subtask", time_s) for text, time_s in parts]
    return pa.array([rows] * frames, pa.list_(_ROW))


def _row(role: str, content: str, style: str, time_s: float) -> dict[str, Any]:
    row = {"role": role, "content": content, "style": style, "timestamp": time_s}
    return row | {"camera": None, "tool_calls": None}


def subtasks(rollout: Rollout, samples: NDArray[np.int64]) -> tuple[list[str], list[float]]:
    """Return the parts of the instruction that the robot came to, and since when [s].

    The record of an instruction has them where its writer told what its words claim: `claims`, a
    list of steps with their `words`, and `from_m`, how far along the reference path the step before
    each is done.

    Args:
        samples: The rollout's samples that are frames.
    """
    episode = rollout.episode
    records = (episode.extra.get("instruction") or {}).get("texts") or []
    told = (r for r in records if r.get("text") == episode.instruction and r.get("from_m"))
    record = next(told, None)
    if record is None:
        return [], []
    along_m = _progress_m(
        episode.reference_path_world_m[:, :2], rollout.position_world_m[samples, :2]
    )
    words, times_s = [], []
    for step, from_m in zip(record["claims"], record["from_m"], strict=True):
        frame = int(np.searchsorted(along_m, float(from_m) - _REACHED_M))
        if frame < len(samples):
            words.append(str(step["words"]))
            times_s.append(float(rollout.time_s[samples[frame]]))
    return words, times_s


def _progress_m(path_xy_m: NDArray[np.float64], xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far along a path (P, 2) each of the positions (N, 2) in turn is, ascending [m]."""
    legs_m = np.linalg.norm(np.diff(path_xy_m, axis=0), axis=1)
    corners_m = np.concatenate([[0.0], np.cumsum(legs_m)])
    at_m = np.linspace(0.0, corners_m[-1], max(2, round(corners_m[-1] / 0.05)))
    points = np.stack([np.interp(at_m, corners_m, path_xy_m[:, k]) for k in range(2)], axis=1)
    result, low = np.zeros(len(xy_m)), 0
    for k, position in enumerate(xy_m):
        high = int(np.searchsorted(at_m, at_m[low] + _AHEAD_M, side="right"))
        low += int(np.argmin(np.linalg.norm(points[low:high] - position, axis=1)))
        result[k] = at_m[low]
    return result
