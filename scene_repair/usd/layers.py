"""Check every layer that a USD file depends on before the stage is composed."""

import posixpath
import re
from collections import deque
from pathlib import Path, PurePosixPath

from pxr import Sdf

from ...formats.core.errors import FileFormatError
from ...formats.untrusted.files import read_start
from ..scan.files import USD_SUFFIXES
from .package import check_package

MAX_LAYERS = 20_000
SIGNATURES = {b"#usda": ".usda", b"#usd ": ".usda", b"PXR-U": ".usdc", b"PK\x03\x04": ".usdz"}


def check_layers(root: Path) -> list[str]:
    """Open each layer that `root` depends on by itself; return warnings of files that are missing.

    Raises:
        FileFormatError: a layer is damaged, or refers to something outside the folder of `root`.
    """
    folder = root.parent.resolve()
    warnings: list[str] = []
    waiting, seen = deque([root.resolve()]), {root.resolve()}
    while waiting:
        path = waiting.popleft()
        check_signature(path)
        if path.suffix.lower() == ".usdz":
            _check_inside(path)
            continue
        for reference in _references(path, str(path)):
            target = confined(folder, path, reference)
            if target is None:
                line = f"{path.name}: referenced layer {reference!r} is missing"
                if line not in warnings:
                    warnings.append(line)
            elif target not in seen:
                seen.add(target)
                waiting.append(target)
        if len(seen) > MAX_LAYERS:
            raise FileFormatError(root, f"refers to more than {MAX_LAYERS:,} layers")
    return warnings


def _references(path: Path, identifier: str) -> list[str]:
    """Return the asset paths that composing the layer `identifier` in `path` would open."""
    try:
        layer = Sdf.Layer.FindOrOpen(identifier)
    # USD raises many types of error on damaged bytes; the file is at fault in each case.
    except Exception as error:
        raise FileFormatError(path, f"cannot be read as USD: {brief(error)}") from error
    if layer is None:
        raise FileFormatError(path, "cannot be read as USD")
    _refuse_clips(path, layer)
    paths = {*layer.GetCompositionAssetDependencies(), *layer.GetExternalAssetDependencies()}
    return sorted(paths)


def _check_inside(path: Path) -> None:
    """Check every layer of a package; references must point to other members."""
    members = check_package(path)
    if PurePosixPath(members[0]).suffix.lower() not in USD_SUFFIXES[:3]:
        raise FileFormatError(path, f"its first member {members[0]!r} is not a USD layer")
    for member in members:
        suffix = PurePosixPath(member).suffix.lower()
        if suffix == ".usdz":
            raise FileFormatError(path, f"member {member!r} is a package itself; unpack it")
        if suffix not in USD_SUFFIXES:
            continue
        for reference in _references(path, f"{path}[{member}]"):
            plain = posixpath.normpath(posixpath.join(posixpath.dirname(member), reference))
            if plain not in members:
                raise FileFormatError(
                    path,
                    f"{member}: reference {reference!r} leads out of the package or is missing",
                )


def check_signature(path: Path) -> None:
    """Raise FileFormatError if a layer is no USD file, or of another kind than its name says."""
    suffix = path.suffix.lower()
    start = read_start(path, 5)
    kind = next((k for s, k in SIGNATURES.items() if start.startswith(s)), None)
    if kind is None or suffix not in (".usd", kind):
        raise FileFormatError(path, f"is not a {suffix[1:]} file: it starts with {start!r}")


def _refuse_clips(path: Path, layer: Sdf.Layer) -> None:
    """Refuse value clips, which open further files while values are read."""
    paths: list[str] = []

    def visit(at: Sdf.Path) -> None:
        if at.IsPrimPath() or at.IsPrimVariantSelectionPath():
            spec = layer.GetPrimAtPath(at)
            if spec is not None and spec.HasInfo("clips"):
                paths.append(str(at))

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    if paths:
        raise FileFormatError(path, f"{paths[0]}: value clips are not supported; bake them")


def confined(folder: Path, layer: Path, reference: str) -> Path | None:
    """Return the file that `reference` in `layer` points to; None if it is missing.

    A FileFormatError is raised if it lies outside `folder`, or cannot be resolved before composing.
    """
    if reference.startswith("`"):
        raise FileFormatError(
            layer, f"reference {reference!r} is an expression; valid: plain file names"
        )
    if "[" in reference or "]" in reference:
        raise FileFormatError(
            layer, f"reference {reference!r} into a package; refer to the .usdz itself"
        )
    name = reference.split(":SDF_FORMAT_ARGS:")[0]
    if "\x00" in name:
        raise FileFormatError(layer, f"reference {name!r} is not a file name")
    windows = re.match(r"[A-Za-z]:", name) or "\\" in name
    if "://" in name or windows or Path(name).is_absolute():
        raise FileFormatError(layer, f"reference {name!r} leads out of the scan's folder")
    try:
        target = (layer.parent / name).resolve()
    except (OSError, RuntimeError):  # a link to itself, or a name of thousands of letters
        return None
    if not target.is_relative_to(folder):
        raise FileFormatError(layer, f"reference {name!r} leads out of the scan's folder")
    if not target.is_file():
        return None
    if target.suffix.lower() not in USD_SUFFIXES:
        raise FileFormatError(
            layer, f"reference {name!r} has an unknown file type; valid: {', '.join(USD_SUFFIXES)}"
        )
    return target


def brief(error: Exception) -> str:
    """Return an error's message on one line, without the location in USD's source."""
    try:
        text = " ".join(str(error).split())
    except UnicodeDecodeError:
        # USD quotes the file's bytes, whatever they are.
        return type(error).__name__
    text = re.sub(r"Error in '[^']*' at line \d+ in file \S+ : ", "", text).strip(" '")
    return text[:200] or type(error).__name__
