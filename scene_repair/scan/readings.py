"""The output of a reader in a child process, and its exchange format: arrays and a table."""

import json
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .soup import Part

ANSWER = "answer.json"


@dataclass(frozen=True)
class LookRef:
    """A material that refers to its image: a file, or the `member` of the package `texture`."""

    name: str
    base_color: tuple[float, float, float]
    texture: str = ""
    member: str = ""


@dataclass(frozen=True)
class Readings:
    """The output of a reader; `up`, `unit` and `warnings` as in `Scan`."""

    parts: list[Part[LookRef]]
    up: tuple[str, str] | None
    unit: tuple[str, str] | None
    warnings: list[str]


def write_readings(readings: Readings, folder: Path) -> None:
    """Write the concatenated arrays of all parts, then a table of the parts."""
    table, ends = [], dict.fromkeys(("vertices", "faces", "colors"), 0)
    parts = readings.parts
    refs = list(dict.fromkeys(part.material for part in parts))
    number = {look: k for k, look in enumerate(refs)}
    for part in parts:
        entry: dict[str, Any] = {"name": part.name, "category": part.category}
        entry["look"] = number[part.material]
        for key in ends:
            array = getattr(part, key)
            count = 0 if array is None else len(array)
            entry[key] = [ends[key], ends[key] + count]
            ends[key] += count
        table.append(entry)
    _save(folder / "vertices.npy", [p.vertices for p in parts], (3,), np.float64)
    _save(folder / "faces.npy", [p.faces for p in parts], (3,), np.int32)
    _save(folder / "uv.npy", [p.uv for p in parts], (3, 2), np.float32)
    colors = [p.colors for p in parts if p.colors is not None]
    _save(folder / "colors.npy", colors, (3, 3), np.uint8)
    answer = {
        "parts": table,
        "looks": [astuple(look) for look in refs],
        "up": readings.up,
        "unit": readings.unit,
        "warnings": readings.warnings,
    }
    (folder / ANSWER).write_text(json.dumps(answer))


def load_readings(data: dict[str, Any], folder: Path) -> Readings:
    """Read the output of `write_readings`; `data` is its table."""
    vertices, faces, uv, colors = (
        np.load(folder / f"{name}.npy", allow_pickle=False)
        for name in ("vertices", "faces", "uv", "colors")
    )
    refs = [LookRef(name, tuple(color), *file) for name, color, *file in data["looks"]]
    parts = []
    for entry in data["parts"]:
        v, f, c = (slice(*entry[key]) for key in ("vertices", "faces", "colors"))
        arrays = vertices[v], faces[f], uv[f]
        painted = colors[c] if len(colors[c]) else None
        named = entry["name"], entry["category"]
        parts.append(Part(*named, *arrays, refs[entry["look"]], painted))
    up, unit = (tuple(data[k]) if data[k] else None for k in ("up", "unit"))
    return Readings(parts, up, unit, data["warnings"])


def _save(path: Path, pieces: Sequence[Any], shape: tuple[int, ...], dtype: Any) -> None:
    rows = np.concatenate([np.zeros((0, *shape), dtype), *(p.astype(dtype) for p in pieces)])
    np.save(path, rows)
