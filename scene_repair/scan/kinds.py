"""Which files can be scans, by suffix. Light to import: the command line asks, too."""

MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".off")
USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
CLOUD_SUFFIXES = (".pcd",)  # a .ply without faces is one, too
SUFFIXES = (*MESH_SUFFIXES, *USD_SUFFIXES, *CLOUD_SUFFIXES)
