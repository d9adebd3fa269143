"""Options of the commands for existing data: `convert`, `restore`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from .running import Running
from .shared import Printing


@dataclass(frozen=True)
class Convert(Running):
    """Convert recorded episodes between formats, and into the layouts that VLN models train on.

    MCAP ↔ LeRobot is lossless: RGB video packets are copied. The N1 layout stores decoded pixels:
    converting back re-encodes RGB, and depth is limited to 10 m. The layouts of trainers hold
    discrete steps and cannot be converted back.
    """

    source: tyro.conf.Positional[Path]
    """Run folder, LeRobot v3 dataset, folder of .mcap files, a single .mcap file, InternData-N1
    VLN-PE data, or bags of ROS 2."""
    to: str = "lerobot"
    """Format to write: mcap, lerobot, n1, ros2 (a bag of ROS 2 per walk), or the layout of a
    trainer: navila, streamvln, internvla-n1, navdp, uni-navid, sharegpt."""
    from_: Annotated[str, tyro.conf.arg(name="from")] = ""
    """Format of the source; by default it is detected."""
    out: Path = Path("converted")
    """Output folder; episodes are written to <to>/<name>/ in it."""
    licence: str = "unknown"
    """Licence to record for data that does not state one."""
    balance: str = ""
    """Layouts with a record per answer: how often kinds of answers occur. natural, navila (equally
    often), uni-navid (3.5 : 2 : 2 : 1.5), or shares: forward=3.5,left=2,right=2,stop=1.5. Records
    of rare kinds are repeated, and none is dropped. By default that of the layout's authors."""
    keep_failures: bool = False
    """Also write episodes that failed: internvla-n1 and navdp, whose meta/episodes.jsonl says how
    each ended."""
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
    """N1 and ROS 2 input: robot that recorded the data; N1's is by default read from info.json or
    the folder name.
    ros2: robot whose model the bags describe, or its folder; by default the data's."""
    hfov_deg: float = 90.0
    """N1 input: horizontal field of view of the camera [deg], which the layout does not store."""
    base_height_m: float | None = None
    """N1 and ROS 2 input: height of the robot's base above the floor [m]; known for VLN-PE's
    robots."""
    frames_per_second: int = 4
    """ROS 2 input: frames per second. N1 input: rows per second. A row is an action of 0.25 s,
    regardless of the file's fps and timestamps."""
    map: Path | None = None
    """ROS 2 input: YAML file that says which topics hold what, if not those that vlnpe writes."""
    instruction: Path | None = None
    """ROS 2 input: text file with the instruction of bags that have none on a topic; or, written
    after a first conversion, a .json file with texts by episode: {"walk-000": "Go past …"}."""
    split: str = "train"
    """N1 and ROS 2 input: split of the episodes."""
    rgb_codec: str = "h264"
    """N1 and ROS 2 input: codec of the RGB video, h264 or av1."""


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
