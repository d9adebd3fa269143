"""Write an episode unit from its parts, as they came out of another format."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ..core.atomic import atomic_folder
from ..lerobot.info import check_features
from ..lerobot.layout import Features
from ..lerobot.statistics import Statistics, statistics_from_json, statistics_to_json
from ..lerobot.unit import ROWS, UNIT_INDEX, UNIT_VERSION, EpisodeUnit

# An episode's whole rollout, kept beside a unit's frame rows: MCAP without pictures.
ROLLOUT_NAME = "rollout.mcap"


@dataclass(frozen=True)
class UnitParts:
    """The parts of a unit other than its rows and videos; see `EpisodeUnit`."""

    frames_per_second: int
    robot: str
    features: Features
    task: str
    length: int
    statistics: Mapping[str, Statistics]
    columns: Mapping[str, Any]

    @staticmethod
    def of(unit: EpisodeUnit) -> UnitParts:
        """Return those of a unit on disk."""
        return UnitParts(**{f.name: getattr(unit, f.name) for f in fields(UnitParts)})

    @staticmethod
    def from_json(index: Mapping[str, Any]) -> UnitParts:
        """Return the inverse of `to_json`.

        Raises:
            KeyError, TypeError, ValueError: not an index, or of another version.
        """
        if index["unit_version"] != UNIT_VERSION:
            raise ValueError(f"unit version {index['unit_version']}; valid: {UNIT_VERSION}")
        check_features(Path(UNIT_INDEX), index["features"])
        return UnitParts(
            frames_per_second=index["frames_per_second"],
            robot=index["robot"],
            features=index["features"],
            task=index["task"],
            length=index["length"],
            statistics={k: statistics_from_json(v) for k, v in index["statistics"].items()},
            columns=index["columns"],
        )

    def to_json(self) -> dict[str, Any]:
        """Return JSON values, as in unit.json."""
        return {
            "unit_version": UNIT_VERSION,
            "frames_per_second": self.frames_per_second,
            "robot": self.robot,
            "features": self.features,
            "task": self.task,
            "length": self.length,
            "statistics": {k: statistics_to_json(v) for k, v in self.statistics.items()},
            "columns": dict(self.columns),
        }


def write_unit(folder: Path, make: Callable[[Path], tuple[UnitParts, pa.Table]]) -> None:
    """Write a unit, replaced as a whole.

    Args:
        folder: the unit's.
        make: puts `<key>.mp4` of each video feature into the folder it is given, and returns the
            unit's index and its rows (of `unit_schema`).
    """
    with atomic_folder(folder) as temporary:
        parts, rows = make(temporary)
        pq.write_table(rows, temporary / ROWS)
        (temporary / UNIT_INDEX).write_text(json.dumps(parts.to_json()))
