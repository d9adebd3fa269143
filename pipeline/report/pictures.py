"""Which pictures a report shows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

STAGE = "pictures"


@dataclass(frozen=True)
class Pictures:
    """Pictures that were made.

    Attributes:
        maps: by `<scene>/<level>`; a JSON file beside each says where it lies.
        strips: by robot.
        clips: by `<robot>/<controller>/<episode>`; the last frame lies beside each as `.jpg`.
    """

    maps: dict[str, Path]
    strips: dict[str, Path]
    clips: dict[str, Path]
