"""`vlnpe convert`: convert episodes between MCAP, LeRobot v3 and InternData-N1's VLN-PE layout."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from ...formats.core.errors import InputError, UnknownNameError
from ...formats.core.rollout import STATE_RATE_HZ
from ...formats.internnav.foreign import Assumptions
from ...formats.video.mp4 import RGB_CODECS
from ..stages import convert, convert_source
from ..summary import joined, stage_table
from .collect import opened

Json = Annotated[bool, tyro.conf.arg(name="json")]


@dataclass(frozen=True)
class Convert:
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
    hfov_deg: float = Assumptions.hfov_deg
    """N1 input: horizontal field of view of the camera [deg], which the layout does not store."""
    base_height_m: float | None = None
    """N1 input: height of the robot's base above the floor [m]; known for VLN-PE's robots."""
    frames_per_second: int = Assumptions.frames_per_second
    """N1 input: rows per second. A row is an action of 0.25 s, regardless of the file's fps and
    timestamps."""
    split: str = Assumptions.split
    """N1 input: split of the episodes."""
    rgb_codec: str = Assumptions.rgb_codec
    """N1 input: codec of the RGB video, h264 or av1."""
    workers: int = 0
    """Number of worker processes; 0 uses one per core."""
    max_failed: int = 0
    """Maximum number of quarantined episodes; exit with code 1 above it."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


def run_convert(options: Convert) -> int:
    """Convert all episodes of a source.

    Raises:
        InputError: If the source cannot be used, or an option is invalid.
    """
    chosen = _options(options)
    source = convert_source.detect(options.source)
    target = convert_source.Kind(options.to)
    if source.kind is target:
        raise InputError(f"{options.source}: is already {target}; choose another --to")
    with opened(options.out, options.workers) as context:
        summaries, written = convert.run(context, source, target, chosen)
    quarantined = sum(s.quarantined for s in summaries)
    code = int(quarantined > options.max_failed)
    if options.json:
        value = {
            "out": str(options.out),
            "written": [str(path) for path in written],
            "stages": {s.stage: s.counts() for s in joined(summaries)},
            "exit_code": code,
        }
        sys.stdout.write(json.dumps(value) + "\n")
        return code
    sys.stdout.write(f"\n{stage_table(summaries)}\n\n")
    for path in written:
        sys.stdout.write(f"written to {path}\n")
    if quarantined:
        reasons = options.out / "quarantine.json"
        sys.stdout.write(f"{quarantined} items were quarantined; see {reasons} for the reasons\n")
    return code


def _options(options: Convert) -> convert_source.Options:
    if options.rgb_codec not in RGB_CODECS:
        raise UnknownNameError("video codec", options.rgb_codec, RGB_CODECS)
    if not 0 < options.hfov_deg < 180:
        raise InputError(f"--hfov-deg {options.hfov_deg}: valid: between 0 and 180")
    if options.base_height_m is not None and not 0 < options.base_height_m < 10:
        raise InputError(f"--base-height-m {options.base_height_m}: valid: between 0 and 10")
    rate = options.frames_per_second
    if rate < 1 or STATE_RATE_HZ % rate:
        raise InputError(f"--frames-per-second {rate}: valid: a divisor of {STATE_RATE_HZ}")
    return convert_source.Options(
        options.licence,
        options.vocabulary,
        Assumptions(
            options.robot,
            options.hfov_deg,
            options.base_height_m,
            options.split,
            options.rgb_codec,
            rate,
        ),
        options.scan,
        options.every_frame,
    )
