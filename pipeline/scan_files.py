"""Scans in a folder of scans."""

from __future__ import annotations

from pathlib import Path

from ..formats.core.errors import InputError
from ..scene_repair.scan.files import SUFFIXES, USD_SUFFIXES
from .engine.run_folder import safe_name


def find_scans(folder: Path) -> dict[str, Path]:
    """Every scan in `folder` and below, by scene id.

    A sub-folder that holds a file of its own name, as Matterport3D's `<id>/<id>.glb`, is one scan:
    what else lies there are its parts. Elsewhere each mesh is a scan, and each USD stage at the
    top; deeper ones are what stages refer to.

    Raises:
        InputError: no such folder, or two scans share an id.
    """
    if not folder.is_dir():
        raise InputError(f"SCENES={folder}: no such folder")
    found: dict[str, Path] = {}
    for path in _scans(folder, top=True):
        scene_id = safe_name(path.stem)
        if scene_id in found:
            raise InputError(f"SCENES={folder}: two scans are named {path.stem}")
        found[scene_id] = path
    return found


def _scans(folder: Path, top: bool) -> list[Path]:
    inside = sorted(folder.iterdir())
    files = [p for p in inside if p.is_file() and p.suffix.lower() in SUFFIXES]
    named = [p for p in files if p.stem == folder.name]
    if named and not top:
        return [min(named, key=lambda p: SUFFIXES.index(p.suffix.lower()))]
    scans = [p for p in files if top or p.suffix.lower() not in USD_SUFFIXES]
    for sub in inside:
        if sub.is_dir() and not sub.name.startswith("."):
            scans += _scans(sub, top=False)
    return scans
