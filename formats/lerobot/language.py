"""LeRobot's column `language_persistent`: all texts of a path, and the parts of its instruction.

LeRobot knows it since 0.6 and repeats the same rows in every frame of an episode. Rows of style
`task_aug` are wordings of the task, the task itself first; rows of style `subtask` are the parts of
the instruction, each from the time at which the part before was done.
"""

import json
from collections.abc import Mapping
from typing import Any

import pyarrow as pa

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
