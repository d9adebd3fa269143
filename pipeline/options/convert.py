"""Options of the commands for existing data: `convert`, `restore`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from .running import Running
from .shared import Printing


@dataclass(frozen=True)
class Convert(Running):
    """Convert recorded episodes between MCAP, LeRobot v3 and InternData-N1's layout.

    MCAP ↔ LeRobot is lossless: RGB video packets are copied. The N1 layout stores decoded pixels:
    converting back re-encodes RGB, and depth is limited to 10 m.
    """

    source: tyro.conf.Positional[Path]
    """Folder of .mcap files, a single .mcap file, LeRobot v3 dataset, or InternData-N1 VLN-PE
    data."""
    to: Literal["mcap", "lerobot", "n1"]
    """Format to write."""
    out: Path = Path("converted")
    """Output folder; episodes are written to <to>/<name>/ in it."""
    licence: str = "unknown"
    """Licence to record for data that does not state one."""
    vocabulary: Path | None = None
    """N1: VLN-CE episode file whose vocabulary defines the instruction tokens; by default, the
    vocabulary is built from the dataset's own words."""
    scan: Literal["r2r", "r2r_aliengo", "r2r_flash"] | None = None
    """N1: folder to write; by default chosen from the robot and controller. InternNav reads r2r
    unless configured otherwise."""
    every_frame: bool = False
    """N1: write one row per frame, labelled with the expert's action at that pose, instead of one
    row per discrete step. Required for converting back without losing frames."""
    robot: str | None = None
    """N1 input: robot that recorded the data; by default read from info.json or the folder name."""
    hfov_deg: float = 90.0
    """N1 input: horizontal field of view of the camera [deg], which the layout does not store."""
    base_height_m: float | None = None
    """N1 input: height of the robot's base above the floor [m]; known for VLN-PE's robots."""
    frames_per_second: int = 4
    """N1 input: rows per second. A row is an action of 0.25 s, regardless of the file's fps and
    timestamps."""
    split: str = "train"
    """N1 input: split of the episodes."""
    rgb_codec: str = "h264"
    """N1 input: codec of the RGB video, h264 or av1."""


@dataclass(frozen=True)
class Restore(Printing):
    """Restore the metadata that LeRobot's delete, split and merge tools drop from a dataset.

    Episodes are matched by their frame rows. Restores the columns in meta/episodes (uid, scene,
    split, instructions, metrics, camera, …) and the provenance, splits and card of the dataset.
    """

    dataset: tyro.conf.Positional[Path]
    """Folder of the edited dataset; modified in place."""
    original: tuple[Path, ...]
    """Datasets that it was made from, as written by vlnpe."""
