"""Options of `vlnpe drive` and `vlnpe view`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ...formats.core.errors import InputError, check_name
from . import check_is_no_folder, check_port, must_exist
from .running import Running
from .shared import Mounting, Orientation, Printing

VELOCITY = "velocity"


@dataclass(frozen=True)
class Drive(Mounting, Running):
    """Drive a robot yourself, in physics and in real time, in a page in the browser.

    W S or the arrows up and down walk, A D or the arrows left and right turn, Q E step sideways,
    Shift walks slowly, Enter stops for good, Z takes the last seconds back, R goes back to the
    start, P pauses; a gamepad and the buttons of the page do the same. Time stands still while
    you ask for nothing. Each drive that you keep becomes a rollout with the controller `human`;
    closing the session makes the dataset of all of them, as `vlnpe collect` does. The same command
    goes on with a drive that was interrupted.

    Example: vlnpe drive runs/home --robot h1 --episodes runs/home --driver Ada --out runs/driven
    """

    scene: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="SCENE")]
    """Scene to drive in: a run folder or a repaired scene, else what `vlnpe collect --scene` takes:
    a scan, or builtin:villa and the like."""
    robot: str = "h1"
    """Robot: a name (see `vlnpe robots`), or the folder of your own robot."""
    episodes: Path | None = None
    """Episode file (.json.gz) or run folder whose instructions are to be followed. Without it you
    drive freely, and get a composed instruction afterwards."""
    split: str | None = None
    """Drive only the episodes of this split; all by default."""
    driver: str = ""
    """Your name, for the record."""
    actions: str = VELOCITY
    """What keys command: velocity, or discrete: steps of 0.25 m and turns of 15°."""
    light: str = "baked"
    """Lighting of the page and of the dataset: baked, DL5000, DL300 or CL."""
    renderer: str = "auto"
    """Renderer: embree, gl, splat, splat_depth, or auto."""
    port: int = 0
    """Port of the page on 127.0.0.1; 0 takes a free one."""
    open: bool = True
    """Open the page in the browser (default), or only print its address."""
    finish: bool = False
    """Open no page: end the drives of --out that were interrupted where they are, and make the
    dataset."""
    out: Path = Path("runs/drive")
    """Run folder of the drives and their datasets; drives of several commands may share it."""
    seed: int = 0
    """Random seed of the places where free drives start."""

    def check(self) -> None:
        """Raise InputError if a file is missing or an option is out of range."""
        must_exist(self.episodes)
        check_port(self.port)
        check_name("actions", self.actions, (VELOCITY, "discrete"))
        if self.split and self.episodes is None:
            raise InputError(f"--split {self.split} needs --episodes")


@dataclass(frozen=True)
class View(Orientation, Printing):
    """Look at a run, an evaluation, a repaired scene or a scan in the browser.

    The page answers to this machine alone, at the printed address with its token. A scan is
    repaired first.
    """

    what: tyro.conf.Positional[Path]
    """Run folder, folder of an evaluation, folder of a repaired scene, or a scan."""
    episode: tyro.conf.Positional[str] = ""
    """Episode to begin with, or the end of its name."""
    scenes: Path | None = None
    """Folder of the repaired scenes of a run or an evaluation; by default where they were."""
    out: Path | None = None
    """Folder for the scene of a scan; by default runs/view/<scan>."""
    save: Path | None = None
    """Write one self-contained HTML page of the walk or scene, and do not serve."""
    port: int = 0
    """Port of the page; 0 takes any that is free."""
    open: bool = True
    """Open the page in the browser."""

    def check(self) -> None:
        """Raise InputError if an input is missing, or an output or the port is impossible."""
        must_exist(self.what, self.scenes)
        check_is_no_folder("--save", self.save)
        check_port(self.port)
