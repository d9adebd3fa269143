"""Triangles and textures as MuJoCo models for drawing only."""

from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np

from ...formats.core.arrays import F32, I64, U8, Array
from ...formats.core.geometry import triangle_cross
from ...formats.scene.bundle import VisualMesh
from ..kernels.data import TexturePack
from ..kernels.srgb import to_srgb
from ..scene.robot_body import GeomSurface
from ..scene.textures import MaterialTable

CHUNK_M = 2.0  # width of the pieces that are culled when out of view
MIN_AREA_M2 = 1e-10  # MuJoCo rejects smaller meshes, and they are invisible
MIN_VERTICES = 4
EMISSION = 0.7  # MuJoCo adds 0.3 of a colour where there is no light source


@dataclass(frozen=True)
class Pieces:
    """A model whose G geoms make up a scene.

    Attributes:
        corners_m: (G, 8, 3) corners of each geom's box, world [m].
        material: (G,) material of each geom.
        textures: mip levels of each texture of the model: (H, W, 3) uint8 sRGB, top row first.
    """

    model: mujoco.MjModel
    corners_m: Array
    material: I64
    textures: list[list[U8]]


def scene_pieces(mesh: VisualMesh, materials: MaterialTable) -> Pieces:
    """Split a mesh by position and material. The model's textures are empty, see `Pieces.textures`.

    Materials emit their colour, so that a drawing shows the surfaces' own colours.
    """
    spec = _spec()
    textures = _add_materials(spec, materials)
    corner = mesh.vertices[mesh.faces].astype(np.float64)
    area = np.linalg.norm(triangle_cross(corner), axis=-1)
    cell = np.floor((corner.mean(1) - mesh.vertices.min(0)) / CHUNK_M).astype(np.int64)
    key = (cell @ np.array([1, 1000, 1_000_000])) * len(materials.texture) + mesh.face_material
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    boxes, used = [], []
    for faces in np.split(order, starts[1:]):
        if area[faces].sum() < MIN_AREA_M2:
            continue
        material = int(mesh.face_material[faces[0]])
        name = f"piece{len(used)}"
        uv = mesh.corner_uv[faces] if materials.texture[material] >= 0 else None
        _add_mesh(spec, name, corner[faces], uv)
        _add_geom(spec, name, material=f"material{material}")
        points = corner[faces].reshape(-1, 3)
        boxes.append([points.min(0), points.max(0)])
        used.append(material)
    bounds = np.array(boxes)
    signs = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    corners = np.where(signs, bounds[:, 1:], bounds[:, :1])
    return Pieces(spec.compile(), corners, np.array(used), textures)


def robot_model(surfaces: Iterable[GeomSurface]) -> mujoco.MjModel:
    """Return a model for drawing with one geom per surface, in their order."""
    spec = _spec()
    for k, surface in enumerate(surfaces):
        name = f"part{k}"
        _add_mesh(spec, name, surface.corners.astype(np.float64), None)
        material = spec.add_material(name=name, emission=EMISSION, specular=0.0, shininess=0.0)
        material.rgba = [*to_srgb(surface.color_linear), 1.0]
        _add_geom(spec, name, material=name)
    return spec.compile()


def _spec() -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.visual.quality.offsamples = 0  # so that a pixel's depth is that of its centre
    spec.visual.quality.shadowsize = 0
    spec.visual.headlight.active = 0
    return spec


def _add_mesh(
    spec: mujoco.MjSpec,
    name: str,
    corners: Array,
    uv: F32 | None,
) -> None:
    """Add triangles (F, 3, 3) with texture coordinates (F, 3, 2)."""
    vertices = corners.reshape(-1, 3)
    faces = np.arange(len(vertices), dtype=np.int32)
    if len(vertices) < MIN_VERTICES:
        vertices = np.concatenate([vertices, vertices[:1]])
    mesh = spec.add_mesh(name=name)
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # scans are not closed solids
    mesh.uservert = vertices.astype(np.float32).ravel()
    mesh.userface = faces
    if uv is not None:
        turned = uv.reshape(-1, 2).copy()
        turned[:, 1] = 1.0 - turned[:, 1]  # MuJoCo's v points down
        mesh.usertexcoord = turned.astype(np.float32).ravel()
        mesh.userfacetexcoord = faces


def _add_geom(spec: mujoco.MjSpec, mesh: str, *, material: str) -> None:
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh, material=material, contype=0, conaffinity=0
    )


def _add_materials(spec: mujoco.MjSpec, materials: MaterialTable) -> list[list[U8]]:
    """Add all materials, and a 1 × 1 texture for each pair of texture and base colour.

    Returns:
        Mip levels of those textures.
    """
    pyramids, index = [], {}
    for m, (texture, base) in enumerate(zip(materials.texture, materials.base_linear, strict=True)):
        material = spec.add_material(
            name=f"material{m}", emission=EMISSION, specular=0.0, shininess=0.0
        )
        if texture < 0:
            material.rgba = [*to_srgb(base), 1.0]
            continue
        key = (int(texture), *base.tolist())
        if key not in index:
            index[key] = f"texture{len(pyramids)}"
            image = spec.add_texture(name=index[key], type=mujoco.mjtTexture.mjTEXTURE_2D)
            image.width = image.height = 1
            image.nchannel = 3
            image.data = bytes(3)
            pyramids.append(_pyramid(materials.pack, int(texture), base))
        material.rgba = [1.0, 1.0, 1.0, 1.0]
        material.textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = index[key]
    return pyramids


def _pyramid(pack: TexturePack, texture: int, base_linear: F32) -> list[U8]:
    levels = []
    roots = np.arange(1024) / 1023.0
    tables = [np.round(255 * to_srgb(roots**2 * base)).astype(np.uint8) for base in base_linear]
    for level in range(pack.levels[texture]):
        texels = pack.level(texture, level)
        channels = [
            tables[k][(texels >> np.uint32(shift)) & np.uint32(1023)]
            for k, shift in enumerate((0, 10, 20))
        ]
        levels.append(np.stack(channels, axis=-1))
    return levels
