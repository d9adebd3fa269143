"""Videos of integers beside colour and depth (labels, objects): each frame a 16-bit PNG message."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from foxglove.channels import CompressedImageChannel
from foxglove.messages import CompressedImage

from ..core.arrays import U16
from ..core.errors import FileFormatError
from ..core.rollout import Rollout
from ..rendered.folder import FrameFolder, video_name
from ..video.id_video import CODEC, IdVideoWriter
from ..video.mux import iterate_bitstream
from .camera_streams import topic_messages
from .recording import Contents, Recording, timestamp
from .topics import CAMERA_FRAME, Write, logged

ID_TOPIC = "/camera/{name}"
LABELS_NAME = "labels.json"  # beside the videos: names of their numbers


def id_videos(facts: Mapping[str, Any]) -> dict[str, str]:
    """Return the names and files of the videos of integers that a view's facts (meta.json) list."""
    return {
        name: str(value["file"])
        for name, value in facts.items()
        if isinstance(value, Mapping) and value.get("codec") == CODEC and "file" in value
    }


def id_messages(recording: Recording, rollout: Rollout, view: FrameFolder) -> list[Iterator[Write]]:
    """Return each video's frames, its own PNG packets, one stream of messages per video."""
    folder = view.rgb_video.parent
    return [
        _messages(recording, rollout, view, name, folder / file)
        for name, file in id_videos(view.facts).items()
    ]


def extract_id_videos(
    contents: Contents, path: Path, folder: Path, facts: Mapping[str, Any], count: int
) -> None:
    """Write the videos that `facts` lists into `folder`, exactly."""
    for name in id_videos(facts):
        messages = topic_messages(contents, path, ID_TOPIC.format(name=name), count)
        with IdVideoWriter(
            folder / video_name(facts, name, path), facts["frames_per_second"]
        ) as writer:
            for message in messages:
                writer.write(_decode(message.data, path, name))
    attached = contents.attachments.get(LABELS_NAME)
    if attached is not None:
        (folder / LABELS_NAME).write_bytes(attached.data)


def _messages(
    recording: Recording, rollout: Rollout, view: FrameFolder, name: str, video: Path
) -> Iterator[Write]:
    channel = CompressedImageChannel(ID_TOPIC.format(name=name), context=recording.context)
    times = rollout.time_s[view.arrays["sample_index"]]
    for time_s, packet in zip(times, iterate_bitstream(video), strict=True):
        image = CompressedImage(
            timestamp=timestamp(time_s), frame_id=CAMERA_FRAME, data=packet, format="png"
        )
        yield logged(channel, time_s, image)


def _decode(data: bytes, path: Path, name: str) -> U16:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    if image is None or image.dtype != np.uint16 or image.ndim != 2:
        raise FileFormatError(path, f"topic {ID_TOPIC.format(name=name)}: not a 16-bit PNG")
    return np.asarray(image, np.uint16)
