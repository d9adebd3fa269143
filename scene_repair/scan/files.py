"""Which files are scans, and which files beside a scan are read with it.

Imports little, since the command line uses it, too.
"""

from pathlib import Path

from ...formats.core.errors import FileFormatError
from ...formats.untrusted.files import read_input

MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".off")
USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
CLOUD_SUFFIXES = (".pcd",)  # a .ply without faces is one, too
SPLAT_SUFFIXES = (".splat", ".spz")  # a .ply, .glb or .gltf may hold splats, too
SUFFIXES = (*MESH_SUFFIXES, *USD_SUFFIXES, *CLOUD_SUFFIXES, *SPLAT_SUFFIXES)
# What is not read, and what turns it into something that is.
_CLOUD, _TO_PLY = "a point cloud's exchange format", "{name} {stem}.ply"
_CAD = "a CAD file (STEP); convert it with FreeCAD: File > Export > glTF"
_SPLATS = "convert it with SplatTransform: splat-transform {name} {stem}.ply"
CONVERTERS = {
    ".ifc": "a building model (IFC); convert it with IfcOpenShell: IfcConvert {name} {stem}.glb",
    ".e57": f"{_CLOUD}; convert it with CloudCompare (File > Save as PLY) or pye57",
    **dict.fromkeys((".las", ".laz"), f"{_CLOUD}; convert it with PDAL: pdal translate {_TO_PLY}"),
    **dict.fromkeys(
        (".xyz", ".pts"), f"{_CLOUD}; convert it with CloudCompare (File > Save as PLY)"
    ),
    ".dae": "Collada; convert it with Assimp: assimp export {name} {stem}.glb",
    ".fbx": "Autodesk FBX; convert it with Blender (File > Export > glTF 2.0) or Assimp: "
    "assimp export {name} {stem}.glb",
    ".3ds": "3D Studio; convert it with Assimp: assimp export {name} {stem}.glb",
    ".blend": "a Blender file; convert it in Blender: File > Export > glTF 2.0",
    ".skp": "a SketchUp file; convert it in SketchUp: File > Export > GLB or OBJ",
    ".rvt": "a Revit file; export IFC from Revit, then IfcConvert model.ifc model.glb",
    ".ksplat": f"Gaussian splats in KSPLAT format; {_SPLATS}",
    ".sog": f"Gaussian splats in SOG format; {_SPLATS}",
    **dict.fromkeys((".step", ".stp"), _CAD),
}
LICENCE_NAMES = ("LICENSE.{stem}", "{stem}.LICENSE", "{stem}.license.txt", "LICENSE")
MAX_LICENCE_BYTES = 1 << 20
LABELS_NAME, MAX_LABELS_BYTES = "{stem}.labels.json", 64 << 20
# As InteriorGS has it beside its splats.
INTERIOR_NAME = "labels.json"
HOUSE_NAME, MAX_HOUSE_BYTES = "{stem}.house", 256 << 20


def may_be_points(path: Path) -> bool:
    """Return whether a scan's surface may have to be reconstructed from points."""
    return path.suffix.lower() in (*CLOUD_SUFFIXES, ".ply")


def why_not(name: str) -> str:
    """Return in one line why a file of this name is not supported, and how to convert it."""
    stem, dot, ending = name.rpartition(".")
    suffix = (dot + ending).lower() if dot else ""
    valid = f"valid: {', '.join(SUFFIXES)}"
    if suffix in CONVERTERS:
        return f"is {CONVERTERS[suffix].format(name=name, stem=stem)}; {valid}"
    return f"unknown file type {suffix!r}; {valid}"


def side_names(source: Path) -> list[str]:
    """Return the names of all files beside the scan `source` that are read with it if present."""
    stem = source.stem
    names = [LABELS_NAME.format(stem=stem), INTERIOR_NAME, HOUSE_NAME.format(stem=stem)]
    return [*names, *licence_names(stem)]


def licence_names(stem: str) -> list[str]:
    """Return file names of a licence, most specific first: `LICENSE.quest` covers `quest_room`."""
    own = [pattern.format(stem=stem) for pattern in LICENCE_NAMES]
    ends = [k for k, letter in enumerate(stem) if letter in "_-" and k > 0]
    family = [LICENCE_NAMES[0].format(stem=stem[:k]) for k in reversed(ends)]
    return [*own[:-1], *family, own[-1]]


def side_file(folder: Path, name: str, max_bytes: int) -> bytes | None:
    """Return the bytes of the file `name` in `folder`; None if there is none.

    A FileFormatError is raised if it is a link out of the folder, too large, or unreadable.
    """
    path = folder / name
    try:
        if not path.exists() and not path.is_symlink():
            return None
        target = path.resolve()
        if not target.is_relative_to(folder.resolve()):
            raise FileFormatError(path, "is a link that leads out of the scan's folder")
        return read_input(path, root=folder, max_bytes=max_bytes)
    except (OSError, RuntimeError) as error:
        raise FileFormatError(path, f"cannot be read: {error}") from error


def licence_beside(source: Path) -> str:
    """Return the licence beside the source; empty if none. Raise FileFormatError if no text."""
    for name in licence_names(source.stem):
        data = side_file(source.parent, name, MAX_LICENCE_BYTES)
        if data is not None:
            try:
                return data.decode()
            except UnicodeDecodeError as error:
                path = source.with_name(name)
                raise FileFormatError(path, "the licence is not UTF-8 text") from error
    return ""
