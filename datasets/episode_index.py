"""The episodes of a collected LeRobot dataset, without torch or lerobot."""

import logging
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow as pa

from ..formats.core.errors import FileFormatError
from ..formats.lerobot.episode_columns import EDITED_ADVICE, EPISODE_COLUMNS
from ..formats.lerobot.info import (
    PLACE_FIELDS,
    ForeignDatasetError,
    fill_template,
    read_info,
    video_start_s,
)
from ..formats.lerobot.layout import DATA_PATH, RGB_KEY, VIDEO_PATH
from ..formats.untrusted.files import check_links
from ..formats.untrusted.tables import read_schema, read_table

log = logging.getLogger(__name__)

# Those of meta/episodes' 250 columns that loaders and mixtures use; statistics stay on disk.
_PLACES = ("episode_index", "length", "dataset_from_index", "data/chunk_index", "data/file_index")
_LABELS = (
    "episode_uid",
    "trajectory_id",
    "scene_id",
    "split",
    "robot",
    "controller",
    "light",
    "end_reason",
    "instructions",
    "camera_name",
    "camera_width_px",
    "camera_height_px",
    "action_discrete_derived",
)
_STAIRS = "staircases"
# Features by which a dataset of vlnpe is known when its labels are gone.
_OURS = {RGB_KEY, "observation.state", "observation.camera_pose", "action", "action.velocity"}


@dataclass(frozen=True)
class VideoPlace:
    """Position of an episode's frames: a file, and the time of the first frame in it [s]."""

    path: Path
    from_s: float


@dataclass(frozen=True)
class EpisodeEntry:
    """One episode of a dataset.

    Attributes:
        number: its `episode_index`.
        length: number of frames.
        first_frame: `index` of its first frame in the dataset.
        rows: the Parquet file of its frame rows.
        videos: by feature.
        uid: `split/scene/id`, the same for every robot, controller and view.
        trajectory: `scene/trajectory`; episodes of one path share it, whatever their instruction.
        instructions: its own first.
        camera: the view that its images show.
        actions_derived: `action.discrete` was not executed; an expert would do it at each pose.
    """

    number: int
    length: int
    first_frame: int
    rows: Path
    videos: dict[str, VideoPlace]
    uid: str
    trajectory: str
    scene: str
    split: str
    robot: str
    controller: str
    light: str
    end_reason: str
    instructions: tuple[str, ...]
    camera: str
    actions_derived: bool


@dataclass(frozen=True)
class DatasetIndex:
    """The part of a dataset's `meta/` that loaders need.

    Attributes:
        info: `meta/info.json`.
        table: the needed columns of `meta/episodes`, in order; some 300 bytes per episode.
    """

    root: Path
    info: dict[str, Any]
    table: pa.Table

    def __len__(self) -> int:
        return self.table.num_rows

    @property
    def frames_per_second(self) -> int:
        """Frame rate."""
        return int(self.info["fps"])

    @cached_property
    def shapes(self) -> dict[str, tuple[str, tuple[int, ...]]]:
        """Type and shape of each feature."""
        features = self.info["features"].items()
        return {key: (f["dtype"], tuple(f["shape"])) for key, f in features}

    def labels(self, name: str) -> list[str]:
        """Return one label of all episodes, e.g. `end_reason`."""
        return self.table[name].to_pylist()

    def entry(self, row: int) -> EpisodeEntry:
        """Return the episode in row `row`."""
        values: dict[str, Any] = self.table.slice(row, 1).to_pylist()[0]

        def place(template: str, prefix: str, **names: str) -> Path:
            indices = {name: values[f"{prefix}/{name}"] for name in PLACE_FIELDS}
            return fill_template(self.root, template, **indices, **names)

        videos = {
            key: VideoPlace(
                place(VIDEO_PATH, f"videos/{key}", video_key=key),
                video_start_s(self.root, values[f"videos/{key}/from_timestamp"]),
            )
            for key, (dtype, _) in self.shapes.items()
            if dtype == "video"
        }
        return EpisodeEntry(
            number=values["episode_index"],
            length=values["length"],
            first_frame=values["dataset_from_index"],
            rows=place(DATA_PATH, "data"),
            videos=videos,
            uid=values["episode_uid"],
            trajectory=f"{values['scene_id']}/{values['trajectory_id']}",
            scene=values["scene_id"],
            split=values["split"],
            robot=values["robot"],
            controller=values["controller"],
            light=values["light"],
            end_reason=values["end_reason"],
            instructions=tuple(values["instructions"]),
            camera=values["camera_name"],
            actions_derived=values["action_discrete_derived"],
        )


def read_index(root: Path) -> DatasetIndex:
    """Read a dataset's `meta/`.

    Raises:
        ForeignDatasetError: another version of LeRobot's format, or not collected by vlnpe.
        FileFormatError: damaged.
    """
    info = read_info(root)
    videos = [key for key, f in info["features"].items() if f["dtype"] == "video"]
    columns = [*_PLACES, *_LABELS]
    for key in videos:
        columns += [f"videos/{key}/{n}" for n in ("chunk_index", "file_index", "from_timestamp")]
    check_links(root)
    files = episode_tables(root)
    if not files:
        raise FileFormatError(root / "meta" / "episodes", "contains no Parquet file")
    tables = [_with_stairs(file, _read(file, columns, info)) for file in files]
    return DatasetIndex(root, info, pa.concat_tables(tables))


def episode_tables(root: Path) -> list[Path]:
    """Return the Parquet files of a dataset's `meta/episodes`, in order."""
    return sorted((root / "meta" / "episodes").rglob("*.parquet"))


def _read(file: Path, columns: list[str], info: dict[str, Any]) -> pa.Table:
    missing = sorted(set(columns) - set(read_schema(file).names))
    if set(missing) & set(_LABELS) and set(info["features"]) >= _OURS:
        log.warning("%s: lacks vlnpe's episode columns; %s", file, EDITED_ADVICE)
        columns = [key for key in columns if key not in _LABELS]
        missing = sorted(set(missing) - set(_LABELS))
        if not missing:
            return _with_what_is_left(read_table(file, [*columns, "tasks"]), info)
    if missing:
        raise ForeignDatasetError(file, f"lacks the columns {missing}; not collected by vlnpe?")
    return read_table(file, columns).replace_schema_metadata(None)


def _with_stairs(file: Path, table: pa.Table) -> pa.Table:
    """Add the label `staircases`, null where a dataset lacks it: older, or edited."""
    kind = EPISODE_COLUMNS[_STAIRS]
    if _STAIRS in read_schema(file).names:
        found = read_table(file, [_STAIRS])[_STAIRS].cast(kind)
    else:
        found = pa.nulls(table.num_rows, kind)
    return table.append_column(_STAIRS, found)


def _with_what_is_left(table: pa.Table, info: dict[str, Any]) -> pa.Table:
    """Fill labels from LeRobot's own columns if its tools dropped vlnpe's."""
    names = [f"unknown/unknown/{number}" for number in table["episode_index"].to_pylist()]
    height, width = info["features"][RGB_KEY]["shape"][:2]
    left: dict[str, Any] = {
        "episode_uid": names,
        "trajectory_id": names,
        "robot": info["robot_type"],
        "split": "train",
        "instructions": table["tasks"].to_pylist(),
        "camera_width_px": width,
        "camera_height_px": height,
        "action_discrete_derived": True,  # so that no STOP on the way ends an episode
    }
    for key in _LABELS:
        values = left.get(key, "unknown")
        if not isinstance(values, list):
            values = [values] * table.num_rows
        table = table.append_column(key, pa.array(values))
    return table.drop_columns(["tasks"]).replace_schema_metadata(None)
