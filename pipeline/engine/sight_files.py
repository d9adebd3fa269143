"""Where lies what is seen along paths and named in scenes: in a run, or beside a single output."""

from dataclasses import dataclass
from pathlib import Path

from ...instruction_gen.facts.named import SUFFIX as NAMED

_SEEN = ".seen.json"


@dataclass(frozen=True)
class SightFiles:
    """The records in a folder."""

    folder: Path

    def seen(self, share: str) -> Path:
        """Return what the robot's camera sees along the paths of a scene, or a split of it."""
        return self.folder / f"{share}{_SEEN}"

    def named(self, scene: str) -> Path:
        """Return what a vision-language model names in a scene without labels."""
        return self.folder / f"{scene}{NAMED}"

    def all_seen(self) -> list[Path]:
        """Return every record of what is seen that is there."""
        return sorted(self.folder.glob(f"*{_SEEN}"))

    def all_named(self) -> list[Path]:
        """Return every record of what is named that is there."""
        return sorted(self.folder.glob(f"*{NAMED}"))
