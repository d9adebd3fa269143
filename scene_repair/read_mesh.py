"""Reading mesh files (GLB, glTF, OBJ, PLY, STL, OFF) through trimesh into a `Scan`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.visual.material import PBRMaterial, SimpleMaterial
from trimesh.visual.texture import TextureVisuals

from ..formats.errors import FileFormatError
from .gltf_facts import gltf_facts
from .labels import category_of_name
from .resolver import ConfinedResolver
from .scan import Scan, ScanMaterial, ScanObject
from .vertex_colors import bake_corner_colors

SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".off")
# Coordinates beyond this are no building in any unit, and would ruin every bounding box.
MAX_COORDINATE = 1e7
DEFAULT_COLOR = (0.75, 0.74, 0.72)


def read_mesh(path: Path) -> Scan:
    """Read `path` into one triangle soup, dropping unusable faces with a warning.

    Raises:
        FileFormatError: missing, not a mesh, or without any usable triangle.
    """
    if not path.is_file():
        raise FileFormatError(path, "no such file")
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise FileFormatError(path, f"unknown kind {suffix!r}; valid: {', '.join(SUFFIXES)}")
    resolver = ConfinedResolver(path.parent)
    options: dict[str, Any] = {"split_objects": True} if suffix == ".obj" else {}
    try:
        with path.open("rb") as stream:
            scene = trimesh.load_scene(
                stream,
                file_type=suffix[1:],
                resolver=resolver,
                process=False,
                **options,
            )
    # Readers fail in many ways on damaged bytes; whatever they raise, the file is at fault.
    except Exception as error:
        raise FileFormatError(path, f"cannot be read as {suffix[1:]}: {_brief(error)}") from error
    is_gltf = suffix in (".glb", ".gltf")
    licence, generator = gltf_facts(path) if is_gltf else ("", {})
    warnings = list(resolver.warnings)
    parts = _parts(scene, warnings)
    if not parts:
        raise FileFormatError(path, "holds no triangles")
    scan = _merge(parts, warnings, suffix)
    if not len(scan.faces):
        raise FileFormatError(path, "holds no usable triangle: " + "; ".join(warnings))
    return replace(scan, licence=licence, generator=generator)


def _brief(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return (lines[0][:160] if lines else "") or type(error).__name__


def _parts(scene: trimesh.Scene, warnings: list[str]) -> list[dict[str, Any]]:
    """One dictionary per node that holds triangles, in scene coordinates."""
    parts = []
    for node in sorted(scene.graph.nodes_geometry):
        transform, geometry_name = scene.graph[node]
        mesh = scene.geometry[geometry_name]
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            warnings.append(f"{node}: {type(mesh).__name__} without triangles skipped")
            continue
        faces = np.asarray(mesh.faces, dtype=np.int64)
        vertices = np.asarray(mesh.vertices, dtype=np.float64)
        sound = np.all((faces >= 0) & (faces < len(vertices)), axis=1)
        if not sound.all():
            dropped = int((~sound).sum())
            warnings.append(f"{node}: {dropped} faces with indices out of range dropped")
            faces = faces[sound]
        corner_uv, material, colors = _look(mesh, faces)
        vertices = vertices @ transform[:3, :3].T + transform[:3, 3]
        if np.linalg.det(transform[:3, :3]) < 0:
            # A mirrored node turns its faces inside out.
            faces, corner_uv = faces[:, ::-1], corner_uv[:, ::-1]
            colors = None if colors is None else colors[:, ::-1]
        parts.append(
            {
                "node": str(node),
                "vertices": vertices,
                "faces": faces,
                "uv": corner_uv,
                "material": material,
                "colors": colors,
            }
        )
    return parts


def _look(
    mesh: trimesh.Trimesh, faces: NDArray[np.int64]
) -> tuple[NDArray[np.float32], ScanMaterial, NDArray[np.uint8] | None]:
    """Corner uv (F, 3, 2), the material, and corner colours (F, 3, 3) if vertices have some."""
    uv = np.zeros((len(faces), 3, 2), dtype=np.float32)
    visual: Any = mesh.visual
    if isinstance(visual, TextureVisuals):
        if visual.uv is not None and len(visual.uv) == len(mesh.vertices):
            uv = np.nan_to_num(np.asarray(visual.uv, dtype=np.float32)[faces])
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
            color = _linear_to_srgb(np.asarray(material.baseColorFactor[:3]) / 255.0)
    elif isinstance(material, SimpleMaterial):
        image = material.image
        if material.diffuse is not None and image is None:
            color = np.asarray(material.diffuse[:3]) / 255.0
    if image is not None and not isinstance(image, Image.Image):
        image = None
    name = str(getattr(material, "name", None) or "material")
    r, g, b = (float(v) for v in np.clip(color, 0.0, 1.0))
    return ScanMaterial(name, (r, g, b), image)


def _linear_to_srgb(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """IEC 61966-2-1 transfer function."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def _merge(parts: list[dict[str, Any]], warnings: list[str], suffix: str) -> Scan:
    materials: dict[Any, int] = {}
    kept_materials: list[ScanMaterial] = []
    objects: list[ScanObject] = []
    named = suffix in (".glb", ".gltf", ".obj")
    vertices, faces, uvs, face_material, face_object = [], [], [], [], []
    offset = 0
    for part in parts:
        material, uv = part["material"], part["uv"]
        if part["colors"] is not None:
            image, uv = bake_corner_colors(part["colors"])
            material = ScanMaterial(material.name, (1.0, 1.0, 1.0), image)
        key = (id(material.image) if material.image is not None else None, material.base_color)
        if key not in materials:
            materials[key] = len(kept_materials)
            kept_materials.append(material)
        index = -1
        if named and (category := category_of_name(part["node"])):
            index = len(objects)
            objects.append(ScanObject(part["node"], category))
        vertices.append(part["vertices"])
        faces.append(part["faces"] + offset)
        uvs.append(uv)
        face_material.append(np.full(len(uv), materials[key], dtype=np.int32))
        face_object.append(np.full(len(uv), index, dtype=np.int32))
        offset += len(part["vertices"])
    soup = {
        "vertices": np.concatenate(vertices),
        "faces": np.concatenate(faces),
        "corner_uv": np.concatenate(uvs).astype(np.float32),
        "face_material": np.concatenate(face_material),
        "face_object": np.concatenate(face_object),
    }
    keep = _usable_faces(soup["vertices"], soup["faces"], warnings)
    for name in ("faces", "corner_uv", "face_material", "face_object"):
        soup[name] = soup[name][keep]
    soup["vertices"], soup["faces"] = weld(soup["vertices"], soup["faces"])
    gltf = suffix in (".glb", ".gltf")
    return Scan(
        **soup,
        materials=tuple(kept_materials),
        objects=tuple(objects),
        up=("y", "glTF is y up by its specification") if gltf else None,
        unit=("m", "glTF is in metres by its specification") if gltf else None,
        warnings=tuple(warnings),
    )


def _usable_faces(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], warnings: list[str]
) -> NDArray[np.bool_]:
    finite = np.all(np.isfinite(vertices) & (np.abs(vertices) < MAX_COORDINATE), axis=1)
    keep = finite[faces].all(axis=1)
    if not keep.all():
        warnings.append(f"{int((~keep).sum())} faces with invalid coordinates dropped")
    with np.errstate(invalid="ignore", over="ignore"):
        a, b, c = (vertices[faces[:, i]] for i in range(3))
        doubled = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    degenerate = keep & ~(doubled > 0)
    if degenerate.any():
        warnings.append(f"{int(degenerate.sum())} faces without area dropped")
    return keep & ~degenerate


def weld(
    vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Merge vertices at bitwise equal positions, drop unused ones; faces keep their order."""
    used, inverse = np.unique(faces, return_inverse=True)
    points = vertices[used] + 0.0  # −0.0 and 0.0 are one place
    order = np.lexsort(points.T)
    ordered = points[order]
    new = np.ones(len(ordered), dtype=bool)
    new[1:] = np.any(ordered[1:] != ordered[:-1], axis=1)
    group = np.empty(len(points), dtype=np.int64)
    group[order] = np.cumsum(new) - 1
    return ordered[new], group[inverse].reshape(faces.shape)
