"""Tiny scenes and robots for rendering tests: one textured wall, one ball on a free joint."""

from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.frames import OPTICAL_IN_BODY, matrix_to_quat
from vlnpe.formats.scene.bundle import (
    Floor,
    Material,
    Obstacles,
    SceneBundle,
    VisualMesh,
    load_bundle,
    save_bundle,
)
from vlnpe.formats.scene.freemap import Freemap
from vlnpe.formats.scene.grid import GridSpec

SQUARE = CameraModel("test", 128, 128, 90.0)


def facing(yaw_rad: float, pitch_down_rad: float = 0.0) -> NDArray[np.float64]:
    """Optical quaternion of a level camera with this heading, tilted down."""
    cy, sy, cp, sp = (
        np.cos(yaw_rad),
        np.sin(yaw_rad),
        np.cos(pitch_down_rad),
        np.sin(pitch_down_rad),
    )
    yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    return matrix_to_quat(yaw @ pitch @ OPTICAL_IN_BODY)


def write_wall(root: Path, image: NDArray[np.uint8], repeat: float = 1.0) -> SceneBundle:
    """A 2 × 2 m wall at x = 2, y −1…1, z 0…2, its texture seen upright from the origin side.

    Seen along +x, the left of the image lies at y = +1. `repeat` times across and up.
    """
    vertices = np.array([[2, 1, 0], [2, -1, 0], [2, -1, 2], [2, 1, 2]], dtype=np.float32)
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32) * repeat
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    mesh = VisualMesh(vertices, faces, uv[faces], np.zeros(2, np.int32), np.zeros(2, np.int32))
    return _write_bundle(
        root, mesh, (Material("wall", (1.0, 1.0, 1.0), "textures/wall.png"),), image
    )


def write_covered_floor(root: Path, image: NDArray[np.uint8]) -> SceneBundle:
    """A textured floor, 4 × 4 m around the origin, under a plain grey ceiling at z = 2."""
    square = np.array([[-2, -2], [2, -2], [2, 2], [-2, 2]], dtype=np.float32)
    vertices = np.concatenate([np.insert(square, 2, z, axis=1) for z in (0, 2)])
    uv = np.tile((square + 2) / 4, (2, 1)).astype(np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]], dtype=np.int32)
    material = np.array([0, 0, 1, 1], dtype=np.int32)
    mesh = VisualMesh(vertices, faces, uv[faces], material, np.zeros(4, np.int32))
    materials = (
        Material("floor", (1.0, 1.0, 1.0), "textures/wall.png"),
        Material("ceiling", (0.5, 0.5, 0.5), None),
    )
    return _write_bundle(root, mesh, materials, image)


def _write_bundle(
    root: Path, mesh: VisualMesh, materials: tuple[Material, ...], image: NDArray[np.uint8]
) -> SceneBundle:
    (root / "textures").mkdir(parents=True, exist_ok=True)
    Image.fromarray(image).save(root / "textures" / "wall.png")
    grid = GridSpec((-2.0, -2.0), 0.5, 8, 8)
    flat = np.zeros(grid.shape, dtype=np.float32)
    everywhere = np.ones(grid.shape, dtype=bool)
    bundle = SceneBundle(
        root=root,
        scene_id="wall",
        source={"path": "wall", "sha256": "0" * 64, "licence": "Apache-2.0"},
        source_to_world=np.eye(4),
        habitat_to_world=np.eye(4),
        materials=materials,
        labels=("wall",),
        objects=(),
        level_floor_z_m=(0.0,),
    )
    boxes = Obstacles(np.zeros((0, 3)), np.zeros((0, 3)))
    save_bundle(
        bundle, mesh, [(Floor(grid, flat, everywhere), boxes, Freemap(grid, flat, everywhere))]
    )
    return load_bundle(root)


def ball_robot(radius_m: float = 0.2) -> mujoco.MjModel:
    """One red ball on a free joint, with an invisible collision shell and a hinge."""
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><geom type="plane" size="0 0 1"/>
        <body name="base"><freejoint name="root"/>
          <geom type="sphere" size="{radius_m}" rgba="1 0 0 1" mass="1"/>
          <geom type="sphere" size="{2 * radius_m}" rgba="0 1 0 1" group="3" mass="0"/>
          <body><joint name="hinge" axis="0 0 1"/>
            <geom type="box" size="0.01 0.01 0.01" rgba="0 0 1 0" mass="0.1"/></body>
        </body></worldbody></mujoco>"""
    )
