"""Command `convert`: episodes between MCAP, LeRobot v3 and InternData-N1's VLN-PE layout."""

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
    """Convert recorded episodes: MCAP, LeRobot v3 and InternData-N1's layout, each to each.

    MCAP ↔ LeRobot loses nothing: colour packets are copied. The N1 layout stores pixels: colour is
    encoded again on the way back, and depth ends at 10 m.
    """

    source: tyro.conf.Positional[Path]
    """A folder of .mcap files (or one), a LeRobot v3 dataset, or InternData-N1 VLN-PE data."""
    to: Literal["mcap", "lerobot", "n1"]
    """What to write."""
    out: Path = Path("converted")
    """Folder for <to>/<name>/."""
    licence: str = "unknown"
    """Licence of data that does not tell its own."""
    vocabulary: Path | None = None
    """N1: take instruction tokens from this VLN-CE episode file; by default our own words."""
    scan: Literal["r2r", "r2r_aliengo", "r2r_flash"] | None = None
    """N1: the folder to write; by default as robot and controller say. InternNav reads r2r unless
    told otherwise."""
    every_frame: bool = False
    """N1: a row per frame, with the action an expert would take there, instead of a row per
    discrete step; only so does the way back lose no frames."""
    robot: str | None = None
    """N1 in: whose data it is; by default as its info.json or its folder says."""
    hfov_deg: float = Assumptions.hfov_deg
    """N1 in: the camera's horizontal field of view, which the layout does not tell."""
    base_height_m: float | None = None
    """N1 in: height of the robot's base over the floor; known for VLN-PE's robots."""
    frames_per_second: int = Assumptions.frames_per_second
    """N1 in: rows per second; a row is an action of 0.25 s, whatever fps and timestamps say."""
    split: str = Assumptions.split
    """N1 in: the episodes' split."""
    rgb_codec: str = Assumptions.rgb_codec
    """N1 in: codec of the colour video, h264 or av1."""
    workers: int = 0
    """Worker processes; 0 takes one per core."""
    max_failed: int = 0
    """Exit with code 1 when more episodes than this are quarantined."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


def run_convert(options: Convert) -> int:
    """Convert all episodes of a source.

    Raises:
        InputError: an unusable source or option.
    """
    chosen = _options(options)
    source = convert_source.detect(options.source)
    target = convert_source.Kind(options.to)
    if source.kind is target:
        raise InputError(f"{options.source}: is {target} already; valid: another --to")
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
        sys.stdout.write(f"{quarantined} items were quarantined; their reasons: {reasons}\n")
    return code


def _options(options: Convert) -> convert_source.Options:
    if options.rgb_codec not in RGB_CODECS:
        raise UnknownNameError("video codec", options.rgb_codec, RGB_CODECS)
    if not 0 < options.hfov_deg < 180:
        raise InputError(f"--hfov-deg {options.hfov_deg}; valid: between 0 and 180")
    if options.base_height_m is not None and not 0 < options.base_height_m < 10:
        raise InputError(f"--base-height-m {options.base_height_m}; valid: between 0 and 10")
    rate = options.frames_per_second
    if rate < 1 or STATE_RATE_HZ % rate:
        raise InputError(f"--frames-per-second {rate}; valid: a divisor of {STATE_RATE_HZ}")
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
