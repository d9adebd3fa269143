"""Join episode units into one LeRobot v3.0 dataset by copying streams, never encoding again."""

import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ..core.atomic import atomic_folder
from ..core.errors import FileFormatError
from ..video.mux import concatenate_videos
from . import layout
from .card import FILM_STRIP, CameraFacts, CardFacts, dataset_card
from .episode_columns import camera_of
from .film_strip import film_strip, shown_units
from .language import COLUMN, FEATURES, language_column, with_language
from .layout import Features, FileLimits, FilePlace, row_schema, tasks_table
from .rolling import EpisodeTable, RollingParquet
from .splits import published_split
from .statistics import StatisticsSum, column_statistics, statistics_to_json
from .units.rows import row_arrays
from .units.unit import EpisodeUnit, read_episode_unit

# LeRobot compares frame times in single precision with a tolerance of 0.1 ms. Beyond 1,024 s its
# spacing is coarser, unless the frame period is a power of two, which it holds exactly.
MAX_INEXACT_SECONDS = 1024.0
MEGABYTE = 1024 * 1024


@dataclass(frozen=True)
class DatasetSummary:
    """Numbers of an assembled dataset."""

    episodes: int
    frames: int
    tasks: int


def assemble_dataset(
    units: Sequence[Path],
    out: Path,
    *,
    provenance: Mapping[str, Any],
    licence: str,
    title: str,
    limits: FileLimits = FileLimits(),  # noqa: B008 (frozen)
    language: bool = False,
) -> DatasetSummary:
    """Write the dataset folder `out`, replaced as a whole, with one episode per unit, in order.

    Memory does not grow with the number of frames; of each episode only its place is kept.

    Args:
        units: folders written by `write_episode_unit`, of one robot and one view.
        provenance: JSON values for meta/provenance.json: configuration hash, code version, …;
            `scenes` (name → its source's facts) gives the card its licences, and training
            episodes in `held_out_scenes` are published as validation.
        licence: Licence identifier for the card of scenes without one.
        language: Add the column of `language`, which LeRobot older than 0.6 cannot read.

    Raises:
        ValueError: no unit.
        FileFormatError: a unit is damaged or does not match the first.
    """
    if not units:
        raise ValueError(f"no episodes to assemble into {out}")
    first = read_episode_unit(units[0])
    sizes = [_size(read_episode_unit(folder), first) for folder in units]
    with atomic_folder(out) as root:
        places: list[dict[str, Any]] = [{} for _ in units]
        for key in _video_keys(first):
            for number, place in enumerate(_join_videos(key, units, sizes, first, root, limits)):
                places[number] |= place
        total, splits = StatisticsSum(), _Splits(provenance)
        # Tasks by the order of their first appearance.
        tasks, frames, texts = dict[str, int](), 0, set[str]()
        schema = row_schema(first.features)
        schema = with_language(schema) if language else schema
        with (
            RollingParquet(root, layout.DATA_PATH, limits) as rows,
            EpisodeTable(root, limits) as episodes,
        ):
            for number, (folder, videos) in enumerate(zip(units, places, strict=True)):
                unit = read_episode_unit(folder)
                own = {
                    "episode_index": np.full(unit.length, number),
                    "index": np.arange(frames, frames + unit.length),
                    "task_index": np.full(unit.length, tasks.setdefault(unit.task, len(tasks))),
                }
                table = unit.rows()
                for key, values in own.items():
                    table = table.append_column(key, pa.array(values, pa.int64()))
                if language:
                    spoken = language_column(unit.columns, unit.task, unit.length)
                    table = table.append_column(COLUMN, spoken)
                data = rows.write(_conform(table, schema, folder))
                statistics = unit.statistics | {k: column_statistics(v) for k, v in own.items()}
                total.add(statistics)
                row = {
                    "episode_index": number,
                    "tasks": [unit.task],
                    "length": unit.length,
                    "data/chunk_index": data.chunk_index,
                    "data/file_index": data.file_index,
                    "dataset_from_index": frames,
                    "dataset_to_index": frames + unit.length,
                    **videos,
                }
                for key in first.features:
                    values = statistics_to_json(statistics[key])
                    row |= {f"stats/{key}/{name}": value for name, value in values.items()}
                episodes.add(row, unit.columns | {"split": splits.add(number, unit)})
                frames += unit.length
                texts.update(unit.columns["instructions"])
        summary = DatasetSummary(len(units), frames, len(tasks))
        features = first.features | (FEATURES if language else {})
        info = _info(first, features, summary, limits)
        _write(root / layout.INFO_PATH, info)
        _write(root / layout.STATS_PATH, total.result())
        _write(root / layout.SPLITS_PATH, splits.episodes)
        _write(root / layout.PROVENANCE_PATH, dict(provenance))
        pq.write_table(tasks_table(list(tasks)), root / layout.TASKS_PATH)
        shown = [read_episode_unit(units[i]) for i in shown_units(len(units))]
        (root / FILM_STRIP).write_bytes(film_strip(shown))
        facts = CardFacts(
            title=title,
            licence=licence,
            splits=splits.episodes,
            split_scenes=splits.scenes,
            depth_far_m=first.columns["depth_far_m"],
            camera=_camera_facts(shown),
            provenance=provenance,
            instructions=len(texts),
        )
        (root / "README.md").write_text(dataset_card(facts, info))
    return summary


def _camera_facts(units: Sequence[EpisodeUnit]) -> CameraFacts:
    poses = [row_arrays(unit.rows())["observation.camera_pose"] for unit in units]
    return CameraFacts.of(camera_of(units[0].columns), np.concatenate(poses))


class _Splits:
    """Episodes and scenes of each published split."""

    def __init__(self, provenance: Mapping[str, Any]) -> None:
        self._held_out = set(provenance.get("held_out_scenes", ()))
        self.episodes: dict[str, list[int]] = {}
        self.scenes: dict[str, set[str]] = {}

    def add(self, number: int, unit: EpisodeUnit) -> str:
        """Return the split that episode `number` is published in."""
        scene = unit.columns["scene_id"]
        split = published_split(unit.columns["split"], scene, self._held_out)
        self.episodes.setdefault(split, []).append(number)
        self.scenes.setdefault(split, set()).add(scene)
        return split


@dataclass(frozen=True)
class _Size:
    """Number of frames of a unit, and megabytes of each of its videos."""

    length: int
    video_mb: dict[str, float]


def _video_keys(unit: EpisodeUnit) -> list[str]:
    return [key for key, feature in unit.features.items() if feature["dtype"] == "video"]


def _size(unit: EpisodeUnit, first: EpisodeUnit) -> _Size:
    """Check that a unit is complete and matches the first."""
    for name in ("robot", "frames_per_second", "features"):
        if getattr(unit, name) != getattr(first, name):
            reason = f"{name} differs from the first unit's ({first.folder.name})"
            raise FileFormatError(unit.folder, reason)
    for key in _video_keys(unit):
        if not unit.video(key).is_file():
            raise FileFormatError(unit.video(key), "missing; the unit is incomplete")
    sizes = {key: unit.video(key).stat().st_size / MEGABYTE for key in _video_keys(unit)}
    return _Size(unit.length, sizes)


def _join_videos(
    key: str,
    units: Sequence[Path],
    sizes: Sequence[_Size],
    first: EpisodeUnit,
    root: Path,
    limits: FileLimits,
) -> list[dict[str, Any]]:
    """Write the files of one video feature; return each unit's place as episode columns."""
    places: list[dict[str, Any]] = []
    place, begin = FilePlace(), 0
    for end in _file_ends(key, sizes, first.frames_per_second, limits):
        paths = [folder / f"{key}.mp4" for folder in units[begin:end]]
        counts = concatenate_videos(paths, root / place.path(layout.VIDEO_PATH, video_key=key))
        for path, count, size in zip(paths, counts, sizes[begin:end], strict=True):
            if count != size.length:
                raise FileFormatError(path, f"{count} frames, the unit has {size.length}")
        times = np.concatenate([[0], np.cumsum(counts)]) / first.frames_per_second
        places += [
            {
                f"videos/{key}/chunk_index": place.chunk_index,
                f"videos/{key}/file_index": place.file_index,
                f"videos/{key}/from_timestamp": float(start),
                f"videos/{key}/to_timestamp": float(stop),
            }
            for start, stop in itertools.pairwise(times)
        ]
        place, begin = place.next(limits), end
    return places


def _file_ends(
    key: str, sizes: Sequence[_Size], frames_per_second: int, limits: FileLimits
) -> Iterator[int]:
    """Yield, per video file, the number of the unit after its last."""
    exact = frames_per_second & (frames_per_second - 1) == 0
    file_mb, seconds = 0.0, 0.0
    for number, size in enumerate(sizes):
        mb, duration = size.video_mb[key], size.length / frames_per_second
        full = file_mb + mb >= limits.video_mb
        late = not exact and seconds + duration > MAX_INEXACT_SECONDS
        if file_mb and (full or late):
            yield number
            file_mb, seconds = 0.0, 0.0
        file_mb, seconds = file_mb + mb, seconds + duration
    yield len(sizes)


def _conform(table: pa.Table, schema: pa.Schema, folder: Path) -> pa.Table:
    try:
        return table.select(schema.names).cast(schema).replace_schema_metadata(schema.metadata)
    except (KeyError, pa.ArrowException) as error:
        raise FileFormatError(folder, f"frame rows do not fit the features ({error})") from error


def _info(
    first: EpisodeUnit, features: Features, summary: DatasetSummary, limits: FileLimits
) -> dict[str, Any]:
    return {
        "codebase_version": layout.CODEBASE_VERSION,
        "fps": first.frames_per_second,
        "features": features,
        "total_episodes": summary.episodes,
        "total_frames": summary.frames,
        "total_tasks": summary.tasks,
        "chunks_size": limits.files_per_chunk,
        "data_files_size_in_mb": limits.data_mb,
        "video_files_size_in_mb": limits.video_mb,
        "data_path": layout.DATA_PATH,
        "video_path": layout.VIDEO_PATH,
        "robot_type": first.robot,
        "splits": {"train": f"0:{summary.episodes}"},
    }


def _write(path: Path, value: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value, indent=4, ensure_ascii=False) + "\n")
