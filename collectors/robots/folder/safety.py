"""Checks that a user's robot folder reads no file outside itself and cannot exhaust memory.

They run before MuJoCo reads a file and cover symbolic links, the paths in all MJCF files, the
number of elements that `<replicate>` and the like create, and numbers that are not finite.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from ....formats.core.errors import FileFormatError

MAX_ELEMENTS = 20_000
MAX_PIXELS = 8192
MAX_MODEL_BYTES = 64 * 1024**2

_DIRECTORIES = ("meshdir", "texturedir", "assetdir")
_PIXELS = ("width", "height", "nrow", "ncol")
_FREE_TEXT = ("name", "model", "info", "user")


def folder_files(folder: Path) -> list[Path]:
    """Return all files of a robot except hidden ones, sorted.

    Raises:
        FileFormatError: a symbolic link leads out of the folder or to a folder, or a file is not a
            regular file.
    """
    inside = folder.resolve()
    files = []
    for parent, names, others in os.walk(folder):
        names[:] = [name for name in names if not name.startswith(".")]
        for name in (*names, *others):
            path = Path(parent, name)
            if name.startswith("."):
                continue
            if path.is_symlink() and not path.resolve().is_relative_to(inside):
                raise FileFormatError(
                    path, "a symbolic link that leads out of the robot's folder; valid: files in it"
                )
            if path.is_symlink() and path.is_dir():
                raise FileFormatError(path, "a symbolic link to a folder; valid: folders and files")
            if name in others:
                if not path.is_file():
                    raise FileFormatError(path, "neither a file nor a folder; remove it")
                files.append(path)
    return sorted(files)


def check_model(path: Path) -> None:
    """Check an MJCF file and all files that it includes.

    Raises:
        FileFormatError: a path leads out of the folder, or the model is too large.
    """
    count = _Checker(path.parent).count(path, path.name)
    if count > MAX_ELEMENTS:
        raise FileFormatError(
            path, f"creates {count:,} elements, copies included; valid: up to {MAX_ELEMENTS:,}"
        )


class _Checker:
    """Counts the elements of a model and of the files that it includes or attaches."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        self.open: list[Path] = []

    def count(self, path: Path, reference: str) -> int:
        """Return the number of elements that a file creates; `reference` is the path as written."""
        if path.resolve() in self.open:
            raise FileFormatError(path, f"{reference!r} includes itself")
        root = _parsed(path)
        places = {self.folder, path.parent.resolve()}
        for element in root.iter("compiler"):
            for key in _DIRECTORIES:
                if key in element.attrib:
                    self._confined(path, {self.folder}, element.tag, key, element.attrib[key])
                    places.add(self.folder / element.attrib[key])
        self.open.append(path.resolve())
        try:
            return self._count(path, root, places)
        finally:
            self.open.pop()

    def _count(self, path: Path, element: ElementTree.Element, places: set[Path]) -> int:
        total = 1
        for key, value in element.attrib.items():
            self._check_number(path, element, key, value)
            if key.startswith("file"):
                targets = self._confined(path, places, element.tag, key, value)
                if element.tag in ("include", "model"):
                    total += sum(self.count(target, value) for target in targets)
        children = sum(self._count(path, child, places) for child in element)
        return total + max(children, 1) * _copies(element)

    def _confined(
        self, path: Path, places: set[Path], tag: str, key: str, value: str
    ) -> list[Path]:
        """Return the files that a reference may mean, whichever folder MuJoCo joins it to.

        Raises:
            FileFormatError: one of them lies outside the folder or is hidden.
        """
        what = f"<{tag} {key}={value!r}>"
        if "\\" in value or ":" in value:
            raise FileFormatError(path, f"{what} has a backslash or colon; valid: relative with /")
        for place in places:
            if not (place / value).resolve().is_relative_to(self.folder):
                raise FileFormatError(
                    path, f"{what} leads out of the robot's folder; valid: files in it"
                )
        if any(part.startswith(".") and part not in (".", "..") for part in Path(value).parts):
            raise FileFormatError(path, f"{what} is hidden; valid: files that are not hidden")
        return sorted({t for place in places if (t := (place / value).resolve()).is_file()})

    def _check_number(self, path: Path, element: ElementTree.Element, key: str, value: str) -> None:
        what = f"<{element.tag} {key}={value[:60]!r}>"
        if key not in _FREE_TEXT and not all(map(math.isfinite, _numbers(value))):
            raise FileFormatError(path, f"{what} contains numbers that are not finite")
        sized = element.tag in ("texture", "hfield") and key in _PIXELS
        if sized and any(number > MAX_PIXELS for number in _numbers(value)):
            raise FileFormatError(path, f"{what} is too large; valid: up to {MAX_PIXELS} pixels")
        if element.tag == "size":
            raise FileFormatError(
                path, f"{what} is not allowed; MuJoCo computes sizes itself, so remove <size>"
            )


def _parsed(path: Path) -> ElementTree.Element:
    """Return the root of an XML file; document types are refused, as parsers differ on them."""
    if path.stat().st_size > MAX_MODEL_BYTES:
        raise FileFormatError(path, f"too large; valid: up to {MAX_MODEL_BYTES // 1024**2} MiB")
    content = path.read_bytes()
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise FileFormatError(path, "contains a document type or entities; valid: plain MJCF")
    try:
        content.decode("utf-8")
        return ElementTree.fromstring(content, ElementTree.XMLParser(encoding="utf-8"))
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise FileFormatError(path, f"not valid XML: {error}") from error


def _copies(element: ElementTree.Element) -> int:
    """Return how many copies of its content an element creates."""
    if element.tag not in ("replicate", "composite", "flexcomp"):
        return 1
    counts = [max(int(n), 1) for n in _numbers(element.get("count", "1"))]
    return math.prod(counts) if counts else 1


def _numbers(value: str) -> Iterator[float]:
    """Yield the numbers of an attribute that contains only numbers."""
    words = value.replace(",", " ").split()
    try:
        yield from [float(word) for word in words]
    except ValueError:
        return
