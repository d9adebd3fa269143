"""Which lines of tasks.jsonl are an episode's: its instructions, and how it finished.

InternNav's loaders take the span of `task_index` in episodes_stats.jsonl. LeRobot 2.1's own tools
nest that span under `stats`, or leave the line out; then the episode's rows and episodes.jsonl say
the same. An episode without a listed task has no instruction: task 0 belongs to another one.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FileFormatError, brief
from . import layout
from .layout import read_lines


@dataclass(frozen=True)
class EpisodeTasks:
    """What tasks.jsonl says of an episode.

    Attributes:
        texts: instructions without repetitions.
        finish_status, fail_reason: as written; "" where unknown.
    """

    texts: tuple[str, ...]
    finish_status: str
    fail_reason: str


def read_tasks(folder: Path, number: int, row_tasks: NDArray[Any] | None) -> EpisodeTasks:
    """Return the instructions of an episode, by the loaders' rule, and how it finished.

    Args:
        row_tasks: the rows' `task_index` (T,), if there are any.

    Raises:
        FileFormatError: If the file is damaged, or does not give the episode's instructions.
    """
    path = folder / layout.TASKS_PATH
    lines = read_lines(path)
    span = _span_of_statistics(folder, number)
    if span is None:
        span = _span_of_rows(folder, number, row_tasks)
    if span is not None:
        first, last = span
        own = [t for t in lines if first <= _whole(path, t.get("task_index")) <= last]
    else:
        listed = _listed_texts(folder, number)
        own = [t for t in lines if _text(t) in listed]
    texts = list(dict.fromkeys(text for text in map(_text, own) if text))
    if not texts:
        raise FileFormatError(path, f"no instruction for episode {number}")
    ends = [(str(t.get("finish_status") or ""), str(t.get("fail_reason") or "")) for t in own]
    # Texts alone may be other episodes', too, which ended otherwise.
    known = span is not None or len(set(ends)) == 1
    return EpisodeTasks(tuple(texts), *(ends[-1] if known else ("", "")))


def _span_of_statistics(folder: Path, number: int) -> tuple[int, int] | None:
    path = folder / layout.STATS_PATH
    for line in read_lines(path) if path.is_file() else []:
        if line.get("episode_index") == number:
            nested = line.get("stats")
            span = line.get("task_index")
            if span is None and isinstance(nested, dict):
                span = nested.get("task_index")
            if span is None:
                return None
            if not isinstance(span, dict):
                raise FileFormatError(
                    path, f"episode {number}: task_index {brief(span)}; valid: its min and max"
                )
            return _whole(path, span.get("min")), _whole(path, span.get("max"))
    return None


def _span_of_rows(folder: Path, number: int, tasks: NDArray[Any] | None) -> tuple[int, int] | None:
    if tasks is None:
        return None
    if tasks.dtype.kind not in "iu" or tasks.ndim != 1:
        raise FileFormatError(
            folder, f"episode {number}: task_index of its rows; valid: one whole number per row"
        )
    return int(np.min(tasks)), int(np.max(tasks))


def _listed_texts(folder: Path, number: int) -> list[str]:
    path = folder / layout.EPISODES_PATH
    for line in read_lines(path) if path.is_file() else []:
        if line.get("episode_index") == number:
            listed = line.get("tasks")
            return [str(text).strip() for text in listed] if isinstance(listed, list) else []
    return []


def _text(task: dict[str, Any]) -> str:
    return str(task.get("task") or task.get("instruction_text") or "").strip()


def _whole(path: Path, value: Any) -> int:
    """Return a whole number, or the only one of a list, as LeRobot writes statistics."""
    inner = value
    while isinstance(inner, list) and len(inner) == 1:
        inner = inner[0]
    if isinstance(inner, bool) or not isinstance(inner, int | float) or inner != inner // 1:
        raise FileFormatError(path, f"task_index {brief(value)}; valid: a whole number")
    return int(inner)
