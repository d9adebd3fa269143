"""An episode of a dataset as one MCAP file, and back, without the rollout that it was made from.

What Foxglove shows comes at frame rate; `ROW_TOPIC` and the metadata record `vlnpe.unit` hold the
dataset's own rows, features, statistics and columns, exactly.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..core.camera import DepthRange
from ..core.errors import FileFormatError
from ..lerobot.layout import DEPTH_KEY, RGB_KEY, Features
from ..lerobot.units.parts import UnitParts, write_unit
from ..lerobot.units.rows import row_arrays, stores_images, with_depth_images
from ..lerobot.units.unit import EpisodeUnit, read_episode_unit
from ..mcap.camera import camera_messages
from ..mcap.camera_streams import extract_videos
from ..mcap.episode import (
    DATASET_METADATA,
    INSTRUCTION_METADATA,
    VIEW_METADATA,
    read_json_metadata,
    write_json_metadata,
)
from ..mcap.plan import plan_messages
from ..mcap.recording import Contents, open_recording
from ..mcap.sensors import action_messages, command_messages, foot_messages, imu_messages
from ..mcap.topics import event_messages, motion_messages, state_messages, write_in_order
from .frame_rollout import frame_rollout, frame_view
from .row_messages import read_rows, row_messages
from .stored_depth import depth_video

UNIT_METADATA = "vlnpe.unit"


def write_unit_mcap(path: Path, folder: Path, dataset: Mapping[str, Any] | None = None) -> None:
    """Write a unit's episode atomically.

    Args:
        dataset: facts of the dataset it belongs to (JSON values).

    Raises:
        FileFormatError: the unit is damaged, or has features that MCAP files do not hold.
    """
    unit = read_episode_unit(folder)
    unknown = [k for k in _pictures(unit.features) if k not in (RGB_KEY, DEPTH_KEY)]
    if unknown:
        raise FileFormatError(folder, f"no MCAP topic for {unknown[0]}")
    with depth_video(unit) as depth:
        _write(path, unit, depth, dataset)


def _write(path: Path, unit: EpisodeUnit, depth: Path, dataset: Mapping[str, Any] | None) -> None:
    table = unit.rows()
    try:
        rows = row_arrays(table)
        rollout, view = frame_rollout(unit, rows), frame_view(unit, rows, depth)
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(unit.folder, f"unit is damaged: {error!r}") from error
    labels = {}
    if "action.discrete" in rows:
        labels = dict(
            zip(rollout.time_s.tolist(), np.ravel(rows["action.discrete"]).tolist(), strict=True)
        )
    with open_recording(path) as recording:
        recording.writer.write_metadata(INSTRUCTION_METADATA, {"text": unit.task})
        write_json_metadata(recording, UNIT_METADATA, unit.to_json())
        write_json_metadata(recording, VIEW_METADATA, view.facts)
        if dataset is not None:
            write_json_metadata(recording, DATASET_METADATA, dataset)
        streams = [
            plan_messages(recording, rollout, walked_every=1),
            row_messages(recording, table, unit.features, unit.frames_per_second),
            state_messages(recording, rollout),
            motion_messages(recording, rollout, 1),
        ]
        if "action.velocity" in rows:
            streams.append(command_messages(recording, rollout, 1))
        if "observation.imu" in rows:
            streams.append(imu_messages(recording, rollout, 1))
        write_in_order(
            *streams,
            foot_messages(recording, rollout, 1),
            action_messages(recording, rollout, labels),
            camera_messages(recording, rollout, view),
            event_messages(recording, rollout),
        )


def extract_unit_mcap(contents: Contents, path: Path, folder: Path) -> None:
    """Write the unit that `write_unit_mcap` took, exactly; colour packets are copied.

    Args:
        path: of the file, for errors.

    Raises:
        FileFormatError: records, topics or messages are missing or damaged.
    """
    index = read_json_metadata(contents, UNIT_METADATA, path)
    view = read_json_metadata(contents, VIEW_METADATA, path)
    try:
        parts = UnitParts.from_json(index, path)
        rows = read_rows(contents, path, parts.features, parts.length)
        files = {"depth": view["depth"] | {"file": f"{DEPTH_KEY}.mp4"}}
        files["rgb"] = view["rgb"] | {"file": f"{RGB_KEY}.mp4"}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise FileFormatError(path, f"metadata {UNIT_METADATA} is damaged: {error!r}") from error

    def make(temporary: Path) -> tuple[UnitParts, pa.Table]:
        extract_videos(contents, path, temporary, view | files, parts.length)
        if not stores_images(parts.features):
            return parts, rows
        depth = temporary / f"{DEPTH_KEY}.mp4"
        depth_range = DepthRange(parts.columns["depth_near_m"], parts.columns["depth_far_m"])
        filled = with_depth_images(rows, parts.features, depth, depth_range)
        depth.unlink()
        return parts, filled

    write_unit(folder, make)


def _pictures(features: Features) -> list[str]:
    return [key for key, feature in features.items() if feature["dtype"] in ("video", "image")]
