"""The exact, textured geometry of a building, as a scan without any scanner's defects."""

from pathlib import Path

import numpy as np

from ..formats.core.frames import world_to_habitat_position
from ..geometry.fusion.surface import ScanMesh
from .building.build import build_scene
from .building.true_scene import TrueScene
from .config import ApartmentConfig
from .generate import encode_page, scan_pose, write_labels
from .glb import GlbNode, write_glb
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

    Args:
        seed: at least 0; every seed is another building.
        out_dir: existing folder to write into.
        config: what to build; see `building_config`.

    Returns:
        Path of `scan.glb`.

    Raises:
        ValueError: `config` admits no building.
    """
    scene = build_scene(np.random.default_rng(seed), config)
    pose = scan_pose(config)
    pages = [encode_page(m.image, config.scan.jpeg_quality) for m in scene.materials]
    extras = {"seed": seed, "licence": "Apache-2.0"}
    write_glb(out_dir / "scan.glb", _nodes(scene, pose), pages, extras, tiled=True)
    write_labels(out_dir / "scan.labels.json", scene, pose)
    corners = scene.shape.corners.reshape(-1, 3)
    mesh = ScanMesh(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))
    write_truth(out_dir / "truth.npz", scene.storeys, mesh, pose)
    return out_dir / "scan.glb"


def _nodes(scene: TrueScene, pose: np.ndarray) -> list[GlbNode]:
    """Return the triangles by object and, within one, by material."""
    shape = scene.shape
    points = world_to_habitat_position(shape.corners @ pose[:3, :3].T + pose[:3, 3])
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
            node = GlbNode(thing.name, vertices[:, :3], vertices[:, 3:], triangles, material)
            nodes.append(node)
    return nodes
