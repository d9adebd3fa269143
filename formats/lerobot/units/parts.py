"""The parts of an episode unit, and how they are written; see `unit`."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ...core.atomic import atomic_folder
from ...core.errors import FileFormatError
from ..info import check_features
from ..layout import Features
from ..statistics import Statistics, statistics_from_json, statistics_to_json

UNIT_INDEX = "unit.json"
UNIT_VERSION = 1
ROWS = "rows.parquet"


@dataclass(frozen=True, kw_only=True)
class UnitParts:
    """The parts of a unit other than its rows and videos.

    Attributes:
        frames_per_second, robot: must agree within a dataset.
        features: entries of info.json.
        task: the instruction.
        length: number of frames.
        statistics: per feature, except the columns that depend on the place in a dataset.
        columns: values of `EPISODE_COLUMNS`.
    """

    frames_per_second: int
    robot: str
    features: Features
    task: str
    length: int
    statistics: dict[str, Statistics]
    columns: dict[str, Any]

    @staticmethod
    def from_json(index: Mapping[str, Any], path: Path) -> "UnitParts":
        """Return the inverse of `to_json`; `path` is for errors.

        Raises:
            FileFormatError: another version, or features that cannot be used.
            KeyError, TypeError, ValueError, AttributeError: not an index.
        """
        version = index["unit_version"]
        if version != UNIT_VERSION:
            raise FileFormatError(path, f"unit version {version}; this code reads {UNIT_VERSION}")
        check_features(path, index["features"])
        parts = {field.name: index[field.name] for field in fields(UnitParts)}
        parts["statistics"] = {k: statistics_from_json(v) for k, v in parts["statistics"].items()}
        return UnitParts(**parts)

    def to_json(self) -> dict[str, Any]:
        """Return JSON values, as in unit.json."""
        parts = {field.name: getattr(self, field.name) for field in fields(UnitParts)}
        statistics = {k: statistics_to_json(v) for k, v in self.statistics.items()}
        return {"unit_version": UNIT_VERSION, **parts, "statistics": statistics}


def write_unit(folder: Path, make: Callable[[Path], tuple[UnitParts, pa.Table]]) -> None:
    """Write a unit, replaced as a whole.

    Args:
        make: puts `<key>.mp4` of each video feature into the folder it is given, and returns the
            unit's index and its rows (of `unit_schema`).
    """
    with atomic_folder(folder) as temporary:
        parts, rows = make(temporary)
        pq.write_table(rows, temporary / ROWS)
        (temporary / UNIT_INDEX).write_text(json.dumps(parts.to_json()))
