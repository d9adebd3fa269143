"""A light in a scene: what can be computed once, independently of the camera."""

import numpy as np
from numpy.typing import ArrayLike

from ...formats.core.arrays import Array
from ...formats.core.frames import quat_to_matrix
from ...formats.scene.bundle import SceneBundle, VisualMesh
from ...geometry.rays.packets import PacketScene
from ..kernels.cube_grid import CubeGrid, constant_grid, filled
from ..kernels.data import LightArrays
from .lights import Light
from .openness import trace_openness
from .panels import place_panels, trace_panels


def light_arrays(
    light: Light, bundle: SceneBundle, mesh: VisualMesh, scene: PacketScene, any_shaded: bool
) -> LightArrays:
    """Return the light of a scene as arrays, with openness or irradiance traced.

    Args:
        bundle: the scene, for the heights of its floors.
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
    pose: tuple[ArrayLike, ArrayLike],
    *,
    apart: bool,
) -> LightArrays:
    """Return `arrays` with the lamp placed.

    Args:
        strength: of the lamp; 0 = no lamp.
        pose: position (3,) [m] and optical quaternion (4,) of the lamp in the world.
        apart: whether that is not the eye's pose.
    """
    if strength <= 0.0:
        return arrays
    position, quat = pose
    lamp = np.array([*np.asarray(position), *quat_to_matrix(quat)[:, 2], strength, 0.0])
    return arrays._replace(lamp=lamp.astype(np.float32), lamp_apart=apart)


def _grid(light: Light, bundle: SceneBundle, mesh: VisualMesh, scene: PacketScene) -> CubeGrid:
    openness = trace_openness(scene, mesh.vertices)
    if not light.relit:
        return openness.grid
    around = light.around * openness.free
    if light.panels <= 0.0:
        return filled(openness.grid, around, max(light.around, 1e-6))
    floors: Array = np.asarray(bundle.level_floor_z_m, dtype=np.float64)
    panels = trace_panels(scene, openness, place_panels(scene, mesh.vertices, floors))
    value = panels.cube[..., :6] * (panels.scale * np.float32(light.panels)) + around
    return filled(openness.grid, value, float(value.max()))
