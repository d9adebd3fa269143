"""Options of `view`."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from .shared import Orientation, Printing


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
