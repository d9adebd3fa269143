"""The output of a reader in a child process, and its exchange format: arrays and a table."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

ANSWER = "answer.json"


@dataclass(frozen=True)
class LookRef:
    """A material that refers to its image by path.

    Attributes:
        name, base_color: as in `ScanMaterial`.
        texture: absolute path of the picture, empty if none.
        member: name inside the package `texture`, empty if that is a picture itself.
    """

    name: str
    base_color: tuple[float, float, float]
    texture: str = ""
    member: str = ""


@dataclass(frozen=True)
class RawPart:
    """Like `Part`, with `look` an index instead of a material."""

    name: str
    category: str
    vertices: NDArray[Any]
    faces: NDArray[Any]
    uv: NDArray[np.float32]
    look: int
    colors: NDArray[np.uint8] | None = None


@dataclass(frozen=True)
class Readings:
    """The output of a reader; `up`, `unit` and `warnings` as in `Scan`."""

    parts: list[RawPart]
    looks: list[LookRef]
    up: tuple[str, str] | None
    unit: tuple[str, str] | None
    warnings: list[str]


def write_readings(readings: Readings, folder: Path) -> None:
    """Write the concatenated arrays of all parts, then a table of the parts."""
    table, ends = [], dict.fromkeys(("vertices", "faces", "colors"), 0)
    parts = readings.parts
    for part in parts:
        entry: dict[str, Any] = {"name": part.name, "category": part.category, "look": part.look}
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
        "looks": [asdict(look) for look in readings.looks],
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
    parts = []
    for entry in data["parts"]:
        v, f, c = (slice(*entry[key]) for key in ("vertices", "faces", "colors"))
        painted = colors[c] if len(colors[c]) else None
        parts.append(
            RawPart(
                entry["name"],
                entry["category"],
                vertices[v],
                faces[f],
                uv[f],
                entry["look"],
                painted,
            )
        )
    looks = [
        LookRef(
            d["name"],
            (d["base_color"][0], d["base_color"][1], d["base_color"][2]),
            d["texture"],
            d["member"],
        )
        for d in data["looks"]
    ]
    up, unit = ((data[k][0], data[k][1]) if data[k] else None for k in ("up", "unit"))
    return Readings(parts, looks, up, unit, data["warnings"])


def _save(path: Path, pieces: Sequence[Any], shape: tuple[int, ...], dtype: Any) -> None:
    rows = np.concatenate([np.zeros((0, *shape), dtype), *(p.astype(dtype) for p in pieces)])
    np.save(path, rows)
