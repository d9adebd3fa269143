"""The exact, textured geometry of a building, as a scan without any scanner's defects."""

from pathlib import Path

import numpy as np

from ..geometry.fusion.surface import ScanMesh
from .building.true_scene import TrueScene
from .config import ApartmentConfig
from .glb import GlbNode, encode_page, write_glb
from .output import LICENCE, begin, scan_pose, to_source, write_labels
from .truth import write_truth


def generate_exact(
    seed: int,
    out_dir: Path,
    config: ApartmentConfig = ApartmentConfig(),  # noqa: B008  (frozen)
) -> Path:
    """Generate the building of `seed` and write its exact geometry.

    Writes the files of `generate_scan`. The building is the same, but the mesh has neither noise
    nor holes, and its tiled textures are surface colours without the light of the rooms; renderers
    light them. It takes about a tenth of the time.
    """
    _, scene, _ = begin(seed, config)
    pose = scan_pose(config)
    pages = [encode_page(m.image, config.scan.jpeg_quality) for m in scene.materials]
    extras = {"seed": seed, "licence": LICENCE}
    write_glb(out_dir / "scan.glb", _nodes(scene, pose), pages, extras, tiled=True)
    write_labels(out_dir / "scan.labels.json", scene, pose)
    write_truth(
        out_dir / "truth.npz", scene.storeys, ScanMesh.of_corners(scene.shape.corners), pose
    )
    return out_dir / "scan.glb"


def _nodes(scene: TrueScene, pose: np.ndarray) -> list[GlbNode]:
    """Return the triangles by object and, within one, by material."""
    shape = scene.shape
    points = to_source(shape.corners, pose)
    size_m = np.array([material.size_m for material in scene.materials])
    uv = shape.uv / size_m[shape.material][:, None]
    uv[..., 1] = 1.0 - uv[..., 1]
    corner = np.concatenate([points, uv], axis=-1).astype(np.float32)
    nodes = []
    for k, thing in enumerate(scene.objects):
        faces = np.flatnonzero(scene.face_object == k)
        for material in np.unique(shape.material[faces]).tolist():
            own = corner[faces[shape.material[faces] == material]]
            vertices, index = np.unique(own.reshape(-1, 5), axis=0, return_inverse=True)
            triangles = index.reshape(-1, 3).astype(np.uint32)
            part = (vertices[:, :3], vertices[:, 3:], triangles, material)
            nodes.append(GlbNode(thing.name, *part))
    return nodes
