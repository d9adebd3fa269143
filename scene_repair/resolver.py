"""Where a scan's side files may come from: its own folder, nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from trimesh.resolvers import Resolver


class ConfinedResolver(Resolver):
    """Reads files inside one folder (after following links), never the network.

    Attributes:
        warnings: one line per reference that was refused or missing.
    """

    def __init__(self, folder: Path):
        self.folder = folder.resolve()
        self.warnings: list[str] = []

    def get(self, key: str) -> bytes:
        """Bytes of the file that `key` names relative to the folder.

        Raises:
            FileNotFoundError: outside the folder, or missing.
        """
        name = str(key).strip()
        target = (self.folder / name).resolve()
        if "://" in name or not target.is_relative_to(self.folder):
            return self._refuse(f"reference {name!r} leaves the scan's folder; ignored")
        if not target.is_file():
            return self._refuse(f"referenced file {name!r} is missing")
        return target.read_bytes()

    def _refuse(self, message: str) -> bytes:
        if message not in self.warnings:
            self.warnings.append(message)
        raise FileNotFoundError(message)

    def write(self, name: str, data: Any) -> None:
        """Refused: a scan is only read."""
        raise PermissionError(f"a scan's folder is read-only: {name}")

    def namespaced(self, namespace: str) -> ConfinedResolver:
        """A resolver for a sub-folder, refused when it leaves the folder."""
        target = (self.folder / namespace).resolve()
        if not target.is_relative_to(self.folder):
            raise FileNotFoundError(f"folder {namespace!r} leaves the scan's folder")
        return ConfinedResolver(target)

    def keys(self) -> list[str]:
        """Names of the files that can be read."""
        files = (p for p in self.folder.rglob("*") if p.is_file())
        return [str(p.relative_to(self.folder)) for p in files]
