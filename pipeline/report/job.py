"""Write the page that shows a run."""

from dataclasses import dataclass
from pathlib import Path

from ...formats.core.atomic import write_bytes
from ..engine.work import ItemResult
from .build import build_page
from .pictures import Pictures


@dataclass(frozen=True)
class ReportJob:
    """Write the report page."""

    root: Path
    pictures: Pictures
    out: Path

    def run(self) -> ItemResult:
        """Write the page."""
        text = build_page(self.root, self.pictures)
        write_bytes(self.out, text.encode())
        return ItemResult({"bytes": len(text.encode())})
