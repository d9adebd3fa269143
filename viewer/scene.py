"""A repaired scene as nodes of a viser scene: textures unlit, storeys and ceilings apart."""

import logging
from dataclasses import dataclass

import cv2
import fast_simplification
import numpy as np
from numpy.typing import NDArray
from viser import SceneApi, SceneNodeHandle

from ..formats.core.arrays import F32, U8, Floats, Mask
from ..formats.core.errors import FileFormatError
from ..formats.core.frames import quat_to_matrix
from ..formats.core.geometry import triangle_normals
from ..formats.process.source import code_digest
from ..formats.scene.bundle import SceneBundle, VisualMesh
from ..formats.splats.store import SPLATS_NAME, load_splats
from .cache import cached, stamp
from .glb import Patch, unique_rows, unlit_glb

log = logging.getLogger(__name__)

# Triangles that begin higher above their storey's floor are in the way of someone who looks in.
UPPER_M = 1.9
KINDS = ("lower", "upper")
BELOW_FLOOR_M = 0.3  # a storey begins this far below its floor
SHOWN_WHITE = 0.9  # linear; white itself would need an endless brightness
WHITE_GAIN = 2.215  # what is shown as `SHOWN_WHITE`
_BAND_0 = 0.28209479177387814  # of the real spherical harmonics, constant


@dataclass(frozen=True)
class Detail:
    """How much of a scene a browser gets.

    Attributes:
        faces: triangles; a scene with more is simplified.
        texels: of all textures together; the largest are halved until they fit.
        splats: Gaussians; of more, the largest and most opaque are kept.
        quality: of the JPEGs, 0–100.
    """

    faces: int = 300_000
    texels: int = 12_000_000
    splats: int = 500_000
    quality: int = 85


# What a browser that draws on the processor gets instead while something moves: there a triangle
# takes 0.9 µs.
COARSE = Detail(faces=12_000, texels=1_500_000, quality=75)


@dataclass(frozen=True)
class SceneNodes:
    """Nodes of a scene.

    Attributes:
        lower: per storey, what begins below `UPPER_M`; splats are all in the first.
        upper: per storey, ceilings and lamps.
        faces, faces_before: triangles shown and of the scene.
        width_m: along x.
    """

    lower: tuple[SceneNodeHandle, ...]
    upper: tuple[SceneNodeHandle, ...]
    faces: int
    faces_before: int
    width_m: float

    def show(self, level: int | None = None, *, ceiling: bool = False) -> None:
        """Show one storey, or all, with or without its ceiling; splats have one for all levels."""
        level = level if level in range(len(self.lower)) else None
        for k, (lower, upper) in enumerate(zip(self.lower, self.upper, strict=True)):
            lower.visible = level in (None, k)
            upper.visible = lower.visible and ceiling


def add_scene(
    api: SceneApi,
    bundle: SceneBundle,
    name: str = "/scene",
    detail: Detail | None = None,
    mesh: VisualMesh | None = None,
) -> SceneNodes:
    """Add a scene's triangles or splats under `name`, with the ceilings hidden.

    `mesh` is a part of the scene's to show in its place.

    Raises:
        FileFormatError: a texture is missing or damaged.
    """
    detail = detail or Detail()
    if mesh is None and (bundle.root / SPLATS_NAME).is_file():
        node = _add_splats(api, bundle, name, detail)
        none = api.add_frame(f"{name}/none", show_axes=False)
        grid = bundle.freemap(0).grid
        return SceneNodes((node,), (none,), 0, 0, grid.columns * grid.cell_m)
    if mesh is None:
        key = repr((detail, COARSE, stamp(bundle.root.resolve()), code_digest(__name__)))
        parts = cached(key, lambda: _both(bundle, detail))
    else:
        parts = _parts(bundle, mesh, detail)
    shown, before, width_m = np.frombuffer(parts["counts"])
    if shown < before:
        log.warning("%s: %d of %d triangles shown", bundle.scene_id, shown, before)
    nodes: list[list[SceneNodeHandle]] = [[], []]
    for k in range(max(1, len(bundle.level_floor_z_m))):
        for part, kind in enumerate(KINDS):
            nodes[part].append(api.add_frame(f"{name}/{k}/{kind}", show_axes=False))
            for fineness in ("fine", "coarse"):  # see `page.js`
                path = f"{k}/{kind}/{fineness}"
                if glb := parts.get(path):
                    api.add_glb(
                        f"{name}/{path}",
                        glb,
                        visible=fineness == "fine",
                        cast_shadow=False,
                        receive_shadow=False,
                    )
    result = SceneNodes(tuple(nodes[0]), tuple(nodes[1]), int(shown), int(before), width_m)
    result.show()
    return result


def _both(bundle: SceneBundle, detail: Detail) -> dict[str, bytes]:
    """Return the parts of a scene, and its coarse ones."""
    mesh = bundle.visual()
    coarse = _parts(bundle, mesh, COARSE, "coarse") if len(mesh.faces) > 2 * COARSE.faces else {}
    return coarse | _parts(bundle, mesh, detail)


def _parts(
    bundle: SceneBundle, mesh: VisualMesh, detail: Detail, fineness: str = "fine"
) -> dict[str, bytes]:
    """Return each storey's lower and upper part as GLB, and `counts`.

    These are triangles shown, triangles of the scene, and its width along x, as float64.
    """
    before = len(mesh.faces)
    if before > detail.faces:
        mesh = simplified(mesh, detail.faces)
    used = {bundle.materials[k].texture for k in np.unique(mesh.face_material)}
    images = _images(bundle, detail, {path for path in used if path is not None})
    corners = mesh.vertices[mesh.faces]
    center_z, low_z = corners[..., 2].mean(axis=1), corners[..., 2].min(axis=1)
    starts = np.array(bundle.level_floor_z_m)
    level = np.searchsorted(starts - BELOW_FLOOR_M, center_z, side="right") - 1
    level = np.clip(level, 0, max(0, len(starts) - 1))
    high = low_z > (starts[level] if len(starts) else 0.0) + UPPER_M
    result = {}
    for k in range(max(1, len(starts))):
        for part, kind in enumerate(KINDS):
            patches = _patches(bundle, mesh, images, (level == k) & (high == bool(part)))
            glb = unlit_glb(patches, WHITE_GAIN) if patches else b""
            result[f"{k}/{kind}/{fineness}"] = glb
    counts = np.array([len(mesh.faces), before, np.ptp(corners[..., 0])])
    return {**result, "counts": counts.tobytes()}


def simplified(mesh: VisualMesh, faces: int) -> VisualMesh:
    """Return a mesh with about so many triangles; charts of textures are simplified one by one.

    A vertex that is kept takes the texture coordinate of the nearest one that it replaces.
    """
    keys = np.concatenate(
        [
            mesh.faces.reshape(-1, 1).astype(np.float64),
            mesh.corner_uv.reshape(-1, 2),
            np.repeat(mesh.face_material, 3)[:, None],
        ],
        axis=1,
    )
    first, inverse = unique_rows(keys.astype(np.float64))
    points = mesh.vertices[mesh.faces.ravel()[first]].astype(np.float64)
    uv = mesh.corner_uv.reshape(-1, 2)[first]
    material = np.repeat(mesh.face_material, 3)[first]
    triangles = inverse.reshape(-1, 3).astype(np.int32)
    ratio = 1.0 - faces / len(mesh.faces)
    *_, collapses = fast_simplification.simplify(points, triangles, ratio, return_collapses=True)
    new, new_faces, target = fast_simplification.replay_simplification(points, triangles, collapses)
    away = np.linalg.norm(points - new[target], axis=1)
    order = np.lexsort((away, target))
    nearest = order[np.unique(target[order], return_index=True)[1]]
    face_material = material[nearest][new_faces[:, 0]].astype(np.int32)
    return VisualMesh(
        vertices=new.astype(np.float32),
        faces=new_faces.astype(np.int32),
        corner_uv=uv[nearest][new_faces].astype(np.float32),
        face_material=face_material,
        face_label=np.full(len(new_faces), -1, np.int32),
    )


def _patches(
    bundle: SceneBundle, mesh: VisualMesh, images: dict[str, bytes], chosen: Mask
) -> list[Patch]:
    """Return the chosen faces by material, each coloured by how it faces the light."""
    result = []
    for k in np.unique(mesh.face_material[chosen]):
        faces = np.flatnonzero(chosen & (mesh.face_material == k))
        material = bundle.materials[k]
        image = images.get(material.texture or "")
        normal = triangle_normals(mesh.vertices[mesh.faces[faces]])
        # Scans have the light of their room in their textures; too soft a shade to disturb it.
        shade = 0.82 + 0.1 * normal[:, 2] + 0.08 * np.abs(normal[:, 0])
        shade = np.repeat(np.round(16 * np.nan_to_num(shade, nan=0.8)) / 16, 3)
        uv = mesh.corner_uv[faces].reshape(-1, 2)
        keys = np.column_stack([mesh.faces[faces].ravel(), shade, *([] if image is None else [uv])])
        first, inverse = unique_rows(keys.astype(np.float64))
        linear = before_tone_mapping(np.asarray(material.base_color)) ** 2.2
        rgb = 255 * np.clip(shade[first, None] * linear, 0, 1)
        result.append(
            Patch(
                vertices=mesh.vertices[mesh.faces[faces].ravel()[first]].astype(np.float32),
                uv=np.column_stack([uv[first, 0], 1.0 - uv[first, 1]]).astype(np.float32),
                rgb=np.round(rgb).astype(np.uint8),
                faces=inverse.reshape(-1, 3).astype(np.uint32),
                image=image,
            )
        )
    return result


def _images(bundle: SceneBundle, detail: Detail, paths: set[str]) -> dict[str, bytes]:
    """Return textures as JPEGs that together have at most `detail.texels`."""
    pictures: dict[str, U8] = {}
    for path in sorted(paths):
        file = bundle.root / path
        raw = np.fromfile(file, dtype=np.uint8) if file.is_file() else np.empty(0, np.uint8)
        picture = cv2.imdecode(raw, cv2.IMREAD_COLOR) if len(raw) else None
        if picture is None:
            raise FileFormatError(file, "the texture is missing or damaged; repair the scene again")
        pictures[path] = picture.astype(np.uint8, copy=False)
    while pictures and sum(p.size // 3 for p in pictures.values()) > detail.texels:
        largest = max(pictures.values(), key=lambda p: p.size).size
        for path, picture in pictures.items():
            if picture.size == largest:
                half = tuple(max(1, side // 2) for side in picture.shape[1::-1])
                smaller = cv2.resize(picture, half, interpolation=cv2.INTER_AREA)
                pictures[path] = smaller.astype(np.uint8, copy=False)
    table = np.round(255 * before_tone_mapping(np.arange(256) / 255)).astype(np.uint8)
    how = [cv2.IMWRITE_JPEG_QUALITY, detail.quality]
    return {
        p: cv2.imencode(".jpg", cv2.LUT(i, table), how)[1].tobytes() for p, i in pictures.items()
    }


def before_tone_mapping(srgb: Floats) -> Floats:
    """Return the sRGB (0–1) whose `WHITE_GAIN`-fold the browser shows as `srgb`.

    three.js draws with ACES filmic tone mapping (its `tonemapping_pars_fragment.glsl.js`), which
    would wash colours out. Its curve is inverted as for grey; pure white is shown as 95 %.
    """
    y = SHOWN_WHITE * np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    a, b, c = 1 - 0.983729 * y, 0.0245786 - 0.4329510 * y, -0.000090537 - 0.238081 * y
    linear = 0.6 * (-b + np.sqrt(b * b - 4 * a * c)) / (2 * a) / WHITE_GAIN
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def _add_splats(api: SceneApi, bundle: SceneBundle, name: str, detail: Detail) -> SceneNodeHandle:
    cloud = load_splats(bundle.root)
    kept: NDArray[np.intp] = np.arange(len(cloud))
    if len(cloud) > detail.splats:
        weight = cloud.opacity * np.sort(cloud.scale, axis=1)[:, 1:].prod(axis=1)
        kept = np.argpartition(-weight, detail.splats)[: detail.splats]
        log.warning("%s: %d of %d splats shown", bundle.scene_id, detail.splats, len(cloud))
    axes = quat_to_matrix(cloud.quat_wxyz[kept]) * cloud.scale[kept][:, None, :]
    rgb: F32 = np.clip(0.5 + _BAND_0 * cloud.harmonics[kept, 0], 0, 1)
    return api.add_gaussian_splats(
        f"{name}/splats",
        centers=cloud.position[kept],
        covariances=axes @ axes.transpose(0, 2, 1),
        rgbs=rgb,
        opacities=cloud.opacity[kept, None],
    )
