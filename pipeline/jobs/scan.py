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
        splats: capture Gaussian splats instead of a mesh.
    """

    seed: int
    folder: Path
    kind: str = "apartment"
    scanned: bool = True
    splats: bool = False

    def run(self) -> ItemResult:
        """Generate one scan."""
        # Takes long to import: only where the work is done.
        from ...apartments import (
            building_config,
            generate_exact,
            generate_scan,
            generate_splats,
        )

        with atomic_folder(self.folder) as temporary:
            scanned = generate_splats if self.splats else generate_scan
            generate = scanned if self.scanned else generate_exact
            scan = generate(self.seed, temporary, building_config(self.kind))
            size = scan.stat().st_size
            # The scan is made by this project, so that the data made from it may be used as freely.
            (temporary / "LICENSE.scan").write_text("Apache-2.0\n")
        facts = {"kind": self.kind, "seed": self.seed, "scanned": self.scanned}
        return ItemResult({**facts, "scan": scan.name, "bytes": size})
