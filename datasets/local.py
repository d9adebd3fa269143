"""Open a collected dataset with LeRobot, without any network (extra `train`)."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..formats.core.errors import FileFormatError, MissingExtraError
from ..formats.lerobot.info import read_info
from ..formats.untrusted.files import check_links

if TYPE_CHECKING:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset


def open_dataset(root: Path, **options: Any) -> LeRobotDataset:
    """Open the LeRobot v3 dataset in folder `root`, offline, with depth in metres.

    Args:
        root: a dataset folder, e.g.
            `runs/apartment-0/lerobot/aliengo-path-ego-256x256-90deg-baked`.
        options: passed on to `LeRobotDataset`, e.g. `delta_timestamps`, `episodes`.

    Raises:
        FileFormatError: no dataset there, or one that leads out of its folder.
        MissingExtraError: The extra `train` is not installed.
    """
    if not (root / "meta" / "info.json").is_file():
        raise FileFormatError(root, "no LeRobot dataset here (meta/info.json is missing)")
    # LeRobot fills in the templates of info.json and follows links without looking.
    read_info(root)
    check_links(root)
    # LeRobot asks the hub for a dataset's version even when all its files are here.
    os.environ.setdefault("HF_HUB_OFFLINE", "1")
    try:
        from lerobot.datasets.lerobot_dataset import LeRobotDataset
    except ImportError as error:
        raise MissingExtraError("opening a dataset with LeRobot", "train") from error
    options.setdefault("depth_output_unit", "m")  # LeRobot's own default is millimetres
    options.setdefault("video_backend", _video_backend())
    return LeRobotDataset(f"vlnpe/{root.name}", root=root, **options)


def _video_backend() -> str:
    """Return LeRobot's own choice of a video backend without its warning.

    torchcodec comes with LeRobot but needs FFmpeg's libraries of the system; PyAV brings its own.
    """
    try:
        import torchcodec  # noqa: F401
    except (ImportError, OSError, RuntimeError):
        return "pyav"
    return "torchcodec"
