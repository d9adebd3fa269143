"""Which files can be scans, by suffix. Light to import: the command line asks, too."""

MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".off")
USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
CLOUD_SUFFIXES = (".pcd",)  # a .ply without faces is one, too
SUFFIXES = (*MESH_SUFFIXES, *USD_SUFFIXES, *CLOUD_SUFFIXES)
# What is not read, and what turns it into something that is.
_CLOUD = "a point cloud's exchange format"
CONVERTERS = {
    ".ifc": "a building model (IFC); convert it with IfcOpenShell: IfcConvert {name} {stem}.glb",
    ".e57": f"{_CLOUD}; convert it with CloudCompare (File > Save as PLY) or pye57",
    ".las": f"{_CLOUD}; convert it with PDAL: pdal translate {{name}} {{stem}}.ply",
    ".laz": f"{_CLOUD}; convert it with PDAL: pdal translate {{name}} {{stem}}.ply",
    ".xyz": f"{_CLOUD}; convert it with CloudCompare (File > Save as PLY)",
    ".pts": f"{_CLOUD}; convert it with CloudCompare (File > Save as PLY)",
    ".dae": "Collada; convert it with Assimp: assimp export {name} {stem}.glb",
    ".fbx": "Autodesk FBX; convert it with Blender (File > Export > glTF 2.0) or Assimp: "
    "assimp export {name} {stem}.glb",
    ".3ds": "3D Studio; convert it with Assimp: assimp export {name} {stem}.glb",
    ".blend": "a Blender file; convert it in Blender: File > Export > glTF 2.0",
    ".skp": "a SketchUp file; convert it in SketchUp: File > Export > GLB or OBJ",
    ".rvt": "a Revit file; export IFC from Revit, then IfcConvert model.ifc model.glb",
    ".step": "a CAD file (STEP); convert it with FreeCAD: File > Export > glTF",
    ".stp": "a CAD file (STEP); convert it with FreeCAD: File > Export > glTF",
}
_SPLATS = "Gaussian splats ({kind}), which have no surface; splats are not supported yet"
SPLAT_SUFFIXES = (".splat", ".ksplat", ".spz", ".sog")


def why_not(name: str) -> str:
    """Return why a file of this name is not read, and what to do, in one line."""
    stem, dot, ending = name.rpartition(".")
    suffix = (dot + ending).lower() if dot else ""
    valid = f"valid: {', '.join(SUFFIXES)}"
    if suffix in SPLAT_SUFFIXES:
        return f"{splats(suffix)}; {valid}"
    if suffix in CONVERTERS:
        return f"is {CONVERTERS[suffix].format(name=name, stem=stem)}; {valid}"
    return f"unknown kind {suffix!r}; {valid}"


def splats(kind: str) -> str:
    """Return why splats of this kind are not read."""
    return f"holds {_SPLATS.format(kind=kind)}: take a mesh or a point cloud of the same place"
