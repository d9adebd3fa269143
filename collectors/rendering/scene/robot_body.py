"""The robot's own body for the renderer: tessellated once, posed per frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....formats.core.frames import OPTICAL_TO_OPENGL, matrix_to_quat
from ....formats.core.geometry import triangle_normals
from .primitives import geom_surface

# MuJoCo draws groups 0 to 2 by default; collision shapes are kept in 3 and above.
VISIBLE_GROUPS = 3


@dataclass(frozen=True)
class GeomSurface:
    """Triangles of one visible geom, in its own frame.

    Attributes:
        geom: id in the model.
        corners, normals: (F, 3, 3) float32 corner positions [m] and unit normals.
        plane: (F, 4) float64 unit face normal and its distance from the geom's origin [m].
        center_m, radius_m: bounding sphere.
        color_linear: (3,) float32.
    """

    geom: int
    corners: NDArray[np.float32]
    normals: NDArray[np.float32]
    plane: NDArray[np.float64]
    center_m: NDArray[np.float64]
    radius_m: float
    color_linear: NDArray[np.float32]

    def holds(self, point_m: NDArray[np.float64], margin_m: float) -> bool:
        """Whether a point (3,) in the geom's frame lies inside, up to a margin; convex geoms."""
        return bool((self.plane[:, :3] @ point_m < self.plane[:, 3] + margin_m).all())


@dataclass(frozen=True)
class RobotGeometryPose:
    """The body at one instant.

    Attributes:
        surfaces: the G geoms that are posed.
        position_world_m: (G, 3) of each geom [m].
        rotation_world: (G, 3, 3) geom to world.
    """

    surfaces: tuple[GeomSurface, ...]
    position_world_m: NDArray[np.float64]
    rotation_world: NDArray[np.float64]


def tessellate(model: mujoco.MjModel) -> tuple[GeomSurface, ...]:
    """Surfaces of a model's visible geoms (groups 0–2, not fully transparent).

    Geoms of the world body are the ground a robot-alone model may stand on, no part of the robot.
    """
    rgba = geom_colors(model)
    return tuple(_surface(model, int(geom), rgba[geom, :3]) for geom in visible_geoms(model))


def visible_geoms(model: mujoco.MjModel) -> NDArray[np.int64]:
    """Ids of the robot's geoms that are seen (groups 0–2, not fully transparent)."""
    seen = (model.geom_group < VISIBLE_GROUPS) & (geom_colors(model)[:, 3] > 0)
    seen &= model.geom_bodyid > 0
    return np.flatnonzero(seen)


def geom_colors(model: mujoco.MjModel) -> NDArray[np.float32]:
    """(G, 4) RGBA of each geom: its own, or its material's where it was given none."""
    own, material = model.geom_rgba, model.geom_matid
    unset = (material >= 0) & (own == np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)).all(axis=1)
    rgba = own.copy()
    rgba[unset] = model.mat_rgba[material[unset]]
    return rgba


def _surface(model: mujoco.MjModel, geom: int, color: NDArray[np.float32]) -> GeomSurface:
    corners, normals = geom_surface(model, geom)
    face_normal = triangle_normals(corners)
    center = 0.5 * (corners.min((0, 1)) + corners.max((0, 1)))
    return GeomSurface(
        geom=geom,
        corners=corners.astype(np.float32),
        normals=normals.astype(np.float32),
        plane=np.column_stack([face_normal, np.einsum("fi,fi->f", face_normal, corners[:, 0])]),
        center_m=center,
        radius_m=float(np.linalg.norm(corners - center, axis=-1).max()),
        color_linear=color.astype(np.float32),
    )


class RobotBody:
    """A robot-alone model, posed by recorded states through MuJoCo's kinematics."""

    def __init__(self, model: mujoco.MjModel, joint_names: Sequence[str]):
        """Prepare `model`, which has one free joint and the named hinge or slide joints.

        Raises:
            ValueError: not exactly one free joint, or a name the model does not have.
        """
        free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        if len(free) != 1:
            raise ValueError(f"the robot model has {len(free)} free joints; valid: exactly one")
        known = {model.joint(j).name: j for j in range(model.njnt)}
        missing = sorted(set(joint_names) - set(known))
        if missing:
            raise ValueError(f"joints {missing} are not in the model; valid: {sorted(known)}")
        self.model = model
        self.surfaces = tessellate(model)
        self._geoms = np.array([s.geom for s in self.surfaces], dtype=np.int64)
        self._data = mujoco.MjData(model)
        self._base = int(model.jnt_qposadr[free[0]])
        self._joints = np.array(
            [model.jnt_qposadr[known[name]] for name in joint_names], dtype=np.int64
        )

    def pose(
        self, position_world_m: ArrayLike, quat_wxyz: ArrayLike, joint_position: ArrayLike
    ) -> RobotGeometryPose:
        """Place the base (3,), (4,) and the joints (J,) [rad or m]."""
        self._move(position_world_m, quat_wxyz, joint_position)
        return RobotGeometryPose(
            self.surfaces,
            self._data.geom_xpos[self._geoms].copy(),
            self._data.geom_xmat[self._geoms].reshape(-1, 3, 3).copy(),
        )

    def camera_pose(
        self,
        camera: str,
        position_world_m: ArrayLike,
        quat_wxyz: ArrayLike,
        joint_position: ArrayLike,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Position (3,) [m] and optical-frame quaternion (4,) of the model's camera."""
        self._move(position_world_m, quat_wxyz, joint_position)
        index = self.model.camera(camera).id
        rotation = self._data.cam_xmat[index].reshape(3, 3) @ OPTICAL_TO_OPENGL
        return self._data.cam_xpos[index].copy(), matrix_to_quat(rotation)

    def _move(self, position: ArrayLike, quat: ArrayLike, joints: ArrayLike) -> None:
        qpos = self._data.qpos
        qpos[self._base : self._base + 3] = position
        qpos[self._base + 3 : self._base + 7] = quat
        qpos[self._joints] = joints
        mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_camlight(self.model, self._data)
