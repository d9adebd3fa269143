"""Options of `vlnpe collect`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...trajectory_sampler.config import SampleConfig
from . import Json
from .episodes import Sampling
from .running import Running


@dataclass(frozen=True)
class Collect(Running, Sampling):
    """Collect a dataset: repair, sample, instruct, replay, render, export, report.

    All outputs go into one run folder. Finished work is reused, and changing an option redoes only
    the work that depends on it.
    """

    robot: str = "aliengo"
    """Robots to run: a name (see `vlnpe robots`), the folder of your own robot, a comma-separated
    list (h1,g1), or `all` for every built-in robot with a body. All robots get the same episodes,
    sampled with clearance for the widest one."""
    controller: str = "auto"
    """Controllers to run: path, speed or flash, a comma-separated list (path,speed), or `all`.
    `auto` selects path, or flash for an agent without a body."""
    action_steps: int = 50
    """Duration of a discrete action of the speed controller, in physics steps of 5 ms."""
    closed_loop: bool = False
    """Run each discrete action of the speed controller until its 0.25 m or 15° is reached, instead
    of for a fixed number of steps."""
    scene: str = "builtin"
    """Scan to collect in (GLB, glTF, OBJ, PLY, STL, USD, a point cloud or Gaussian splats; see
    docs/scans.md and docs/splats.md), or `builtin` for a generated apartment; builtin:villa,
    builtin:house and builtin:office are larger buildings, builtin:villa*10 is ten of them, of
    consecutive seeds, and builtin-exact:villa*10 the same ten without the virtual scan. Built-in
    scenes can be listed, comma-separated. With a preset, a kind without a number stands for as many
    buildings as the preset needs."""
    scenes: Path | None = None
    """Folder of scans. All of them are used, or only those named by the scene ids of the VLN-CE
    file in --episodes."""
    episodes: str = "6"
    """Number of paths to sample per scene, a preset (gru_vln10, lab_3dgs), a VLN-CE episode file
    (.json.gz), or several of them, comma-separated, one per split."""
    robot_radius_m: float = SampleConfig.robot_radius_m
    """Clearance of sampled paths [m]; a wider robot in the run raises it. Set it to that of the
    widest robot that may join the run later, so that the paths stay the same (jetbot: 0.38)."""
    stair_rules: str = "step"
    """Rules by which episodes of a VLN-CE file are dropped, comma-separated: step, geometric, text;
    see `vlnpe filter`."""
    goal_beyond_start: bool = False
    """Accept VLN-CE paths whose goal is moved farther out of collision than their start, instead of
    rejecting them."""
    per_instruction: bool = False
    """Write one episode per instruction into episode files and LeRobot datasets. By default a path
    is one episode that carries all its instructions."""
    camera: str = "ego"
    """Cameras to render: ego, chase, top, or a comma-separated list (ego,chase), each with an
    optional size and field of view (ego:640x480:79). Each camera becomes a separate dataset."""
    camera_height: float | None = None
    """Height of the robot's own camera above the floor [m], standing; defaults to the robot's. A
    moved camera does not see the robot's body."""
    camera_pitch: float | None = None
    """Downward tilt of the robot's own camera [deg]; defaults to the robot's."""
    light: str = "baked"
    """Lighting: baked (as scanned), DL5000 (panel lights, day), DL300 (night), CL (a lamp on the
    robot), a comma-separated list (DL5000,CL), or `all`. Each becomes a separate dataset."""
    renderer: str = "auto"
    """Renderer: embree (ray tracing on the CPU), gl (MuJoCo through EGL), splat (Gaussian splats,
    depth of the mesh), splat_depth (depth of the splats too), or auto, which selects splat in
    scenes of splats, else gl if a GPU is available, else embree."""
    writer: str = "composer"
    """Writer of the instructions: composer (offline), llm (any OpenAI-compatible server, see
    docs/instructions.md), or local (a GGUF model on disk)."""
    style: str = "mixed"
    """Styles of the instructions: natural, terse, rich, a comma-separated list (terse,rich), or
    mixed, which alternates between all."""
    count: int = 3
    """Number of instructions per path and language."""
    language: str = "en"
    """Languages of the instructions: en, zh, hi, or a comma-separated list (en,zh). Languages other
    than en need a language model."""
    replace: bool = False
    """Also rewrite instructions that a VLN-CE file already has."""
    max_tokens: int = 0
    """Stop querying the language model after this many tokens; 0 means no limit."""
    max_cost: float = 0.0
    """Stop querying after this cost, at the prices set in the environment; 0 means no limit."""
    up: str = "auto"
    """Up axis of the scans: x, y, z, -x, -y, -z, or auto to detect it."""
    unit: str = "auto"
    """Length unit of the scans: m, cm, mm, in, ft, or auto to detect it."""
    collision: Path | None = None
    """Mesh, USD stage or InteriorGS' occupancy.png to use as the surface of Gaussian splats."""
    allow_unsound: bool = False
    """Also collect in scenes whose repair is not sound, instead of quarantining them. The report
    and the dataset card list them."""
    out: Path | None = None
    """Run folder; defaults to `runs/<scene>`."""
    seed: int = 0
    """Random seed of the built-in scene (the first of several), the sampling and every other random
    choice."""
    semantic: bool = False
    """Also render semantic segmentation (semantic.mov, and in MCAP)."""
    instance: bool = False
    """Also render instance segmentation (instance.mov, and in MCAP)."""
    frames_per_second: int = 4
    """Rendered frames per second: 4, 5, 10, 20, 25 or 50."""
    only_episodes: bool = False
    """Stop after scenes and instructed episodes are written, before any robot runs."""
    only_success: bool = False
    """Export only successful episodes. By default all are exported, each with its end reason."""
    rgb_codec: str = "h264"
    """Codec of RGB videos: h264, or av1 (royalty-free)."""
    mcap: bool = True
    """Also write one MCAP file with images per episode, for Foxglove."""
    depth: str = "video"
    """Depth storage in LeRobot datasets: video (lossless, 12-bit codes) or image (16-bit, mm)."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""
