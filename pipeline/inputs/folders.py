"""Folders that a user names: of scans, of repaired scenes, and for results."""

from pathlib import Path

from ...formats.core.checkout import program
from ...formats.core.errors import InputError
from ...formats.scene.bundle import INDEX_NAME
from ...scene_repair.scan.files import SUFFIXES, USD_SUFFIXES
from ..engine.run_folder import file_names


def find_scans(folder: Path) -> dict[str, Path]:
    """Return every scan in `folder` and below, by scene id.

    A sub-folder that holds a file of its own name, as Matterport3D's `<id>/<id>.glb`, is one scan:
    what else lies there are its parts. Elsewhere each mesh is a scan, and each USD stage at the
    top; deeper ones are what stages refer to.
    """
    if not folder.is_dir():
        raise InputError(f"--scenes {folder}: no such folder")
    result: dict[str, Path] = {}
    for path in _scans(folder, top=True, above=()):
        if path.stem in result:
            raise InputError(f"--scenes {folder}: two scans are named {path.stem}")
        result[path.stem] = path
    return dict(zip(file_names(list(result)), result.values(), strict=True))


def _scans(folder: Path, *, top: bool, above: tuple[Path, ...]) -> list[Path]:
    """Return the scans in and below a folder; links are followed, but not in a circle."""
    above = (*above, folder.resolve())
    inside = sorted(folder.iterdir())
    files = [p for p in inside if p.is_file() and p.suffix.lower() in SUFFIXES]
    named = [p for p in files if p.stem == folder.name]
    if named and not top:
        return [min(named, key=lambda p: SUFFIXES.index(p.suffix.lower()))]
    scans = [p for p in files if top or p.suffix.lower() not in USD_SUFFIXES]
    for sub in inside:
        if sub.is_dir() and not sub.name.startswith(".") and sub.resolve() not in above:
            scans += _scans(sub, top=False, above=above)
    return scans


def scenes_root(folder: Path) -> Path:
    """Return the folder that holds the scenes of `folder`, which may be a repaired scene itself."""
    folder = folder.resolve()
    return folder.parent if (folder / INDEX_NAME).is_file() else folder


def scenes_in(folder: Path) -> dict[str, Path]:
    """Return the folder of every repaired scene in `folder`, by scene id.

    A repaired scene contains itself alone.
    """
    if (folder / INDEX_NAME).is_file():
        return {folder.name: folder}
    indices = sorted(folder.glob(f"*/{INDEX_NAME}"))
    result = {p.parent.name: p.parent for p in indices if not p.parent.name.startswith(".")}
    if not result:
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder")
        raise InputError(f"{folder}: contains no repaired scene; run `{program()} repair` first")
    return result


def refuse_to_replace(folder: Path, own: frozenset[str]) -> None:
    """Refuse an output folder that contains anything other than an earlier result.

    Results replace the whole folder, so unrelated files in it would be lost.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; --out must be a folder")
    foreign = sorted({p.name for p in folder.iterdir()} - own) if folder.is_dir() else []
    if foreign:
        raise InputError(
            f"{folder}: not empty and not an earlier result (it contains {foreign[0]}); "
            "choose another --out"
        )
