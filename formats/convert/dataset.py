"""Take a LeRobot v3.0 dataset of ours apart into episode units, by copying streams."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ..core.errors import FileFormatError
from ..lerobot.episode_columns import EDITED_ADVICE, EPISODE_COLUMNS, LATER_COLUMNS
from ..lerobot.layout import (
    CODEBASE_VERSION,
    DATASET_ROWS,
    DEPTH_KEY,
    INFO_PATH,
    PROVENANCE_PATH,
    Features,
    FileLimits,
)
from ..lerobot.statistics import MOMENTS, QUANTILES
from ..lerobot.unit_rows import unit_schema
from ..video.mux import copy_frames
from .units import UnitParts, write_unit

PICTURES = ("video", "image")
EPISODES_GLOB = "meta/episodes/chunk-*/file-*.parquet"
# Whole rollouts of the episodes, where a converter had them; LeRobot does not look there.
ROLLOUTS_PATH = "rollouts/episode_{episode_index:06d}.mcap"


@dataclass(frozen=True)
class DatasetFacts:
    """What belongs to a dataset as a whole, and to no episode.

    Attributes:
        title, licence: of the card.
        provenance: meta/provenance.json.
        limits: when new files begin.
        depth_storage: one of LeRobot's `DEPTH_STORAGES`.
    """

    title: str
    licence: str
    provenance: dict[str, Any]
    limits: FileLimits = FileLimits()  # noqa: RUF009 (frozen)
    depth_storage: str = "video"

    def to_json(self) -> dict[str, Any]:
        """JSON values."""
        return asdict(self)

    @staticmethod
    def from_json(values: dict[str, Any]) -> DatasetFacts:
        """Inverse of `to_json`.

        Raises:
            KeyError, TypeError: not such facts.
        """
        return DatasetFacts(
            str(values["title"]),
            str(values["licence"]),
            dict(values["provenance"]),
            FileLimits(**values["limits"]),
            str(values["depth_storage"]),
        )


@dataclass(frozen=True)
class Dataset:
    """An opened dataset.

    Attributes:
        root: its folder.
        info: meta/info.json.
        episodes: their numbers, in order.
        facts: of the whole.
    """

    root: Path
    info: dict[str, Any]
    episodes: tuple[int, ...]
    facts: DatasetFacts

    @property
    def features(self) -> Features:
        """Entries of info.json."""
        return self.info["features"]


def open_dataset(root: Path) -> Dataset:
    """Open a dataset; frames are not read.

    Raises:
        FileFormatError: no LeRobot v3.0 dataset, damaged, or without vlnpe's episode columns.
    """
    info = read_info(root)
    numbers: list[int] = []
    for path in episode_files(root):
        try:
            schema = pq.read_schema(path)
            missing = sorted(set(EPISODE_COLUMNS) - set(LATER_COLUMNS) - set(schema.names))
            if missing:
                raise FileFormatError(
                    path, f"lacks vlnpe's episode columns ({missing[0]}, …); {EDITED_ADVICE}"
                )
            numbers += pq.read_table(path, columns=["episode_index"])[0].to_pylist()
        except (OSError, ValueError, pa.ArrowException) as error:
            raise FileFormatError(path, f"not readable ({error})") from error
    if not numbers or sorted(numbers) != list(range(info["total_episodes"])):
        raise FileFormatError(
            root, f"{len(numbers)} episodes listed, {INFO_PATH} says {info['total_episodes']}"
        )
    return Dataset(root, info, tuple(sorted(numbers)), _facts(root, info))


def read_facts(root: Path) -> DatasetFacts:
    """What belongs to the dataset as a whole.

    Raises:
        FileFormatError: no LeRobot v3.0 dataset, or damaged.
    """
    return _facts(root, read_info(root))


def extract_unit(root: Path, number: int, folder: Path) -> None:
    """Write one episode of a dataset as a unit: rows, statistics and videos unchanged.

    Raises:
        FileFormatError: the dataset is damaged, or has no such episode.
    """
    info = read_info(root)
    features, rate = info["features"], int(info["fps"])
    row = _episode_row(root, number)
    try:
        length = int(row["length"])
        parts = UnitParts(
            frames_per_second=rate,
            robot=info["robot_type"],
            features=features,
            task=row["tasks"][0],
            length=length,
            statistics={
                key: {
                    name: np.asarray(row[f"stats/{key}/{name}"]) for name in (*MOMENTS, *QUANTILES)
                }
                for key in sorted(features, key=lambda key: features[key]["dtype"] in PICTURES)
                if key not in DATASET_ROWS
            },
            columns={key: (LATER_COLUMNS | row)[key] for key in EPISODE_COLUMNS},
        )
        rows = _frame_rows(root, info, row, number, length)
        videos = {
            key: (
                root / _place(info["video_path"], row, f"videos/{key}", video_key=key),
                round(row[f"videos/{key}/from_timestamp"] * rate),
            )
            for key, feature in features.items()
            if feature["dtype"] == "video"
        }
    except (KeyError, IndexError, TypeError, ValueError, pa.ArrowException) as error:
        raise FileFormatError(root, f"episode {number} is damaged: {error!r}") from error

    def make(temporary: Path) -> tuple[UnitParts, pa.Table]:
        for key, (video, first) in videos.items():
            copy_frames(video, temporary / f"{key}.mp4", first, length)
        return parts, rows

    write_unit(folder, make)


def kept_rollout(root: Path, number: int) -> Path | None:
    """The episode's whole rollout that the dataset keeps, if it does."""
    path = root / ROLLOUTS_PATH.format(episode_index=number)
    return path if path.is_file() else None


def read_info(root: Path) -> dict[str, Any]:
    """Read meta/info.json.

    Raises:
        FileFormatError: no LeRobot v3.0 dataset, or damaged.
    """
    path = root / INFO_PATH
    try:
        info = json.loads(path.read_text())
        if info["codebase_version"] != CODEBASE_VERSION:
            raise FileFormatError(
                path, f"LeRobot {info['codebase_version']}, this code reads {CODEBASE_VERSION}"
            )
        for key in ("fps", "features", "total_episodes", "robot_type", "data_path", "video_path"):
            info[key]
        return info
    except FileNotFoundError as error:
        raise FileFormatError(path, "missing; not a LeRobot dataset") from error
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FileFormatError(path, f"not a LeRobot dataset: {error!r}") from error


def episode_files(root: Path) -> list[Path]:
    """The files of meta/episodes, in order.

    Raises:
        FileFormatError: there is none.
    """
    files = sorted(root.glob(EPISODES_GLOB))
    if not files:
        raise FileFormatError(root / "meta" / "episodes", "missing; the dataset has no episode")
    return files


def _episode_row(root: Path, number: int) -> dict[str, Any]:
    for path in episode_files(root):
        try:
            rows = pq.read_table(path, filters=[("episode_index", "=", number)]).to_pylist()
        except (OSError, ValueError, pa.ArrowException) as error:
            raise FileFormatError(path, f"not readable ({error})") from error
        if rows:
            return rows[0]
    raise FileFormatError(root, f"has no episode {number}")


def _frame_rows(
    root: Path, info: dict[str, Any], row: dict[str, Any], number: int, length: int
) -> pa.Table:
    path = root / _place(info["data_path"], row, "data")
    schema = unit_schema(info["features"])
    try:
        table = pq.read_table(path, filters=[("episode_index", "=", number)], columns=schema.names)
    except (OSError, ValueError, pa.ArrowException) as error:
        raise FileFormatError(path, f"not readable ({error})") from error
    if table.num_rows != length:
        raise FileFormatError(path, f"episode {number} has {table.num_rows} of {length} rows")
    return table.cast(schema).replace_schema_metadata(schema.metadata)


def _place(template: str, row: dict[str, Any], prefix: str, **names: str) -> str:
    return template.format(
        chunk_index=row[f"{prefix}/chunk_index"], file_index=row[f"{prefix}/file_index"], **names
    )


def _facts(root: Path, info: dict[str, Any]) -> DatasetFacts:
    provenance = root / PROVENANCE_PATH
    try:
        value = json.loads(provenance.read_text()) if provenance.is_file() else {}
        limits = FileLimits(
            int(info["chunks_size"]), info["data_files_size_in_mb"], info["video_files_size_in_mb"]
        )
    except (OSError, ValueError, KeyError) as error:
        raise FileFormatError(provenance, f"damaged: {error!r}") from error
    front = _card_front(root / "README.md")
    return DatasetFacts(
        front.get("pretty_name", root.name),
        front.get("license", "unknown"),
        value,
        limits,
        info["features"][DEPTH_KEY]["dtype"],
    )


def _card_front(path: Path) -> dict[str, str]:
    """Text values of a card's front matter, as `dataset_card` writes them."""
    if not path.is_file():
        return {}
    found = {}
    for line in path.read_text(errors="replace").partition("\n---")[0].splitlines():
        key, _, value = line.partition(": ")
        if key in ("license", "pretty_name"):
            try:
                found[key] = str(json.loads(value))
            except ValueError:
                found[key] = value.strip()
    return found
