"""Options of the commands from rollouts to data: `replay`, `render`, `export`."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from .running import Running
from .shared import DatasetFormat, Drawing, Driving


@dataclass(frozen=True)
class Replay(Driving, Running):
    """Execute episodes with a physically simulated robot; records states, no images."""

    episodes: tyro.conf.Positional[Path]
    """Episode file written by `instruct`, `sample` or `align`, or run folder of `collect`."""
    scenes: Path | None = None
    """Folder of repaired scenes; by default the run's."""
    out: Path = Path("rollouts")
    """Output folder; rollouts are written to <robot>/<controller>/<episode>.mcap in it."""
    robot: str = "aliengo"
    """Robots to run: a name (see `vlnpe robots`), the folder of your own robot, a comma-separated
    list (h1,g1), or `all` for every built-in robot with a body."""
    seed: int = 0
    """Random seed."""


@dataclass(frozen=True)
class Render(Drawing, Running):
    """Render rollouts: RGB and depth from any camera, or preview videos."""

    rollouts: tyro.conf.Positional[Path]
    """Folder written by `replay`, or run folder of `collect`."""
    scenes: Path | None = None
    """Folder of repaired scenes; by default the run's."""
    episode: str | None = None
    """Only the walks of this episode, named as in the report."""
    out: Path = Path("frames")
    """Output folder; frames are written to <robot>/<controller>/<view>/<episode>/ in it."""
    camera: str = "ego"
    """Cameras: ego (the robot's own), chase, top, a rig, or a comma-separated list (ego,rig:n1),
    each with an optional size and field of view (ego:640x480:79); see `vlnpe collect`."""
    width_px: int | None = None
    """Image width [px]; defaults to the camera's own."""
    height_px: int | None = None
    """Image height [px]; defaults to the camera's own."""
    hfov_deg: float | None = None
    """Horizontal field of view [deg]; defaults to the camera's own."""
    frames_per_second: int | None = None
    """Rendered frames per second: 4, 5, 10, 20, 25 or 50. Defaults to 4, or to 25 with --video."""
    depth_mm: bool = False
    """Also write depth in whole millimetres: depth_mm.mov (16-bit PNG frames)."""
    video: bool = False
    """Write one preview video (.mp4) per episode instead of data."""


@dataclass(frozen=True)
class Export(DatasetFormat, Running):
    """Export rendered rollouts as LeRobot v3 datasets and as MCAP files."""

    frames: tyro.conf.Positional[Path]
    """Folder written by `render`, or run folder of `collect`."""
    scenes: Path | None = None
    """Folder of repaired scenes; by default the run's."""
    out: Path = Path("data")
    """Output folder; datasets are written to lerobot/<dataset>/ and mcap/<dataset>/ in it."""
    without_flagged: bool = False
    """Leave out walks that were flagged in `vlnpe view`."""
