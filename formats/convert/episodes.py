"""One episode from MCAP or a LeRobot dataset to a unit, and from a unit to either.

A unit folder here may hold more than the dataset writer puts into it: `rollout.mcap`, the episode's
rollout at full rate without pictures, and `dataset.json`, facts of the dataset that it came from.
So nothing is lost on the way.
"""

import contextlib
import json
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..core.atomic import atomic_file, atomic_folder
from ..core.errors import FileFormatError
from ..core.rollout import Rollout
from ..lerobot import DatasetSummary, assemble_dataset, read_episode_unit, write_episode_unit
from ..lerobot.layout import RGB_KEY
from ..lerobot.units.rows import row_arrays
from ..lerobot.units.unit import EpisodeUnit
from ..mcap.episode import (
    DATASET_METADATA,
    VIEW_METADATA,
    extract_contents,
    extract_records,
    read_json_metadata,
    write_blind_mcap,
    write_episode_mcap,
    write_frame_records,
)
from ..mcap.facts import METADATA_NAME
from ..mcap.id_images import extract_id_videos
from ..mcap.recording import read_recording
from ..mcap.shown import ShownTopic, extract_shown
from ..rendered.folder import FrameFolder, read_frame_folder, video_name
from ..rendered.table import build_frame_table
from ..untrusted.documents import read_json_object
from .dataset import ROLLOUTS_PATH, extract_unit, kept_rollout, read_facts
from .facts import DatasetFacts
from .stored_depth import depth_video
from .unit_mcap import UNIT_METADATA, extract_unit_mcap, write_unit_mcap

# An episode's whole rollout, kept beside a unit's frame rows: MCAP without pictures.
ROLLOUT_NAME = "rollout.mcap"
DATASET_NAME = "dataset.json"
# In it, the name of the robot's log that the unit was cut from; one converted again has none.
LOG_KEY = "log"


def unit_from_mcap(path: Path, folder: Path) -> None:
    """Write an MCAP file's episode as a unit.

    Files that `write_episode_mcap` wrote give the unit that the exporter would have given, and the
    rollout is kept; files that `write_unit_mcap` wrote give the unit they were made from.

    Raises:
        FileFormatError: damaged, or an MCAP file without an episode of vlnpe in it.
    """
    contents = read_recording(path)
    facts = read_json_metadata(contents, DATASET_METADATA, path)
    if UNIT_METADATA in contents.metadata:
        extract_unit_mcap(contents, path, folder)
    elif METADATA_NAME in contents.metadata and VIEW_METADATA in contents.metadata:
        with tempfile.TemporaryDirectory(dir=_parent(folder), prefix=".vlnpe-tmp-") as temporary:
            seen = extract_contents(contents, path, Path(temporary) / "frames")
            storage = (facts or {}).get("depth_storage", "video")
            write_episode_unit(folder, seen.rollout, seen.frames, depth_storage=storage)
            write_blind_mcap(folder / ROLLOUT_NAME, seen.rollout, seen.frames, seen.shown)
    else:
        what = "a rollout without pictures" if METADATA_NAME in contents.metadata else "no episode"
        raise FileFormatError(path, f"holds {what}; valid: files of `vlnpe export` or `convert`")
    if facts is not None:
        (folder / DATASET_NAME).write_text(json.dumps(facts))


def unit_from_dataset(root: Path, number: int, folder: Path) -> None:
    """Write one episode of a LeRobot dataset as a unit, with the rollout that the dataset keeps.

    Raises:
        FileFormatError: the dataset is damaged, or has no such episode.
    """
    extract_unit(root, number, folder)
    kept = kept_rollout(root, number)
    if kept is not None:
        shutil.copyfile(kept, folder / ROLLOUT_NAME)
    (folder / DATASET_NAME).write_text(json.dumps(read_facts(root).to_json()))


def mcap_from_unit(folder: Path, path: Path) -> None:
    """Write a unit's episode as MCAP: with its whole rollout if the unit keeps it.

    Raises:
        FileFormatError: the unit is damaged, or its rollout is of another episode.
    """
    facts = unit_dataset(folder)
    dataset = None if facts is None else facts.to_json()
    if not (folder / ROLLOUT_NAME).is_file():
        write_unit_mcap(path, folder, dataset)
        return
    with kept_episode(folder) as (rollout, view, shown):
        write_episode_mcap(path, rollout, view.rgb_video.parent, shown=shown, dataset=dataset)


@contextlib.contextmanager
def kept_episode(folder: Path) -> Iterator[tuple[Rollout, FrameFolder, tuple[ShownTopic, ...]]]:
    """Yield the rollout that a unit keeps, its frames in a temporary folder, and what it shows.

    Raises:
        FileFormatError: If the unit is damaged, or its rollout is of another episode.
    """
    unit, blind = read_episode_unit(folder), folder / ROLLOUT_NAME
    contents = read_recording(blind)
    rollout, view, arrays = extract_records(contents, blind)
    _check_rollout(unit, rollout, arrays, blind)
    with tempfile.TemporaryDirectory(prefix=".vlnpe-tmp-") as temporary:
        frames = Path(temporary)
        shutil.copyfile(unit.video(RGB_KEY), frames / video_name(view, "rgb", blind))
        with depth_video(unit) as depth:
            shutil.copyfile(depth, frames / video_name(view, "depth", blind))
        extract_id_videos(contents, blind, frames, view, unit.length)
        write_frame_records(frames, view, arrays)
        yield rollout, read_frame_folder(frames), extract_shown(contents)


def dataset_from_units(units: Sequence[Path], out: Path, facts: DatasetFacts) -> DatasetSummary:
    """Assemble units as a LeRobot dataset, with the rollouts that they keep.

    Raises:
        FileFormatError: a unit is damaged or does not match the first.
    """
    with atomic_folder(out) as temporary:
        made = temporary / "made"
        summary = assemble_dataset(
            units,
            made,
            provenance=facts.provenance,
            licence=facts.licence,
            title=facts.title,
            limits=facts.limits,
        )
        for entry in made.iterdir():
            entry.rename(temporary / entry.name)
        made.rmdir()
        for number, unit in enumerate(units):
            if (unit / ROLLOUT_NAME).is_file():
                kept = temporary / ROLLOUTS_PATH.format(episode_index=number)
                with atomic_file(kept) as copy:
                    shutil.copyfile(unit / ROLLOUT_NAME, copy)
    return summary


def unit_dataset(folder: Path) -> DatasetFacts | None:
    """Return the facts of the dataset that a unit came from, where known.

    Raises:
        FileFormatError: they are damaged.
    """
    path = folder / DATASET_NAME
    if not path.is_file():
        return None
    try:
        return DatasetFacts.from_json(read_json_object(path))
    except (ValueError, KeyError, TypeError) as error:
        raise FileFormatError(path, f"damaged: {error!r}") from error


def joint_facts(units: Sequence[Path], title: str, licence: str, note: Any) -> DatasetFacts:
    """Return the facts of the dataset of all `units`: those they share, or what each had.

    Args:
        units: unit folders.
        title: where units know of no dataset, or of several.
        licence: of units that know of no dataset.
        note: JSON value; where the units came from, for a provenance of our own.
    """
    known: dict[str, DatasetFacts] = {}
    unknown = False
    for folder in units:
        facts = unit_dataset(folder)
        unknown |= facts is None
        if facts is not None:
            known.setdefault(json.dumps(facts.to_json(), sort_keys=True), facts)
    sources = [facts.provenance for facts in known.values()]
    first = next(iter(known.values()), None)
    if first is not None and not unknown and len({_but_scenes(f) for f in known.values()}) == 1:
        # Episodes of one dataset that know their own scenes only.
        scenes = {k: v for source in sources for k, v in source.get("scenes", {}).items()}
        licences = {facts.licence for facts in known.values()}
        return replace(
            first,
            licence=licences.pop() if len(licences) == 1 else "other",
            provenance=first.provenance | ({"scenes": scenes} if scenes else {}),
        )
    licences = {facts.licence for facts in known.values()} | ({licence} if unknown else set())
    provenance = {"converted": note} | ({"sources": sources} if sources else {})
    return DatasetFacts(title, licences.pop() if len(licences) == 1 else "other", provenance)


def _but_scenes(facts: DatasetFacts) -> str:
    provenance = {k: v for k, v in facts.provenance.items() if k != "scenes"}
    return json.dumps(replace(facts, licence="", provenance=provenance).to_json(), sort_keys=True)


def _check_rollout(
    unit: EpisodeUnit, rollout: Rollout, arrays: dict[str, np.ndarray], path: Path
) -> None:
    """Check that the unit's rows are those of the rollout."""
    try:
        expected = build_frame_table(rollout, arrays, unit.frames_per_second).columns
        rows = row_arrays(unit.rows())
        changed = [
            key
            for key, values in expected.items()
            if not np.array_equal(np.reshape(rows[key], values.shape), values, equal_nan=True)
        ]
    except (KeyError, ValueError, pa.ArrowException) as error:
        raise FileFormatError(path, f"rollout does not fit the unit: {error!r}") from error
    if changed:
        raise FileFormatError(path, f"{changed[0]} differs from the rows of {unit.folder.name}")


def _parent(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path.parent
