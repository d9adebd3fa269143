"""A rollout with its rendered frames as one MCAP file that holds the whole episode, and back.

Everything `write_rollout` writes, and: colour as the video's own packets (CompressedVideo, no loss
beyond the video's), depth as 16-bit millimetres (RawImage 16UC1, 0 = invalid), camera calibration,
the camera's transform, commands, discrete actions, the instruction, the reference path, the scene's
map, the robot's body, and as an attachment the exact numbers behind the frames. `read_rollout`
reads these files, too; `extract_contents` gives back everything.
"""

import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import U16
from ..core.atomic import atomic_folder
from ..core.errors import FileFormatError
from ..core.rollout import STATE_RATE_HZ, Rollout
from ..rendered.folder import FrameFolder, read_frame_folder
from ..rendered.table import build_frame_table
from ..untrusted.arrays import read_arrays
from ..untrusted.documents import parse_json
from ..video.stream import probe_video
from .camera import camera_messages
from .camera_streams import extract_videos
from .facts import JSON_KEY, METADATA_NAME, rollout_facts
from .id_images import LABELS_NAME, extract_id_videos, id_messages, id_videos
from .plan import plan_messages
from .recording import Contents, Recording, open_recording
from .rollout import SHOW_EVERY, rollout_of
from .sensors import action_messages, command_messages, foot_messages, imu_messages
from .shown import ShownTopic, extract_shown, shown_messages
from .topics import event_messages, motion_messages, state_messages, write_in_order

VIEW_METADATA = "vlnpe.view"
DATASET_METADATA = "vlnpe.dataset"
INSTRUCTION_METADATA = "vlnpe.instruction"
FRAMES_ATTACHMENT = "frames.npz"


@dataclass(frozen=True)
class ExtractedEpisode:
    """The result of `extract_contents`.

    Attributes:
        rollout: physics truth, exact.
        shown: the scene's map and the robot's body, as far as they are in the file.
        dataset: facts of the dataset that the file came from, or None.
    """

    rollout: Rollout
    frames: FrameFolder
    shown: tuple[ShownTopic, ...]
    dataset: dict[str, Any] | None


def write_episode_mcap(
    path: Path,
    rollout: Rollout,
    frames: Path,
    *,
    shown: Sequence[ShownTopic] = (),
    dataset: Mapping[str, Any] | None = None,
    depth_codes: Iterable[U16] | None = None,
) -> None:
    """Write the episode atomically; all times are simulation times.

    Args:
        frames: folder that the render stage wrote for this rollout.
        shown: the scene's map and the robot's body (`map_topic`, `robot_topics`).
        dataset: facts of the dataset the episode belongs to (JSON values), when there is one.
        depth_codes: (H, W) of each frame, if they are known; else the video is decoded.

    Raises:
        FileFormatError: the frames are damaged, or not of this rollout.
        ValueError: the depth range does not fit into 16 bits of millimetres.
    """
    view = read_frame_folder(frames)
    _check_frames(frames, view, rollout)
    # Where there is a frame there is a base pose, whatever the frame rate.
    every = math.gcd(SHOW_EVERY, STATE_RATE_HZ // view.frames_per_second)
    with open_recording(path) as recording:
        write_records(recording, rollout, view, dataset)
        write_in_order(
            *(shown_messages(recording, topic) for topic in shown),
            plan_messages(recording, rollout),
            state_messages(recording, rollout),
            motion_messages(recording, rollout, every),
            command_messages(recording, rollout, every),
            imu_messages(recording, rollout, every),
            foot_messages(recording, rollout, every),
            action_messages(recording, rollout, _labels(rollout, view)),
            camera_messages(recording, rollout, view, depth_codes),
            *id_messages(recording, rollout, view),
            event_messages(recording, rollout),
        )


def write_blind_mcap(
    path: Path, rollout: Rollout, view: FrameFolder, shown: Sequence[ShownTopic] = ()
) -> None:
    """Write all of an episode but colour and depth, atomically.

    A dataset that keeps it beside its videos loses nothing of the episode; `extract_records` and
    `extract_id_videos` read it.
    """
    with open_recording(path) as recording:
        write_records(recording, rollout, view, None)
        write_in_order(
            *(shown_messages(recording, topic) for topic in shown),
            state_messages(recording, rollout),
            motion_messages(recording, rollout, SHOW_EVERY),
            *id_messages(recording, rollout, view),
            event_messages(recording, rollout),
        )


def write_records(
    recording: Recording, rollout: Rollout, view: FrameFolder, dataset: Mapping[str, Any] | None
) -> None:
    """Write the episode's metadata and attachments."""
    writer = recording.writer
    writer.write_metadata(METADATA_NAME, rollout_facts(rollout))
    writer.write_metadata(INSTRUCTION_METADATA, {"text": rollout.episode.instruction})
    write_json_metadata(recording, VIEW_METADATA, view.facts)
    if dataset is not None:
        write_json_metadata(recording, DATASET_METADATA, dataset)
    attach(recording, FRAMES_ATTACHMENT, "application/x-npz", _pack(view.arrays))
    labels = view.rgb_video.parent / LABELS_NAME
    if labels.is_file():
        attach(recording, LABELS_NAME, "application/json", labels.read_bytes())


def write_json_metadata(recording: Recording, name: str, value: Mapping[str, Any]) -> None:
    """Write JSON values as a metadata record."""
    text = json.dumps(dict(value), ensure_ascii=False)
    recording.writer.write_metadata(name, {JSON_KEY: text})


def read_json_metadata(contents: Contents, name: str, path: Path) -> Any:
    """Return the inverse of `write_json_metadata`; None when there is no such record."""
    record = contents.metadata.get(name)
    if record is None:
        return None
    try:
        value = parse_json(path, record[JSON_KEY].encode())
    except (KeyError, UnicodeEncodeError, FileFormatError) as error:
        reason = error.reason if isinstance(error, FileFormatError) else repr(error)
        raise FileFormatError(path, f"metadata {name} is damaged: {reason}") from error
    if not isinstance(value, dict):
        raise FileFormatError(path, f"metadata {name} is damaged: no JSON object")
    return value


def attach(recording: Recording, name: str, media_type: str, data: bytes) -> None:
    """Attach a file."""
    recording.writer.attach(log_time=0, create_time=0, name=name, media_type=media_type, data=data)


def extract_contents(contents: Contents, path: Path, folder: Path) -> ExtractedEpisode:
    """Return what `write_episode_mcap` wrote, and write its frames as the render stage does.

    The colour video gets the very packets it had; depth is encoded again, without loss. `folder`,
    which the frames go to, is replaced as a whole.
    """
    rollout, facts, arrays = extract_records(contents, path)
    with atomic_folder(folder) as temporary:
        count = len(arrays["sample_index"])
        extract_videos(contents, path, temporary, facts, count)
        extract_id_videos(contents, path, temporary, facts, count)
        write_frame_records(temporary, facts, arrays)
    frames = read_frame_folder(folder)
    _check_frames(path, frames, rollout)
    dataset = read_json_metadata(contents, DATASET_METADATA, path)
    return ExtractedEpisode(rollout, frames, extract_shown(contents), dataset)


def extract_records(
    contents: Contents, path: Path
) -> tuple[Rollout, dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the rollout, facts of the view (meta.json) and arrays of its frames (frames.npz)."""
    rollout = rollout_of(contents, path)
    facts = read_json_metadata(contents, VIEW_METADATA, path)
    attached = contents.attachments.get(FRAMES_ATTACHMENT)
    if facts is None or attached is None:
        missing = VIEW_METADATA if facts is None else FRAMES_ATTACHMENT
        raise FileFormatError(path, f"not an episode with images: {missing} is missing")
    try:
        arrays = read_arrays(path, attached.data)
    except FileFormatError as error:
        raise FileFormatError(path, f"{FRAMES_ATTACHMENT} is damaged: {error.reason}") from error
    if "sample_index" not in arrays:
        raise FileFormatError(path, f"{FRAMES_ATTACHMENT} is damaged: sample_index is missing")
    return rollout, facts, arrays


def write_frame_records(
    folder: Path, facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write meta.json and frames.npz of a folder of rendered frames; the videos lie there."""
    (folder / "frames.npz").write_bytes(_pack(arrays))
    (folder / "meta.json").write_text(json.dumps(dict(facts), indent=2) + "\n")


def _labels(rollout: Rollout, view: FrameFolder) -> dict[float, int]:
    """Return `action.discrete` by frame time, if a dataset of these frames would have it."""
    table = build_frame_table(rollout, view.arrays, view.frames_per_second)
    labels = np.ravel(table.columns.get("action.discrete", ())).tolist()
    times = rollout.time_s[view.arrays["sample_index"]].tolist()
    return {t: int(label) for t, label in zip(times, labels, strict=True)} if labels else {}


def _pack(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    packed = io.BytesIO()
    np.savez_compressed(packed, allow_pickle=False, **arrays)
    return packed.getvalue()


def _check_frames(path: Path, view: FrameFolder, rollout: Rollout) -> None:
    """Raise FileFormatError unless the frames belong to this rollout and are complete."""
    samples = view.arrays["sample_index"]
    expected = rollout.frame_samples(view.frames_per_second)
    if not np.array_equal(samples, expected[: len(samples)]) or len(samples) == 0:
        raise FileFormatError(path, f"its {len(samples)} frames do not belong to this rollout")
    others = [view.rgb_video.parent / file for file in id_videos(view.facts).values()]
    for video in (view.rgb_video, view.depth_video, *others):
        if (count := probe_video(video).frames) != len(samples):
            raise FileFormatError(video, f"{count} frames, but {len(samples)} poses")
