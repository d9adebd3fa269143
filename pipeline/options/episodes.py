"""Options of the commands that make episodes: `align`, `filter`, `sample`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from ...trajectory_sampler.config import SampleConfig
from . import Json


@dataclass(frozen=True)
class Align:
    """Transform VLN-CE episodes into the frame of repaired scenes, snapped to free floor."""

    episodes: tyro.conf.Positional[Path]
    """VLN-CE episode file to read."""
    scenes: Path
    """Folder of repaired scenes, with one subfolder per scene, named after its scan."""
    out: Path = Path("aligned.json.gz")
    """Episode file to write."""
    max_failed: int = 0
    """Maximum number of rejected episodes; exit with code 1 above it."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


@dataclass(frozen=True)
class Filter:
    """Drop episodes that climb stairs, detected by height steps in the reference path."""

    episodes: tyro.conf.Positional[Path]
    """VLN-CE episode file to read."""
    out: Path = Path("kept.json.gz")
    """Episode file to write, in the same schema."""
    max_step_m: float = 0.3
    """Maximum height difference between consecutive reference path points [m]."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


@dataclass(frozen=True)
class Sample:
    """Sample new trajectories in a repaired scene."""

    scene: tyro.conf.Positional[Path]
    """Folder of a repaired scene."""
    out: Path = Path("episodes.json.gz")
    """Episode file to write."""
    count: int = 6
    """Number of episodes to sample."""
    min_length_m: float = SampleConfig.min_length_m
    """Minimum geodesic distance from start to goal [m]; the reference path is never shorter."""
    max_length_m: float = SampleConfig.max_length_m
    """Maximum length of the reference path [m]; the geodesic distance is never longer."""
    min_crossings: int = SampleConfig.min_crossings
    """Minimum number of room-to-room transitions per path; use 0 for a single-room scan."""
    robot_radius_m: float = SampleConfig.robot_radius_m
    """Clearance kept at every point of a path [m]."""
    seed: int = 0
    """Random seed."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""
