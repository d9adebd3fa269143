"""The item of work that writes the report page."""

from dataclasses import dataclass
from pathlib import Path

from ...formats.core.atomic import write_bytes
from ..engine.work import ItemResult
from .pictures import Pictures


@dataclass(frozen=True)
class ReportJob:
    """Write the report page."""

    root: Path
    pictures: Pictures
    out: Path

    def run(self) -> ItemResult:
        """Write the page."""
        # matplotlib takes a second to import: only where the work is done.
        from .build import build_page

        page = build_page(self.root, self.pictures).encode()
        write_bytes(self.out, page)
        return ItemResult({"bytes": len(page)})
