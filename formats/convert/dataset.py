"""Take a LeRobot v3.0 dataset of ours apart into episode units, by copying streams."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..core.errors import FileFormatError, brief
from ..lerobot import info as info_module
from ..lerobot.episode_columns import EDITED_ADVICE, EPISODE_COLUMNS, LATER_COLUMNS
from ..lerobot.info import PLACE_FIELDS, fill_template, video_start_s
from ..lerobot.layout import DATASET_ROWS, INFO_PATH, Features
from ..lerobot.statistics import MOMENTS, QUANTILES
from ..lerobot.units.parts import UnitParts, write_unit
from ..lerobot.units.rows import unit_schema
from ..untrusted.files import check_input, check_links
from ..untrusted.limits import limits
from ..untrusted.tables import read_schema, read_table
from ..video.mux import copy_frames
from .facts import DatasetFacts, facts_of

_NEEDED = {
    "total_episodes": int,
    "robot_type": str,
    "data_path": str,
    "video_path": str,
    "chunks_size": int,
}
PICTURES = ("video", "image")
EPISODES_GLOB = "meta/episodes/chunk-*/file-*.parquet"
# Whole rollouts of the episodes, where a converter had them; LeRobot does not look there.
ROLLOUTS_PATH = "rollouts/episode_{episode_index:06d}.mcap"


@dataclass(frozen=True)
class Dataset:
    """An opened dataset.

    Attributes:
        info: meta/info.json.
        episodes: their numbers, in order.
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
    info = _read_info(root)
    check_links(root)
    numbers: list[int] = []
    for path in episode_files(root):
        schema = read_schema(path, root=root)
        missing = sorted(set(EPISODE_COLUMNS) - set(LATER_COLUMNS) - set(schema.names))
        if missing:
            raise FileFormatError(
                path, f"lacks vlnpe's episode columns ({missing[0]}, …); {EDITED_ADVICE}"
            )
        numbers += read_table(path, ["episode_index"], root=root)[0].to_pylist()
    expected = info["total_episodes"] == len(numbers) > 0 and None not in numbers
    if not expected or sorted(numbers) != list(range(len(numbers))):
        raise FileFormatError(
            root, f"{len(numbers)} episodes listed, {INFO_PATH} says {info['total_episodes']}"
        )
    return Dataset(root, info, tuple(sorted(numbers)), facts_of(root, info))


def _read_info(root: Path) -> dict[str, Any]:
    """Return info.json without language columns, which are made of the episode columns."""
    info = read_info(root)
    features = {k: f for k, f in info["features"].items() if f["dtype"] != "language"}
    return info | {"features": features}


def read_facts(root: Path) -> DatasetFacts:
    """Return what belongs to the dataset as a whole.

    Raises:
        FileFormatError: no LeRobot v3.0 dataset, or damaged.
    """
    return facts_of(root, read_info(root))


def extract_unit(root: Path, number: int, folder: Path) -> None:
    """Write one episode of a dataset as a unit: rows, statistics and videos unchanged.

    Raises:
        FileFormatError: the dataset is damaged, or has no such episode.
    """
    info = _read_info(root)
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
                _place(root, info["video_path"], row, f"videos/{key}", video_key=key),
                round(video_start_s(root, row[f"videos/{key}/from_timestamp"]) * rate),
            )
            for key, feature in features.items()
            if feature["dtype"] == "video"
        }
    except (
        KeyError,
        IndexError,
        TypeError,
        ValueError,
        OverflowError,
        pa.ArrowException,
    ) as error:
        raise FileFormatError(root, f"episode {number} is damaged: {error!r}") from error

    def make(temporary: Path) -> tuple[UnitParts, pa.Table]:
        for key, (video, first) in videos.items():
            copy_frames(video, temporary / f"{key}.mp4", first, length)
        return parts, rows

    write_unit(folder, make)


def kept_rollout(root: Path, number: int) -> Path | None:
    """Return the episode's whole rollout that the dataset keeps, if it does."""
    path = root / ROLLOUTS_PATH.format(episode_index=number)
    if not path.exists():
        return None
    check_input(path, root=root, max_bytes=limits().mcap_bytes)
    return path


def read_info(root: Path) -> dict[str, Any]:
    """Read meta/info.json.

    Raises:
        FileFormatError: no LeRobot v3.0 dataset, or damaged.
    """
    path = root / INFO_PATH
    info = info_module.read_info(root)
    for key, kind in _NEEDED.items():
        if not isinstance(info.get(key), kind):
            raise FileFormatError(path, f"not a LeRobot dataset: {key} is {brief(info.get(key))}")
    return info


def episode_files(root: Path) -> list[Path]:
    """Return the files of meta/episodes, in order.

    Raises:
        FileFormatError: there is none.
    """
    files = sorted(root.glob(EPISODES_GLOB))
    if not files:
        raise FileFormatError(root / "meta" / "episodes", "missing; the dataset has no episodes")
    return files


def _episode_row(root: Path, number: int) -> dict[str, Any]:
    for path in episode_files(root):
        rows = read_table(path, filters=[("episode_index", "=", number)], root=root).to_pylist()
        if rows:
            return rows[0]
    raise FileFormatError(root, f"has no episode {number}")


def _frame_rows(
    root: Path, info: dict[str, Any], row: dict[str, Any], number: int, length: int
) -> pa.Table:
    path = _place(root, info["data_path"], row, "data")
    schema = unit_schema(info["features"])
    table = read_table(path, schema.names, filters=[("episode_index", "=", number)], root=root)
    if table.num_rows != length:
        raise FileFormatError(path, f"episode {number} has {table.num_rows} of {length} rows")
    return table.cast(schema).replace_schema_metadata(schema.metadata)


def _place(root: Path, template: str, row: dict[str, Any], prefix: str, **names: str) -> Path:
    indices = {name: row[f"{prefix}/{name}"] for name in PLACE_FIELDS}
    return fill_template(root, template, **indices, **names)
