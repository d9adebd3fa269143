"""Generate a building, and capture it as Gaussian splats."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ...engine.work import ItemResult
from .outputs import write_scan


@dataclass(frozen=True)
class SplatScanJob:
    """Write the splat capture of one generated building.

    Attributes:
        kind: key of `apartments.BUILDINGS`.
    """

    seed: int
    folder: Path
    kind: str = "apartment"

    def run(self) -> ItemResult:
        """Generate one capture."""
        # Takes long to import: only where the work is done.
        from ....apartments import building_config
        from ....apartments.generate_splats import generate_splats

        write = partial(generate_splats, self.seed, config=building_config(self.kind, self.seed))
        facts = {"kind": self.kind, "seed": self.seed, "scanned": True}
        return write_scan(self.folder, write, facts)
