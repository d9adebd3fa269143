"""Options of `vlnpe collect`."""

from dataclasses import dataclass
from pathlib import Path

from ...trajectory_sampler.config import SampleConfig
from .episodes import Sampling
from .running import Running
from .shared import DatasetFormat, Drawing, Driving, Orientation, Wording


@dataclass(frozen=True)
class Collect(Sampling, Driving, Drawing, Wording, DatasetFormat, Orientation, Running):
    """Collect a dataset: repair, sample, instruct, replay, render, export, report.

    All outputs go into one run folder. Finished work is reused, and changing an option redoes only
    the work that depends on it.

    Example: vlnpe collect --robot aliengo --scene scan.glb --episodes 8 --out runs/scan
    """

    robot: str = "aliengo"
    """Robots to run: a name (see `vlnpe robots`), the folder of your own robot, a comma-separated
    list (h1,g1), or `all` for every built-in robot with a body. All robots get the same episodes,
    sampled with clearance for the widest one."""
    scene: str = "builtin"
    """Scan to collect in (GLB, glTF, OBJ, PLY, STL, USD, a point cloud or Gaussian splats; see
    docs/guides/scans.md and docs/guides/splats.md), or `builtin` for a generated apartment;
    builtin:villa, builtin:house and builtin:office are larger buildings, builtin:villa*10 is ten of
    them, of consecutive seeds, and builtin-exact:villa*10 the same ten without the virtual scan.
    Built-in scenes can be listed, comma-separated. With a preset, a kind without a number stands
    for as many buildings as the preset needs."""
    scenes: Path | None = None
    """Folder of scans. All of them are used, or only those named by the scene ids of the VLN-CE
    file in --episodes."""
    episodes: str = "6"
    """Number of paths to sample per scene, a preset (gru_vln10, lab_3dgs), a VLN-CE episode file
    (.json.gz), or several of them, comma-separated, one per split."""
    robot_radius_m: float = SampleConfig.robot_radius_m
    """Clearance of sampled paths [m]; a wider robot in the run raises it. Set it to that of the
    widest robot that may join the run later, so that the paths stay the same (0.38 for the
    jetbot, which is five times as large as the toy)."""
    stair_rules: str = "step"
    """Rules by which episodes of a VLN-CE file are dropped, comma-separated: step, geometric, text;
    see `vlnpe filter`."""
    keep_climbable: bool = False
    """Keep the episodes of a VLN-CE file over one staircase that the robots can climb, which the
    stair rules drop."""
    goal_beyond_start: bool = False
    """Accept VLN-CE paths whose goal is moved farther out of collision than their start, instead of
    rejecting them."""
    camera: str = "ego"
    """Cameras to render: ego (the robot's own), chase, top, a rig, or a comma-separated list
    (ego,chase), each with an optional size [px] and horizontal field of view [deg]
    (ego:640x480:79, ego:64x64, ego:79). A rig has a height above the standing floor and a downward
    pitch (rig:125cm_30deg) and sways with the body unless it is level (rig:125cm_30deg:level); it
    does not see the robot. Presets: rig:n1 (125 cm at 0, 30 and 45 deg, 60 cm at 15 and 30 deg),
    rig:navdp (25 cm and 50 cm at 0 deg, 75 cm at 15 deg, 100 cm and 125 cm at 30 deg). Each camera
    becomes a separate dataset."""
    collision: Path | None = None
    """Mesh, USD stage or InteriorGS' occupancy.png to use as the surface of Gaussian splats."""
    allow_unsound: bool = False
    """Also collect in scenes whose repair is not sound, instead of quarantining them. The report
    and the dataset card list them."""
    out: Path | None = None
    """Run folder; defaults to runs/<scene>, e.g. runs/apartment-0 of the built-in scene, or with
    --scenes to runs/<its name>."""
    seed: int = 0
    """Random seed of the built-in scene (the first of several), the sampling and every other random
    choice."""
    frames_per_second: int = 4
    """Rendered frames per second: 4, 5, 10, 20, 25 or 50."""
    only_episodes: bool = False
    """Stop after scenes and instructed episodes are written, before any robot runs."""
    mcap: bool = True
    """Write one MCAP file with images per episode, for Foxglove (default), or not."""
    also: str = ""
    """Layouts of trainers to write as well, comma-separated: navila, streamvln, internvla-n1,
    navdp, uni-navid, sharegpt; see `vlnpe convert`."""
