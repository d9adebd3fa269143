"""Generate a building, and scan it virtually."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ...engine.work import ItemResult
from .outputs import write_scan


@dataclass(frozen=True)
class ScanJob:
    """Write the scan of one generated building, or its exact geometry in the place of a scan.

    Attributes:
        kind: key of `apartments.BUILDINGS`.
        scanned: scan it virtually.
    """

    seed: int
    folder: Path
    kind: str = "apartment"
    scanned: bool = True

    def run(self) -> ItemResult:
        """Generate one scan."""
        # Takes long to import: only where the work is done.
        from ....apartments import building_config, generate_exact, generate_scan

        generate = generate_scan if self.scanned else generate_exact
        write = partial(generate, self.seed, config=building_config(self.kind, self.seed))
        facts = {"kind": self.kind, "seed": self.seed, "scanned": self.scanned}
        return write_scan(self.folder, write, facts)
