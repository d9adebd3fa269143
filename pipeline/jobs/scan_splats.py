"""Generate a building, and capture it as Gaussian splats."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...formats.core.atomic import atomic_folder
from ..engine.work import ItemResult


@dataclass(frozen=True)
class SplatScanJob:
    """Write the splat capture of one generated building.

    Attributes:
        seed: of the building.
        folder: output.
        kind: key of `apartments.BUILDINGS`.
    """

    seed: int
    folder: Path
    kind: str = "apartment"

    def run(self) -> ItemResult:
        """Generate one capture."""
        # Takes long to import: only where the work is done.
        from ...apartments import building_config
        from ...apartments.generate_splats import generate_splats

        with atomic_folder(self.folder) as temporary:
            scan = generate_splats(self.seed, temporary, building_config(self.kind))
            size = scan.stat().st_size
            # The scan is made by this project, so that the data made from it may be used as freely.
            (temporary / "LICENSE.scan").write_text("Apache-2.0\n")
        facts = {"kind": self.kind, "seed": self.seed, "scanned": True}
        return ItemResult({**facts, "scan": scan.name, "bytes": size})
