"""Read mesh files (GLB, glTF, OBJ, PLY, STL, OFF) with trimesh."""

import contextlib
import io
import re
import warnings as warnings_module
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np
import trimesh
from PIL import Image
from trimesh.visual.material import PBRMaterial, SimpleMaterial
from trimesh.visual.texture import TextureVisuals

from ...formats.core.arrays import F32, I64, U8
from ...formats.core.errors import FileFormatError, first_line
from ...formats.untrusted.files import check_input, read_input
from ...formats.untrusted.limits import limits
from ..gltf.checks import check_gltf
from ..gltf.file import GltfFile, gltf_facts
from ..gltf.textures import with_images
from ..labels.categories import category_of_name
from .files import MESH_SUFFIXES
from .headers import CHECKS
from .images import decode_all
from .obj import without_bad_faces
from .record import DEFAULT_COLOR, Scan, ScanMaterial, linear_to_srgb
from .resolver import ConfinedResolver
from .soup import Part, ScanPart, merge_parts

GLTF = (".glb", ".gltf")
# What writes glTF without turning z up into y up, by its name under `asset.generator`.
KEEP_AXES = ("open asset import library", "assimp", "trimesh", "ifcopenshell", "obj2gltf", "open3d")


def read_mesh(path: Path) -> Scan:
    """Read `path` into one triangle soup, dropping unusable faces with a warning.

    Raises:
        FileFormatError: missing, not a mesh, or without any usable triangle.
    """
    check_input(path, max_bytes=limits().scan_bytes)
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise FileFormatError(
            path, f"unknown file type {suffix!r}; valid: {', '.join(MESH_SUFFIXES)}"
        )
    resolver = ConfinedResolver(path.parent)
    if suffix in GLTF:
        file = GltfFile(path, resolver)
        check_gltf(path, file)
        scene = _load(path, file.without_images(), resolver)
        licence, generator = gltf_facts(file.tree)
        parts = _parts(scene, True, resolver.warnings)
        parts = with_images(parts, file, resolver.warnings)
        generated_by = str(file.tree["asset"].get("generator", "")).lower()
        converted = any(name in generated_by for name in KEEP_AXES)
        promise = ("y", "glTF is y up by its specification")
        metres = ("m", "glTF is in metres by its specification")
    else:
        if suffix in CHECKS:
            CHECKS[suffix](path)
        scene = _load_plain(path, resolver)
        licence, generator, promise, metres, converted = "", {}, None, None, False
        parts = _parts(scene, suffix == ".obj", resolver.warnings)
        parts = _decoded(parts, resolver.warnings)
    warnings = list(dict.fromkeys(resolver.warnings))
    if not parts:
        raise FileFormatError(path, "; ".join(["contains no triangles", *warnings[:3]]))
    scan = merge_parts(parts, warnings, promise, metres)
    if not len(scan.faces):
        raise FileFormatError(path, "contains no usable triangle: " + "; ".join(warnings[:5]))
    return replace(scan, licence=licence, generator=generator, converted=converted)


def _load_plain(path: Path, resolver: ConfinedResolver) -> trimesh.Scene:
    """Load a file that is no glTF; an OBJ file without faces of missing vertices."""
    data = read_input(path, max_bytes=limits().scan_bytes)
    if path.suffix.lower() != ".obj":
        return _load(path, io.BytesIO(data), resolver)
    # Some exporters name groups, others objects, which count more.
    split = "split_objects" if re.search(rb"^o[ \t]", data, re.MULTILINE) else "split_groups"
    try:
        return _load(path, io.BytesIO(data), resolver, **{split: True})
    except FileFormatError:
        sound, dropped = without_bad_faces(data)
        if not dropped:
            raise
        resolver.warnings.append(f"{dropped} faces with indices out of range dropped")
        return _load(path, io.BytesIO(sound), resolver, **{split: True})


def _load(
    path: Path, stream: IO[bytes], resolver: ConfinedResolver, **options: Any
) -> trimesh.Scene:
    kind = path.suffix.lower()[1:]
    try:
        with warnings_module.catch_warnings(), _quiet():
            # NumPy's words about damaged numbers inside trimesh; they are looked at below.
            warnings_module.simplefilter("ignore", DeprecationWarning)
            warnings_module.simplefilter("ignore", RuntimeWarning)
            return trimesh.load_scene(
                stream, file_type=kind, resolver=resolver, process=False, **options
            )
    # Readers raise many types of error on damaged bytes; the file is at fault in each case.
    except Exception as error:
        if resolver.refused:
            raise FileFormatError(path, resolver.refused) from error
        raise FileFormatError(path, f"cannot be read as {kind}: {first_line(error)}") from error


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep the library from logging tracebacks of references that the resolver refused."""
    logger = trimesh.util.log
    before, logger.disabled = logger.disabled, True
    try:
        yield
    finally:
        logger.disabled = before


def _decoded(parts: list[ScanPart], warnings: list[str]) -> list[ScanPart]:
    """Decode the images of parts, each once; parts with damaged images lose them."""
    images = {str(id(i)): i for p in parts if (i := p.material.image) is not None}
    pictures = decode_all(images, warnings)
    return [
        p
        if p.material.image is None
        else replace(p, material=replace(p.material, image=pictures[str(id(p.material.image))]))
        for p in parts
    ]


def _parts(scene: trimesh.Scene, named: bool, warnings: list[str]) -> list[ScanPart]:
    """Return one part per node with triangles, in scene coordinates."""
    parts = []
    for node, geometry_node in sorted(
        _named_nodes(scene), key=lambda item: (item[0], scene.graph[item[1]][1])
    ):
        transform, geometry_name = scene.graph[geometry_node]
        mesh = scene.geometry[geometry_name]
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            warnings.append(f"{node}: {type(mesh).__name__} without triangles skipped")
            continue
        faces = np.asarray(mesh.faces, dtype=np.int64)
        vertices = np.asarray(mesh.vertices, dtype=np.float64)
        if vertices.shape[1:] != (3,) or faces.shape[1:] != (3,):
            warnings.append(f"{node}: its points or faces are damaged; skipped")
            continue
        sound = np.all((faces >= 0) & (faces < len(vertices)), axis=1)
        if not sound.all():
            dropped = int((~sound).sum())
            warnings.append(f"{node}: {dropped} faces with indices out of range dropped")
            faces = faces[sound]
            if not len(faces):
                continue
        corner_uv, material, colors = _look(mesh, faces)
        # Pieces may share one buffer of vertices and use few of them each.
        used, inverse = np.unique(faces, return_inverse=True)
        vertices, faces = vertices[used], inverse.reshape(-1, 3)
        with np.errstate(invalid="ignore", over="ignore"):
            vertices = vertices @ transform[:3, :3].T + transform[:3, 3]
        if np.linalg.det(transform[:3, :3]) < 0:
            # A mirrored node turns its faces inside out.
            faces, corner_uv = faces[:, ::-1], corner_uv[:, ::-1]
            colors = None if colors is None else colors[:, ::-1]
        parts.append(
            Part(
                str(node),
                category_of_name(str(node)) if named else "",
                vertices,
                faces,
                corner_uv,
                material,
                colors,
            )
        )
    return parts


def _named_nodes(scene: trimesh.Scene) -> Iterator[tuple[str, str]]:
    """Yield what each node with geometry is called, and the node.

    trimesh gives every primitive of a glTF mesh with several materials a node of its own, with a
    random name, below the mesh's node. They are one object, by that node's name.
    """
    parents = scene.graph.transforms.parents
    for node in scene.graph.nodes_geometry:
        mesh = scene.geometry[scene.graph[node][1]]
        several = mesh.metadata.get("from_gltf_primitive", False)
        yield (str(parents[node]) if several and node in parents else str(node)), node


def _look(mesh: trimesh.Trimesh, faces: I64) -> tuple[F32, ScanMaterial, U8 | None]:
    """Return corner uv (F, 3, 2), the material, and corner colours (F, 3, 3) if there are any."""
    uv = np.zeros((len(faces), 3, 2), dtype=np.float32)
    visual: Any = mesh.visual
    if isinstance(visual, TextureVisuals):
        if visual.uv is not None and len(visual.uv) == len(mesh.vertices):
            rows = np.asarray(visual.uv, dtype=np.float32)
            if rows.ndim == 2 and rows.shape[1] >= 2:
                uv = np.nan_to_num(rows[:, :2], posinf=0.0, neginf=0.0)[faces]
        return uv, _material(visual.material), None
    if visual.kind in ("vertex", "face"):
        if visual.kind == "vertex":
            colors = np.asarray(visual.vertex_colors)[faces][..., :3]
        else:
            colors = np.repeat(np.asarray(visual.face_colors)[: len(faces), None, :3], 3, axis=1)
        low, high = colors.min(), colors.max()
        if low != high:
            return uv, ScanMaterial("painted", (1.0, 1.0, 1.0)), colors.astype(np.uint8)
        # One colour everywhere: black is a writer's placeholder, not a look.
        if high > 0:
            r, g, b = (float(v) for v in colors.reshape(-1, 3)[0] / 255.0)
            return uv, ScanMaterial("plain", (r, g, b)), None
    return uv, ScanMaterial("plain", DEFAULT_COLOR), None


def _material(material: Any) -> ScanMaterial:
    image, color = None, np.ones(3)
    if isinstance(material, PBRMaterial):
        image = material.baseColorTexture
        if material.baseColorFactor is not None:
            # trimesh stores the factor as bytes; glTF means it linear, and pictures are sRGB.
            color = linear_to_srgb(np.asarray(material.baseColorFactor[:3]) / 255.0)
    elif isinstance(material, SimpleMaterial):
        image = material.image
        if material.diffuse is not None and image is None:
            color = np.asarray(material.diffuse[:3]) / 255.0
    if image is not None and not isinstance(image, Image.Image):
        image = None
    name = str(getattr(material, "name", None) or "material")
    r, g, b = (float(v) for v in np.clip(color, 0.0, 1.0))
    return ScanMaterial(name, (r, g, b), image)
