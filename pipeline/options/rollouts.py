"""Options of the commands from rollouts to data: `replay`, `render`, `export`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from . import Json
from .running import Running


@dataclass(frozen=True)
class Replay(Running):
    """Execute episodes with a physically simulated robot; records states, no images."""

    episodes: tyro.conf.Positional[Path]
    """Episode file written by `instruct`, `sample` or `align`."""
    scenes: Path
    """Folder of repaired scenes."""
    out: Path = Path("rollouts")
    """Output folder; rollouts are written to <robot>/<controller>/<episode>.mcap in it."""
    robot: str = "aliengo"
    """Robots to run: a name (see `vlnpe robots`), the folder of your own robot, a comma-separated
    list (h1,g1), or `all` for every built-in robot with a body."""
    controller: str = "auto"
    """Controllers to run: path, speed or flash, a comma-separated list (path,speed), or `all`.
    `auto` selects path, or flash for an agent without a body."""
    action_steps: int = 50
    """Duration of a discrete action of the speed controller, in physics steps of 5 ms."""
    closed_loop: bool = False
    """Run each discrete action of the speed controller until its 0.25 m or 15° is reached, instead
    of for a fixed number of steps."""
    seed: int = 0
    """Random seed."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


@dataclass(frozen=True)
class Render(Running):
    """Render rollouts: RGB and depth from any camera, or preview videos."""

    rollouts: tyro.conf.Positional[Path]
    """Folder written by `replay`."""
    scenes: Path
    """Folder of repaired scenes."""
    out: Path = Path("frames")
    """Output folder; frames are written to <robot>/<controller>/<view>/<episode>/ in it."""
    camera: str = "ego"
    """Cameras: ego (the robot's own camera), chase, top, or a comma-separated list (ego,chase),
    each with an optional size and field of view (ego:640x480:79)."""
    width_px: int | None = None
    """Image width [px]; defaults to the camera's own."""
    height_px: int | None = None
    """Image height [px]; defaults to the camera's own."""
    hfov_deg: float | None = None
    """Horizontal field of view [deg]; defaults to the camera's own."""
    camera_height: float | None = None
    """Height of the robot's own camera above the floor [m], standing; defaults to the robot's. A
    moved camera does not see the robot's body."""
    camera_pitch: float | None = None
    """Downward tilt of the robot's own camera [deg]; defaults to the robot's."""
    light: str = "baked"
    """Lighting: baked (as scanned), DL5000 (panel lights, day), DL300 (night), CL (a lamp on the
    robot), a comma-separated list (DL5000,CL), or `all`."""
    renderer: str = "auto"
    """Renderer: embree (ray tracing on the CPU), gl (MuJoCo through EGL), splat (Gaussian splats,
    depth of the mesh), splat_depth (depth of the splats too), or auto, which selects splat in
    scenes of splats, else gl if a GPU is available, else embree."""
    frames_per_second: int | None = None
    """Rendered frames per second: 4, 5, 10, 20, 25 or 50. Defaults to 4, or to 25 with --video."""
    semantic: bool = False
    """Also render semantic segmentation: semantic.mov, and labels.json with the class names."""
    instance: bool = False
    """Also render instance segmentation: instance.mov, and labels.json with the object names."""
    depth_mm: bool = False
    """Also write depth in whole millimetres: depth_mm.mov (16-bit PNG frames)."""
    video: bool = False
    """Write one preview video (.mp4) per episode instead of data."""
    rgb_codec: str = "h264"
    """Codec of RGB videos: h264, or av1 (royalty-free)."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


@dataclass(frozen=True)
class Export(Running):
    """Export rendered rollouts as LeRobot v3 datasets and as MCAP files."""

    frames: tyro.conf.Positional[Path]
    """Folder written by `render`."""
    scenes: Path
    """Folder of repaired scenes."""
    out: Path = Path("data")
    """Output folder; datasets are written to lerobot/<dataset>/ and mcap/<dataset>/ in it."""
    per_instruction: bool = False
    """Write one LeRobot episode per instruction, each with the same frames. By default a path is
    one episode that carries all its instructions."""
    only_success: bool = False
    """Export only successful episodes. By default all are exported, each with its end reason."""
    depth: str = "video"
    """Depth storage in LeRobot datasets: video (lossless, 12-bit codes) or image (16-bit, mm)."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""
