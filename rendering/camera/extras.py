"""Optional videos beside RGB and depth: labels, objects, depth in whole millimetres."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...formats.core.arrays import F32, U8
from ...formats.core.atomic import write_json
from ...formats.core.camera import DepthRange
from ...formats.scene.bundle import SceneBundle
from ...formats.video.depth_codes import MAX_MILLIMETRES_M
from ...formats.video.id_video import CODEC, MAX_ID, IdVideoWriter
from ..frame import ROBOT, Frame

LABELS_NAME = "labels.json"
# Codes in the videos: 0 = nothing or unlabelled, 1 = the robot, 2 + k = name k.
ROBOT_CODE, FIRST_CODE = 1, 2


@dataclass(frozen=True)
class Extras:
    """Optional videos to write.

    Attributes:
        semantic: `semantic.mov`, the label of each pixel.
        instance: `instance.mov`, the object of each pixel.
        millimetres: `depth_mm.mov`, planar depth in whole millimetres, 0 = invalid.
    """

    semantic: bool = False
    instance: bool = False
    millimetres: bool = False

    def names(self) -> list[str]:
        """Return the names of these videos, without suffix."""
        enabled = {
            "semantic": self.semantic,
            "instance": self.instance,
            "depth_mm": self.millimetres,
        }
        return [name for name, written in enabled.items() if written]

    @property
    def labelled(self) -> bool:
        """Whether pixels must be labelled."""
        return self.semantic or self.instance

    def facts(self) -> dict[str, Any]:
        """Return the entries for the frame folder's meta.json."""
        return {name: {"file": f"{name}.mov", "codec": CODEC} for name in self.names()}


def write_extras(
    folder: Path,
    frames: Iterator[Frame],
    extras: Extras,
    bundle: SceneBundle,
    frames_per_second: int,
    depth_range: DepthRange,
) -> Iterator[tuple[U8, F32]]:
    """Yield RGB and depth of each frame while writing the optional videos.

    If pixels are labelled, `labels.json` with the names of the codes is written, too.

    Raises:
        ValueError: the scene has more names than codes, or the depth range exceeds 16 bits of
            millimetres.
    """
    if max(len(bundle.labels), len(bundle.objects)) + FIRST_CODE > MAX_ID:
        raise ValueError(
            f"{bundle.scene_id} has too many labels or objects; valid: up to {MAX_ID - FIRST_CODE}"
        )
    if extras.millimetres and depth_range.far_m > MAX_MILLIMETRES_M:
        raise ValueError(
            f"depth range up to {depth_range.far_m} m; valid: up to {MAX_MILLIMETRES_M} m"
        )
    with contextlib.ExitStack() as stack:
        writers = {
            name: stack.enter_context(IdVideoWriter(folder / f"{name}.mov", frames_per_second))
            for name in extras.names()
        }
        for frame in frames:
            for name, writer in writers.items():
                writer.write(_image(name, frame, depth_range))
            yield frame.rgb, frame.depth_m
    if extras.labelled:
        write_json(folder / LABELS_NAME, _names(bundle))


def _image(name: str, frame: Frame, limits: DepthRange) -> NDArray[np.integer]:
    if name == "depth_mm":
        depth = frame.depth_m
        valid = (depth >= limits.near_m) & (depth <= limits.far_m)
        return np.where(valid, np.rint(depth * 1000.0), 0.0).astype(np.uint16)
    ids = frame.label if name == "semantic" else frame.thing
    return np.where(ids == ROBOT, ROBOT_CODE, np.where(ids < 0, 0, ids + FIRST_CODE))


def _names(bundle: SceneBundle) -> dict[str, Any]:
    common: dict[str, Any] = {"0": "", str(ROBOT_CODE): "robot"}
    labels = {str(k + FIRST_CODE): name for k, name in enumerate(bundle.labels)}
    objects = {
        str(k + FIRST_CODE): {"name": thing.name, "category": thing.category}
        for k, thing in enumerate(bundle.objects)
    }
    robot = {"0": None, str(ROBOT_CODE): {"name": "robot", "category": "robot"}}
    return {"semantic": common | labels, "instance": robot | objects}
