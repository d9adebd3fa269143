"""LeRobot v3.0 datasets, written without lerobot or torch; LeRobot 0.6.1 reads them as its own.

Two steps: `write_episode_unit` makes each episode an atomic folder, possibly in parallel;
`assemble_dataset` joins the folders by copying streams. All readers raise `FileFormatError` for a
unit or dataset that is missing, incomplete, corrupt or of another version.
"""

from .assemble import DatasetSummary, assemble_dataset
from .layout import FileLimits
from .units.unit import EpisodeUnit, read_episode_unit, write_episode_unit

__all__ = [
    "DatasetSummary",
    "EpisodeUnit",
    "FileLimits",
    "assemble_dataset",
    "read_episode_unit",
    "write_episode_unit",
]
