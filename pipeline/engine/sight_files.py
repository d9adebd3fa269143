"""Where lies what is seen along paths and named in scenes: in a run, or beside a single output."""

from dataclasses import dataclass
from pathlib import Path

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
        return self.folder / f"{scene}{_named()}"

    def all_seen(self) -> list[Path]:
        """Return every record of what is seen that is there."""
        return sorted(self.folder.glob(f"*{_SEEN}"))

    def all_named(self) -> list[Path]:
        """Return every record of what is named that is there."""
        return sorted(self.folder.glob(f"*{_named()}"))


def _named() -> str:
    # Only now, because it imports numerical libraries, which `--help` must not wait for.
    from ...instruction_gen.facts.named import SUFFIX

    return SUFFIX
