"""One episode as step records: what every layout of a trainer is written from."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..convert.frame_rollout import start_frame, to_world
from ..core.camera import CameraModel
from ..core.errors import FileFormatError
from ..core.frames import quat_multiply, quat_to_matrix, yaw_to_quat
from ..core.rollout import DAGGER, TURN_STEP_RAD
from ..lerobot.episode_columns import camera_of
from ..lerobot.layout import RGB_KEY
from ..lerobot.units.rows import row_arrays
from ..lerobot.units.unit import EpisodeUnit, read_episode_unit
from ..rendered.discrete_steps import DiscreteSteps, discrete_steps, planar_poses
from ..video.stream import decode_frames

JPEG_QUALITY = 95


@dataclass(frozen=True)
class WalkSource:
    """An episode unit that goes into a layout.

    Attributes:
        folder: Folder of the unit.
        key: Name of its images and records, unique in the subset.
        texts: The instructions under which it is trained; at least one.
        others: Folders of units of the same walk from other rigs.
    """

    folder: Path
    key: str
    texts: tuple[str, ...]
    others: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Walk:
    """An opened unit.

    Attributes:
        rows: Frame columns by feature, (T, D).
    """

    unit: EpisodeUnit
    rows: dict[str, NDArray[Any]]

    @staticmethod
    def open(source: WalkSource) -> "Walk":
        """Open a unit; raises as `read_episode_unit`."""
        return Walk._of(source.folder)

    @staticmethod
    def open_all(source: WalkSource) -> "list[Walk]":
        """Open the units of all rigs.

        Raises:
            FileFormatError: If a unit is damaged, or is of another walk or another kind of camera.
        """
        first, *others = walks = [Walk._of(folder) for folder in (source.folder, *source.others)]
        for walk in others:
            for name in ("observation.state", "action"):
                if not np.array_equal(walk.rows[name], first.rows[name]):
                    raise FileFormatError(walk.unit.folder, f"{name} is not {first.unit.folder}'s")
            if not np.array_equal(walk.camera.intrinsics, first.camera.intrinsics):
                raise FileFormatError(
                    walk.unit.folder, f"its intrinsics are not {first.unit.folder}'s"
                )
        return walks

    @staticmethod
    def _of(folder: Path) -> "Walk":
        unit = read_episode_unit(folder)
        return Walk(unit, row_arrays(unit.rows()))

    @property
    def camera(self) -> CameraModel:
        """Return the camera of its images."""
        return camera_of(self.unit.columns)

    def steps(self, turn_rad: float = TURN_STEP_RAD) -> DiscreteSteps:
        """Return the discrete steps that end where the robot did when executed.

        In a walk of DAgger every frame is one, with the expert's action.
        """
        poses = planar_poses(self.rows["observation.state"])
        if self.unit.columns["controller"] == DAGGER:
            actions = self.rows["action.discrete"].ravel().astype(np.int64)
            return DiscreteSteps(np.arange(len(actions)), actions, poses)
        return discrete_steps(poses, turn_rad)

    def camera_poses(self) -> NDArray[np.float64]:
        """Return the camera's pose (T, 4, 4) in the world at each frame, optical axes."""
        start = start_frame(self.unit.columns)
        stored = self.rows["observation.camera_pose"].astype(np.float64)
        poses = np.tile(np.eye(4), (len(stored), 1, 1))
        poses[:, :3, :3] = quat_to_matrix(quat_multiply(yaw_to_quat(start.yaw_rad), stored[:, 3:]))
        poses[:, :3, 3] = to_world(start, stored[:, :3])
        return poses

    def floor_points(self) -> NDArray[np.float64]:
        """Return the floor (T, 3) [m] under the base in the world at each frame.

        The base is taken to keep its height above the floor, so that stairs count.
        """
        position = self.rows["observation.state"][:, :3].astype(np.float64)
        position[:, 2] -= position[0, 2]
        return to_world(start_frame(self.unit.columns), position)

    def write_jpegs(self, frames: NDArray[np.int64], paths: Sequence[Path]) -> None:
        """Write the frames (M,), ascending, possibly repeated, as M JPEG files.

        Raises:
            FileFormatError: If the video is damaged or has too few frames.
        """
        video, done = self.unit.video(RGB_KEY), 0
        for number, frame in enumerate(decode_frames(video)):
            if done < len(frames) and frames[done] == number:
                image = frame.to_ndarray(format="bgr24")
                data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
                while done < len(frames) and frames[done] == number:
                    paths[done].write_bytes(data.tobytes())
                    done += 1
        if done != len(frames):
            raise FileFormatError(video, f"has no frame {frames[done]}")

    def depth_codes(
        self, frames: NDArray[np.int64]
    ) -> tuple[NDArray[np.float32], Iterator[NDArray[np.uint16]]]:
        """Return the depth [m] of each code, and codes (H, W) of ascending frames (M,)."""
        shown, repeats = np.unique(frames, return_counts=True)
        depth_m, images = self.unit.depth_codes(shown.tolist())
        repeated = zip(images, repeats.tolist(), strict=True)
        return depth_m, (codes for codes, times in repeated for _ in range(times))
