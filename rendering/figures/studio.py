"""The studio for portraits: a large floor with a grid that fades into the background."""

import math
import tempfile
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from ...collectors.robots import RobotSpec
from ...formats.core.arrays import U8
from ...formats.scene.bundle import Material, SceneBundle, VisualMesh, save_bundle
from ..embree import SceneRenderer
from .portraits import StandingRobot

Picture = U8

FLOOR_M, FLOOR_PX = 16.0, 2048  # side of the floor for a robot about a metre tall
NEAR_SRGB, FAR_SRGB, TOP_SRGB = (238, 238, 236), (205, 211, 219), (168, 178, 191)


def make_studio(robot: RobotSpec) -> SceneRenderer:
    """Return a renderer of an empty studio for a robot.

    The lines on its floor are 1 m and 0.25 m apart; for a robot the size of a toy a tenth of that.
    """
    scale = 10.0 ** round(math.log10(StandingRobot.of(robot).height_m))
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        Image.fromarray(_floor_picture()).save(root / "floor.png")
        Image.fromarray(_sky_picture()).save(root / "sky.png")
        bundle = SceneBundle(
            root=root,
            scene_id="studio",
            source={},
            source_to_world=np.eye(4),
            habitat_to_world=np.eye(4),
            materials=(
                Material("floor", (1.0, 1.0, 1.0), "floor.png"),
                Material("sky", (1.0, 1.0, 1.0), "sky.png"),
            ),
            labels=("studio",),
            objects=(),
            level_floor_z_m=(0.0,),
        )
        save_bundle(bundle, _mesh(scale), [])
        return SceneRenderer(bundle)


def _floor_picture() -> Picture:
    """Return the floor: bright in the middle, with lines, the background's colour at the rim."""
    meters = (np.arange(FLOOR_PX, dtype=np.float32) + 0.5) / FLOOR_PX * FLOOR_M - 0.5 * FLOOR_M
    distance = np.hypot(meters[:, None], meters[None])
    fade = np.clip((distance - 0.8) / (0.42 * FLOOR_M - 0.8), 0.0, 1.0)[..., None] ** 0.8
    near, far = (np.array(color, dtype=np.float32) for color in (NEAR_SRGB, FAR_SRGB))
    color = near + fade * (far - near)
    for spacing, width, depth in ((0.25, 0.010, 9.0), (1.0, 0.016, 15.0)):
        off = np.abs((meters + 0.5 * spacing) % spacing - 0.5 * spacing)
        line = np.clip(1.3 - off / (0.5 * width), 0.0, 1.0)
        color -= depth * (1 - fade) * np.maximum(line[:, None], line[None])[..., None]
    return np.round(color).astype(np.uint8)


def _sky_picture() -> Picture:
    """Return the background in rows: the colour of the floor's rim below, darker above."""
    share = np.linspace(1.0, 0.0, 256)[:, None, None] ** 0.7
    rows = (1 - share) * np.array(FAR_SRGB) + share * np.array(TOP_SRGB)
    return np.round(np.repeat(rows, 8, axis=1)).astype(np.uint8)


def _mesh(scale: float) -> VisualMesh:
    """Return a square floor inside a high cylindrical wall."""
    side = scale * FLOOR_M
    half = 0.5 * side
    corners = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    floor = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)
    wall = trimesh.creation.cylinder(0.99 * half, 2 * half, sections=96)
    wall.update_faces(np.abs(wall.face_normals[:, 2]) < 0.5)
    wall.apply_translation([0.0, 0.0, half - 0.001 * scale])
    vertices = np.concatenate([floor.vertices, wall.vertices])
    faces = np.concatenate([floor.faces, wall.faces + len(floor.vertices)])
    corner = vertices[faces]
    uv = corner[..., :2] / side + 0.5
    uv[2:, :, 0], uv[2:, :, 1] = 0.5, np.clip(corner[2:, :, 2] / (2 * half), 0.01, 0.99)
    material = np.where(np.arange(len(faces)) < 2, 0, 1)
    return VisualMesh(
        vertices=vertices.astype(np.float32),
        faces=faces.astype(np.int32),
        corner_uv=uv.astype(np.float32),
        face_material=material.astype(np.int32),
        face_label=np.zeros(len(faces), dtype=np.int32),
    )
