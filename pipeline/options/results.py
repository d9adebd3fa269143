"""Options of the commands for results: `verify`, `report`, `push`, `doctor`."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from .shared import Printing


@dataclass(frozen=True)
class Verify(Printing):
    """Verify a run's outputs: files open, counts and checksums match, floors have no leaks.

    Exit codes: 0 sound, 1 something is wrong, 2 no run, or one in use, 3 sound as far as it goes,
    but its command has not ended.
    """

    run: tyro.conf.Positional[Path]
    """Run folder, or the folder of a single repaired scene."""


@dataclass(frozen=True)
class Report(Printing):
    """Regenerate the report page of a run."""

    run: tyro.conf.Positional[Path]
    """Run folder."""
    open: bool = False
    """Open the page in the browser."""


@dataclass(frozen=True)
class Doctor(Printing):
    """Check what this machine supports, and print the command that installs what is missing."""

    out: Path = Path("runs")
    """Folder that runs would be written to."""


@dataclass(frozen=True)
class Push(Printing):
    """Publish a LeRobot dataset or environment on the Hugging Face Hub under an immutable tag.

    Without --yes, show what would be uploaded; nothing is uploaded and the network is not used.
    """

    dataset: tyro.conf.Positional[Path]
    """Dataset folder, e.g. runs/<name>/lerobot/<dataset>."""
    repo: str
    """Target repository on the Hub: user/name."""
    env: str | None = None
    """Publish an environment for LeRobot instead of the dataset: the scenes and episodes of this
    split of the dataset's run, with its robot and camera."""
    tag: str | None = None
    """Tag of the release; by default derived from the digest of the content."""
    private: bool = False
    """Make the repository private if it is new."""
    licence_ok: bool = False
    """Publish even if a scene's licence forbids it or is unknown; confirms that you have
    permission."""
    yes: bool = False
    """Upload the dataset."""
