"""Options of `vlnpe robots`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from .shared import Printing


@dataclass(frozen=True)
class Robots(Printing):
    """List the robots: mass, height, camera, command limits, controllers and gait evaluation.

    Robots given by name are described in full. `--view h1` writes a turntable image and a walking
    film strip; `--export aliengo` writes a robot as a folder, as a template for your own;
    `--card h1` writes its gait and the card that another program needs to run it;
    `--import robot.urdf` writes a URDF as one and lists the values that you must add
    (docs/reference/robots.md).
    """

    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """Robots to describe: names, or folders of your own robots, which are also validated."""
    view: str | None = None
    """Write images of this robot to --out."""
    export: str | None = None
    """Write this robot as a folder to --out."""
    card: str | None = None
    """Write this robot's gait, its card for deployment and a recorded walk to --out."""
    import_: Annotated[Path | None, tyro.conf.arg(name="import")] = None
    """Write this URDF as a robot folder to --out."""
    out: Path | None = None
    """Output folder of the images for --view (default: the current folder), or of the robot or
    card for --export, --card and --import."""
