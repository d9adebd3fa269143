"""Generate a building, and scan it virtually."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...formats.core.atomic import atomic_folder
from ..engine.work import ItemResult


@dataclass(frozen=True)
class ScanJob:
    """Write the scan of one generated building, or its exact geometry in the place of a scan.

    Attributes:
        seed: of the building.
        folder: output.
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
        from ...apartments import building_config, generate_exact, generate_scan

        with atomic_folder(self.folder) as temporary:
            generate = generate_scan if self.scanned else generate_exact
            scan = generate(self.seed, temporary, building_config(self.kind))
            size = scan.stat().st_size
            # The scan is made by this project, so that the data made from it may be used as freely.
            (temporary / "LICENSE.scan").write_text("Apache-2.0\n")
        facts = {"kind": self.kind, "seed": self.seed, "scanned": self.scanned}
        return ItemResult({**facts, "scan": scan.name, "bytes": size})
