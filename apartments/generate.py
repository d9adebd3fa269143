"""The built-in scenes: build one, scan it, write the scan and its truth."""

from functools import partial
from pathlib import Path

import cv2
import numpy as np

from ..formats.core.arrays import I32, U8, Array
from ..formats.process.threads import beside
from ..geometry.fusion.surface import ScanMesh, extract
from .building.true_scene import TrueScene
from .config import ApartmentConfig
from .glb import GlbNode, write_glb
from .output import LICENCE, Progress, begin, scan_pose, to_source, write_labels
from .scanner.atlas import Charts, Packing, cut, pack
from .scanner.bake import Baker, ChartVertices, chart_vertices, page_corners
from .scanner.fusion import fuse
from .scanner.lookup import label_faces
from .scanner.tracing import Tracer
from .truth import write_truth


def generate_scan(
    seed: int,
    out_dir: Path,
    config: ApartmentConfig = ApartmentConfig(),  # noqa: B008  (frozen)
    progress: Progress | None = None,
) -> Path:
    """Generate the building of `seed` (at least 0) and scan it; return the path of `scan.glb`.

    Writes into the existing folder `out_dir`: `scan.glb` (y up, metres, one node per object),
    `scan.labels.json` (bounds of every object and room in the GLB's coordinates) and `truth.npz`
    (see `truth.write_truth`). The same seed and configuration give the same files. `progress` is
    called with the name of each step as it begins.

    Raises:
        ValueError: `config` admits no building.
    """
    rng, scene, report = begin(seed, config, progress)
    tracer = Tracer(scene.shape.corners)
    report("scanning")
    volume = fuse(rng, scene, tracer, config.scan)
    with beside(partial(Baker, rng, scene, tracer, config.scan)) as get_baker:
        report("meshing")
        mesh = extract(volume, config.scan.target_faces)
        baker = get_baker()
    del volume
    pose = scan_pose(config)
    with beside(partial(write_truth, out_dir / "truth.npz", scene.storeys, mesh, pose)) as truth:
        report("unfolding")
        label = label_faces(mesh, tracer, scene.face_object)
        charts = cut(mesh, label, _texel_sizes(scene, config))
        packing = pack(charts, config.scan.page_px)
        split = chart_vertices(mesh, charts)
        truth()
    report("lighting")
    light = baker.vertex_light(mesh, split)
    report("painting")
    pages = [
        encode_page(baker.page(mesh, charts, split, light, packing, k), config.scan.jpeg_quality)
        for k in range(len(packing.page_size))
    ]
    report("writing")
    nodes = _nodes(scene, mesh, label, charts, packing, split, pose)
    write_glb(out_dir / "scan.glb", nodes, pages, {"seed": seed, "licence": LICENCE})
    write_labels(out_dir / "scan.labels.json", scene, pose)
    return out_dir / "scan.glb"


def _texel_sizes(scene: TrueScene, config: ApartmentConfig) -> Array:
    fine = [o.category in ("floor", "rug") for o in scene.objects]
    return np.where(fine, config.scan.floor_texel_m, config.scan.texel_m)


def encode_page(image: U8, quality: int) -> bytes:
    """Return an RGB image (rows, columns, 3) as JPEG of the given quality (0–100)."""
    done, data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ValueError(f"cannot encode a texture page of shape {image.shape} as JPEG")
    return data.tobytes()


def _nodes(
    scene: TrueScene,
    mesh: ScanMesh,
    label: I32,
    charts: Charts,
    packing: Packing,
    split: ChartVertices,
    pose: Array,
) -> list[GlbNode]:
    corner = page_corners(charts, packing)
    uv = np.zeros((len(split.vertex), 2))
    uv[split.face.ravel()] = corner.reshape(-1, 2)
    # Rounded once for all nodes, so that equal positions stay equal after the split.
    points = to_source(mesh.vertices, pose).astype(np.float32)
    order = np.argsort(label, kind="stable")
    starts = np.searchsorted(label[order], np.arange(len(scene.objects) + 1))
    nodes = []
    for k, thing in enumerate(scene.objects):
        triangles = order[starts[k] : starts[k + 1]]
        if not len(triangles):
            continue
        used, faces = np.unique(split.face[triangles], return_inverse=True)
        page = int(packing.page[charts.chart[triangles[0]]])
        vertices, triangles = points[split.vertex[used]], faces.reshape(-1, 3).astype(np.uint32)
        page_uv = (uv[used] / packing.page_size[page]).astype(np.float32)
        nodes.append(GlbNode(thing.name, vertices, page_uv, triangles, page))
    return nodes
