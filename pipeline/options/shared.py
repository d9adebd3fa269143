"""Options that several commands share; those of one command beside them are in its own module."""

from dataclasses import dataclass, fields
from typing import Annotated, Any

import tyro

from ...collectors.locomotion.state import State
from ...scene_repair.config import RepairConfig
from ...trajectory_sampler.config import SampleConfig


def settings_of[T](kind: type[T], options: Any, **others: Any) -> T:
    """Return a configuration from the options of its fields' names; `others` take precedence."""
    names = [entry.name for entry in fields(kind)]  # type: ignore[arg-type]
    named = {name: getattr(options, name) for name in names if hasattr(options, name)}
    return kind(**{**named, **others})


@dataclass(frozen=True, kw_only=True)
class Printing:
    """Output."""

    json: Annotated[bool, tyro.conf.arg(name="json")] = False
    """Print one JSON object with the result as the last line."""


@dataclass(frozen=True, kw_only=True)
class Parallel(Printing):
    """Parallel work."""

    workers: int = 0
    """Number of worker processes; 0 uses one per core, or all that a cluster has."""


@dataclass(frozen=True, kw_only=True)
class Orientation:
    """Interpretation of a scan."""

    up: str = "auto"
    """Up axis of scans: x, y, z, -x, -y, -z, or auto to detect it."""
    unit: str = "auto"
    """Length unit of scans: m, cm, mm, in, ft, its length in metres (0.142857), or auto to detect
    it."""
    exclude: tuple[str, ...] = ()
    """Parts of a scan to leave out, by name or pattern (Sky 'Tree*'). A sky or ground that dwarfs
    the building is left out by itself."""
    floor: float | None = None
    """Height [m] at which to lay a floor inside the walls of a building that has none."""
    ceiling: float | None = None
    """Height [m] at which to lay a ceiling inside the walls of a building that has none. Policies
    trained under ceilings lose their way without them."""
    allow_roof: bool = False
    """Also make levels of floors under the open sky that no stairs lead to."""

    def repair_config(self, *, collision: str, scene_id: str = "") -> RepairConfig:
        """Return the options of the repair."""
        heights = {"floor_m": self.floor, "ceiling_m": self.ceiling}
        names = {"collision": collision, "scene_id": scene_id}
        return settings_of(RepairConfig, self, **heights, **names)


@dataclass(frozen=True, kw_only=True)
class Clearance:
    """Clearance of paths."""

    free_height_m: float = SampleConfig.free_height_m
    """Free height above every path [m]. The default suits every robot; a lower value lets paths for
    low robots lead under tables, and 0 selects the height of the run's tallest robot."""


@dataclass(frozen=True, kw_only=True)
class WalkedBy(Clearance):
    """The robots that episodes are made for."""

    robot: str = ""
    """Robots that will walk the paths, comma-separated; paths keep clear for the widest one.
    Without it, --robot-radius-m decides."""


@dataclass(frozen=True, kw_only=True)
class Sensing:
    """Sight of the robots' gaits."""

    state: State = "true"
    """State that a gait sees: true, or estimated from the robot's own sensors with their noise,
    bias and delay; see docs/results/gaits.md."""


@dataclass(frozen=True, kw_only=True)
class DiscreteActions(Sensing):
    """Execution of discrete actions by the controller `speed`."""

    action_steps: int = 50
    """Duration of a discrete action of the speed controller, in physics steps of 5 ms."""
    closed_loop: bool = False
    """Run each discrete action of the speed controller until its 0.25 m or 15° is reached, instead
    of for a fixed number of steps."""


@dataclass(frozen=True, kw_only=True)
class Driving(DiscreteActions):
    """Control of robots."""

    controller: str = "auto"
    """Controllers to run: path, speed or flash, a comma-separated list (path,speed), or `all`.
    `auto` selects path, or flash for an agent without a body."""


@dataclass(frozen=True, kw_only=True)
class Mounting:
    """Pose of the robot's own camera."""

    camera_height: float | None = None
    """Height of the camera ego above the floor [m]: 1.25 with --camera-pitch 30 is the same as
    --camera rig:125cm_30deg. Defaults to the robot's own."""
    camera_pitch: float | None = None
    """Downward tilt of the camera ego [deg]. Defaults to the robot's own."""


@dataclass(frozen=True, kw_only=True)
class Drawing(Mounting):
    """Rendering of rollouts."""

    light: str = "baked"
    """Lighting: baked (as scanned), DL5000 (panel lights, day), DL300 (night), CL (a lamp on the
    robot), a comma-separated list (DL5000,CL), or `all`. Each has frames and datasets of its
    own."""
    renderer: str = "auto"
    """Renderer: embree (ray tracing on the CPU), gl (MuJoCo through EGL), splat (Gaussian splats,
    depth of the mesh), splat_depth (depth of the splats too), or auto, which selects splat in
    scenes of splats, else gl if a GPU is available, else embree."""
    semantic: bool = False
    """Also render semantic segmentation: semantic.mov (and in MCAP), and class names in
    labels.json."""
    instance: bool = False
    """Also render instance segmentation: instance.mov (and in MCAP), and object names in
    labels.json."""
    rgb_codec: str = "h264"
    """Codec of RGB videos: h264, or av1 (royalty-free)."""


@dataclass(frozen=True, kw_only=True)
class Wording:
    """Writing of instructions."""

    writer: str = "composer"
    """Writer of the instructions: composer (offline), llm (any OpenAI-compatible server, see
    docs/guides/instructions.md), or local (a GGUF model on disk)."""
    style: str = "mixed"
    """Styles of the instructions: natural, terse, rich, a comma-separated list (terse,rich), or
    mixed, which alternates between all."""
    count: int = 3
    """Number of instructions per path and language."""
    language: str = "en"
    """Languages of the instructions: en, zh, hi, or a comma-separated list (en,zh). Languages other
    than en need a language model."""
    replace: bool = False
    """Also rewrite the instructions that a file already has."""
    vision: bool = False
    """In scenes without labels, let a vision-language model name the things and rooms that the
    camera sees (the same environment variables as --writer llm)."""
    max_tokens: int = 0
    """Stop querying the language model after this many tokens; 0 means no limit."""
    max_cost: float = 0.0
    """Stop querying after this cost, at the prices set in the environment; 0 means no limit."""


@dataclass(frozen=True, kw_only=True)
class DatasetFormat:
    """Contents of datasets."""

    per_instruction: bool = False
    """Write one episode per instruction, in LeRobot datasets with the same frames. By default a
    path is one episode that carries all its instructions."""
    only_success: bool = False
    """Export only successful episodes. By default all are exported, each with its end reason."""
    depth: str = "video"
    """Depth storage in LeRobot datasets: video (lossless, 12-bit codes) or image (16-bit, mm)."""
    language_columns: bool = False
    """Add LeRobot's language column: all texts of a path, and the parts of its instruction with
    their times. LeRobot reads it since 0.6."""
