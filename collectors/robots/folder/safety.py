"""Checks that a user's robot folder reads no file outside itself and cannot exhaust memory.

They run before MuJoCo reads a file and cover symbolic links, the paths in all MJCF files, the
number of elements that `<replicate>` and the like create, and numbers that are not finite.
"""

import math
import os
import struct
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from ....formats.core.errors import FileFormatError, brief
from ....formats.untrusted.files import check_input, open_input, read_input
from ....formats.untrusted.limits import limits

MAX_ELEMENTS = 20_000
MAX_PIXELS = 8192
MAX_MODEL_BYTES = 64 * 1024**2
MAX_NESTING = 100

_DIRECTORIES = ("meshdir", "texturedir", "assetdir")
_PIXELS = ("width", "height", "nrow", "ncol")
_FREE_TEXT = ("name", "model", "info", "user")


def folder_files(folder: Path) -> list[Path]:
    """Return all files of a robot except hidden ones, sorted.

    Raises:
        FileFormatError: a symbolic link leads out of the folder or to a folder, a file is not a
            regular file or too large, or there are too many.
    """
    inside, caps = folder.resolve(), limits()
    files = []
    for parent, names, others in os.walk(folder):
        names[:] = [name for name in names if not name.startswith(".")]
        for name in (*names, *others):
            path = Path(parent, name)
            if name.startswith("."):
                continue
            if path.is_symlink() and not _target(path).is_relative_to(inside):
                raise FileFormatError(
                    path, "a symbolic link that leads out of the robot's folder; valid: files in it"
                )
            if path.is_symlink() and path.is_dir():
                raise FileFormatError(path, "a symbolic link to a folder; valid: folders and files")
            if name in others:
                if not path.is_file():
                    raise FileFormatError(path, "neither a file nor a folder; remove it")
                check_input(path, max_bytes=caps.robot_file_bytes)
                files.append(path)
        if len(files) > caps.robot_files:
            raise FileFormatError(folder, f"has more than {caps.robot_files:,} files, the limit")
    return sorted(files)


def _target(link: Path) -> Path:
    try:
        return link.resolve()
    except (OSError, RuntimeError) as error:
        raise FileFormatError(link, "a symbolic link that leads to itself") from error


def check_model(path: Path) -> None:
    """Check an MJCF file and all files that it includes.

    Raises:
        FileFormatError: it is no MJCF, a path leads out of the folder, or the model is too large.
    """
    kind = _parsed(path).tag
    if kind != "mujoco":
        what = "is a URDF" if kind == "robot" else f"begins with {brief(kind)}"
        raise FileFormatError(
            path,
            f"{what}; valid: MJCF (<mujoco>). `vlnpe robots --import robot.urdf --out FOLDER` "
            "converts a URDF (docs/reference/robots.md)",
        )
    _check_count(path, _Checker(path.parent).count(path, path.name))


def _check_count(path: Path, count: int) -> None:
    if count > MAX_ELEMENTS:
        raise FileFormatError(
            path, f"creates {count:,} elements, copies included; valid: up to {MAX_ELEMENTS:,}"
        )


def check_urdf(path: Path) -> ElementTree.Element:
    """Return a URDF's links and joints; its meshes are relative paths in its folder.

    `package://name/path` is looked up in the folder as path, name/path and the file's name alone.

    Raises:
        FileFormatError: it is no URDF, a path leads out of the folder, or the model is too large.
    """
    whole = _parsed(path)
    if whole.tag != "robot":
        raise FileFormatError(path, f"begins with {brief(whole.tag)}; valid: URDF (<robot>)")
    root = ElementTree.Element("robot", whole.attrib)
    # Extensions of simulators, MuJoCo's own included, may refer to other files.
    root.extend(part for part in whole if part.tag in ("link", "joint", "material"))
    for mass in root.iter("mass"):
        # MuJoCo would take a negative mass for no mass.
        if any(number < 0 for number in numbers_in(mass.get("value", ""))):
            raise FileFormatError(path, f"<mass value={mass.get('value')!r}>; valid: 0 or above")
    for material in root.iter("material"):
        for texture in material.findall("texture"):
            material.remove(texture)
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        package, _, inner = name.removeprefix("package://").partition("/")
        if name.startswith("package://"):
            places = (inner, f"{package}/{inner}", Path(inner).name)
            mesh.set("filename", next((p for p in places if (path.parent / p).is_file()), inner))
    folder = path.parent.resolve()
    _check_count(path, _Checker(folder)._count(path, root, {folder}, 0))
    return root


class _Checker:
    """Counts the elements of a model and of the files that it includes or attaches.

    Each file is counted once, however often it is attached.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        self.open: list[Path] = []
        self.counts: dict[Path, int] = {}

    def count(self, path: Path, reference: str, depth: int = 0) -> int:
        """Return the number of elements that a file creates; `reference` is the path as written."""
        target = path.resolve()
        if target in self.counts:
            return self.counts[target]
        if target in self.open:
            raise FileFormatError(path, f"{brief(reference)} includes itself")
        root = _parsed(path)
        places = {self.folder, path.parent.resolve()}
        for element in root.iter("compiler"):
            for key in _DIRECTORIES:
                if key in element.attrib:
                    self._confined(path, {self.folder}, element.tag, key, element.attrib[key])
                    places.add(self.folder / element.attrib[key])
        self.open.append(target)
        self.counts[target] = self._count(path, root, places, depth)
        self.open.pop()
        return self.counts[target]

    def _count(
        self, path: Path, element: ElementTree.Element, places: set[Path], depth: int
    ) -> int:
        if depth > MAX_NESTING:
            raise FileFormatError(
                path, f"elements nested more than {MAX_NESTING} deep, includes counted"
            )
        total = 1
        for key, value in element.attrib.items():
            self._check_number(path, element, key, value)
            if key.startswith("file"):
                targets = self._confined(path, places, element.tag, key, value)
                if element.tag in ("include", "model"):
                    total += sum(self.count(target, value, depth + 1) for target in targets)
                else:
                    for target in targets:
                        _check_picture(target)
        children = sum(self._count(path, child, places, depth + 1) for child in element)
        return total + max(children, 1) * _copies(element)

    def _confined(
        self, path: Path, places: set[Path], tag: str, key: str, value: str
    ) -> list[Path]:
        """Return the files that a reference may mean, whichever folder MuJoCo joins it to.

        Raises:
            FileFormatError: one of them lies outside the folder or is hidden.
        """
        what = f"<{tag} {key}={brief(value)}>"
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
        if key not in _FREE_TEXT and not all(map(math.isfinite, numbers_in(value))):
            raise FileFormatError(path, f"{what} contains numbers that are not finite")
        sized = element.tag in ("texture", "hfield") and key in _PIXELS
        if sized and any(number > MAX_PIXELS for number in numbers_in(value)):
            raise FileFormatError(path, f"{what} is too large; valid: up to {MAX_PIXELS} pixels")
        if element.tag == "size":
            raise FileFormatError(
                path, f"{what} is not allowed; MuJoCo computes sizes itself, so remove <size>"
            )


def _parsed(path: Path) -> ElementTree.Element:
    """Return the root of an XML file; document types are refused, as parsers differ on them."""
    content = read_input(path, max_bytes=MAX_MODEL_BYTES)
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise FileFormatError(path, "contains a document type or entities; valid: plain MJCF")
    try:
        content.decode("utf-8")
        return ElementTree.fromstring(content, ElementTree.XMLParser(encoding="utf-8"))
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise FileFormatError(path, f"not valid XML: {error}") from error


def _check_picture(path: Path) -> None:
    """Refuse a PNG that becomes enormous when MuJoCo decodes it."""
    with open_input(path) as stream:
        start = stream.read(24)
    if start.startswith(b"\x89PNG") and len(start) == 24:
        width, height = struct.unpack(">II", start[16:])
        if max(width, height) > MAX_PIXELS:
            raise FileFormatError(
                path, f"has {width} × {height} pixels; valid: up to {MAX_PIXELS} on each side"
            )


def _copies(element: ElementTree.Element) -> int:
    """Return how many copies of its content an element creates."""
    if element.tag not in ("replicate", "composite", "flexcomp"):
        return 1
    counts = [max(int(n), 1) for n in numbers_in(element.get("count", "1"))]
    return math.prod(counts) if counts else 1


def numbers_in(value: str) -> Iterator[float]:
    """Yield the numbers of an attribute that contains only numbers."""
    words = value.replace(",", " ").split()
    try:
        yield from [float(word) for word in words]
    except ValueError:
        return
