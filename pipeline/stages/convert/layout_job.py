"""Write a subset in the layout of a trainer."""

from dataclasses import dataclass
from pathlib import Path

from ....formats.trainers.registry import LAYOUTS
from ....formats.trainers.subset import Subset, write_subset
from ....formats.trainers.walks import WalkSource
from ...engine.work import ItemResult


@dataclass(frozen=True)
class LayoutJob:
    """Write one subset, or one scene of it.

    Attributes:
        layout: Key of `LAYOUTS`.
        out: Its folder, replaced as a whole.
    """

    layout: str
    sources: tuple[WalkSource, ...]
    subset: Subset
    out: Path

    def run(self) -> ItemResult:
        """Write the subset."""
        written = write_subset(LAYOUTS[self.layout], self.out, self.sources, self.subset)
        return ItemResult(
            {
                "subset": self.subset.name,
                "episodes": sum(frames is not None for frames in written.frames),
                "records": written.records,
                "left_out": dict(self.subset.left_out),
                "before": dict(written.before),
                "after": dict(written.after),
            }
        )
