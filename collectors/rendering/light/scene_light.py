"""A light in a scene: the part of it that can be precomputed independently of the camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....formats.core.frames import quat_to_matrix
from ....formats.scene.bundle import SceneBundle, VisualMesh
from ..kernels.data import LightArrays
from ..kernels.packets import PacketScene
from .cube_grid import CubeGrid, constant_grid, filled
from .lights import Light
from .openness import trace_openness
from .panels import place_panels, trace_panels


def light_arrays(
    light: Light, bundle: SceneBundle, mesh: VisualMesh, scene: PacketScene, any_shaded: bool
) -> LightArrays:
    """Trace what a light needs to know of a scene.

    Args:
        light: which.
        bundle: the scene, for the heights of its floors.
        mesh: its triangles.
        scene: their ray structure.
        any_shaded: whether any material is lit at all.
    """
    grid = constant_grid(1.0)
    if any_shaded:
        grid = _grid(light, bundle, mesh, scene)
    lamp = np.zeros(8, dtype=np.float32)
    return LightArrays(light.parameters(), light.relit, grid, lamp, False)


def with_lamp(
    arrays: LightArrays,
    strength: float,
    eye_world_m: ArrayLike,
    quat_wxyz: ArrayLike,
    lamp_pose: tuple[ArrayLike, ArrayLike] | None,
) -> LightArrays:
    """`arrays` with the lamp at its pose (position, optical quaternion), or at the eye's."""
    if strength <= 0.0:
        return arrays
    position, quat = (eye_world_m, quat_wxyz) if lamp_pose is None else lamp_pose
    lamp = np.array([*np.asarray(position), *quat_to_matrix(quat)[:, 2], strength, 0.0])
    return arrays._replace(lamp=lamp.astype(np.float32), lamp_apart=lamp_pose is not None)


def _grid(light: Light, bundle: SceneBundle, mesh: VisualMesh, scene: PacketScene) -> CubeGrid:
    openness = trace_openness(scene, mesh.vertices)
    if not light.relit:
        return openness.grid
    around = light.around * openness.free
    if light.panels <= 0.0:
        return filled(openness.grid, around, max(light.around, 1e-6))
    floors: NDArray[np.float64] = np.asarray(bundle.level_floor_z_m, dtype=np.float64)
    panels = trace_panels(scene, openness, place_panels(scene, mesh.vertices, floors))
    value = panels.cube * (panels.scale * np.float32(light.panels)) + around
    return filled(openness.grid, value, float(value.max()))
