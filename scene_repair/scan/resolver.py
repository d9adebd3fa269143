"""Resolve a scan's references, confined to its own folder."""

import io
from pathlib import Path
from typing import Any

from trimesh.resolvers import Resolver

from ...formats.core.errors import FileFormatError, brief
from ...formats.untrusted.files import read_input
from .images import PixelBudget, open_image

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".gif", ".webp", ".tga")
MAX_BYTES, MAX_TOTAL_BYTES = 2 << 30, 6 << 30


class ConfinedResolver(Resolver):
    """Reads files inside one folder (after following links), never the network.

    Attributes:
        warnings: one line per reference that was refused or missing, and per damaged picture.
        refused: the last of those that leaves the folder, empty if none did.
    """

    def __init__(self, folder: Path):
        self.folder = folder.resolve()
        self.warnings: list[str] = []
        self.refused = ""
        self._known: dict[Path, bytes] = {}
        self._budget = PixelBudget()

    def get(self, key: str) -> bytes:
        """Return the bytes of the file `key`, relative to the folder; each is read once.

        Pictures too large to be decoded as they are come scaled down. A FileNotFoundError is raised
        if the file is outside the folder, missing, no plain file, or a damaged picture.
        """
        name = str(key).strip()
        try:
            target = (self.folder / name).resolve()
        except (OSError, ValueError, RuntimeError) as error:
            return self._refuse(f"reference {brief(name)} is not a file name: {error}")
        if "://" in name or not target.is_relative_to(self.folder):
            self.refused = f"reference {brief(name)} leads out of the scan's folder"
            return self._refuse(f"{self.refused}; ignored")
        if target in self._known:
            return self._known[target]
        if not target.exists():
            return self._refuse(f"referenced file {brief(name)} is missing")
        left = MAX_TOTAL_BYTES - sum(map(len, self._known.values()))
        try:
            data = read_input(target, root=self.folder, max_bytes=min(MAX_BYTES, left))
        except FileFormatError as error:
            return self._refuse(f"referenced file {brief(name)} {error.reason}")
        if target.suffix.lower() in PICTURES:
            data = self._within_limits(data, name)
        self._known[target] = data
        return data

    def _within_limits(self, data: bytes, name: str) -> bytes:
        messages: list[str] = []
        image = open_image(data, name, messages, self._budget)
        if not messages:
            return data
        if image is None:
            return self._refuse(messages[-1])
        self.warnings += messages
        small = io.BytesIO()
        image.save(small, "JPEG" if image.format == "JPEG" else "PNG", quality=92)
        return small.getvalue()

    def _refuse(self, message: str) -> bytes:
        if message not in self.warnings:
            self.warnings.append(message)
        raise FileNotFoundError(message)

    def write(self, name: str, data: Any) -> None:
        """Refuse to write: scans are read-only."""
        raise PermissionError(f"a scan's folder is read-only: {name}")

    def namespaced(self, namespace: str) -> Resolver:
        """Refuse: no supported file type asks for sub-folders."""
        raise PermissionError(f"sub-folders are not supported: {namespace}")

    def keys(self) -> list[str]:
        """Return the names of the files that can be read."""
        files = (p for p in self.folder.rglob("*") if p.is_file())
        return [str(p.relative_to(self.folder)) for p in files]
