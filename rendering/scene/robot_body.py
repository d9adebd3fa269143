"""A robot's body for the renderers: tessellated once, posed per frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from ...formats.core.arrays import F32, I64, Array
from ...formats.core.frames import OPTICAL_TO_OPENGL, matrix_to_quat
from ...formats.core.geometry import triangle_normals
from .primitives import geom_surface

# MuJoCo draws groups 0 to 2 by default; collision shapes are kept in 3 and above.
VISIBLE_GROUPS = 3


@dataclass(frozen=True)
class GeomSurface:
    """Triangles of one visible geom, in its own frame.

    Attributes:
        geom: id of the geom in the model.
        corners, normals: (F, 3, 3) float32 corner positions [m] and unit normals.
        plane: (F, 4) float64 unit face normal and its distance from the geom's origin [m].
        center_m, radius_m: bounding sphere [m].
        color_linear: (3,) float32 linear RGB.
    """

    geom: int
    corners: F32
    normals: F32
    plane: Array
    center_m: Array
    radius_m: float
    color_linear: F32

    def holds(self, point_m: Array, margin_m: float) -> bool:
        """Return whether a point (3,) in the frame of a convex geom lies inside, up to a margin."""
        return bool((self.plane[:, :3] @ point_m < self.plane[:, 3] + margin_m).all())


@dataclass(frozen=True)
class RobotGeometryPose:
    """A robot's body in one pose.

    Attributes:
        surfaces: surfaces of the G geoms.
        position_world_m: (G, 3) position of each geom [m].
        rotation_world: (G, 3, 3) rotation of each geom to world.
    """

    surfaces: tuple[GeomSurface, ...]
    position_world_m: Array
    rotation_world: Array


def tessellate(model: mujoco.MjModel) -> tuple[GeomSurface, ...]:
    """Return the surfaces of a model's visible geoms; see `visible_geoms`."""
    rgba = geom_colors(model)
    return tuple(_surface(model, int(geom), rgba[geom, :3]) for geom in visible_geoms(model))


def visible_geoms(model: mujoco.MjModel) -> I64:
    """Return the ids of the robot's visible geoms: groups 0–2, not fully transparent.

    Geoms of the world body are the floor that a robot-alone model may have, no part of the robot.
    """
    seen = (model.geom_group < VISIBLE_GROUPS) & (geom_colors(model)[:, 3] > 0)
    seen &= model.geom_bodyid > 0
    return np.flatnonzero(seen)


def geom_colors(model: mujoco.MjModel) -> F32:
    """Return the RGBA (G, 4) of each geom: its own, or its material's where it has none."""
    own, material = model.geom_rgba, model.geom_matid
    unset = (material >= 0) & (own == np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)).all(axis=1)
    rgba = own.copy()
    rgba[unset] = model.mat_rgba[material[unset]]
    return rgba


def _surface(model: mujoco.MjModel, geom: int, color: F32) -> GeomSurface:
    corners, normals = geom_surface(model, geom)
    face_normal = triangle_normals(corners).astype(np.float64)
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


def bounding_boxes(surfaces: Sequence[GeomSurface]) -> Array:
    """Return the corners (G, 8, 3) [m] of each geom's box in its own frame.

    Corners are numbered by the bits x, y, z, x the highest.
    """
    signs = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    bounds = [(c.min(0), c.max(0)) for c in (s.corners.reshape(-1, 3) for s in surfaces)]
    boxes = [np.where(signs, high, low) for low, high in bounds]
    return np.array(boxes, dtype=np.float64).reshape(-1, 8, 3)


class RobotBody:
    """A robot-alone model, posed from recorded states by MuJoCo's kinematics."""

    def __init__(self, model: mujoco.MjModel, joint_names: Sequence[str]):
        """Prepare a model with one free joint and the named hinge or slide joints.

        Raises:
            ValueError: the model does not have exactly one free joint, or lacks a named joint.
        """
        free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        if len(free) != 1:
            raise ValueError(f"the robot model has {len(free)} free joints; valid: exactly one")
        joints = {model.joint(j).name: j for j in range(model.njnt)}
        missing = sorted(set(joint_names) - set(joints))
        if missing:
            raise ValueError(f"joints {missing} are not in the model; valid: {sorted(joints)}")
        self.model = model
        self.surfaces = tessellate(model)
        self._geoms = np.array([s.geom for s in self.surfaces], dtype=np.int64)
        self._data = mujoco.MjData(model)
        self._base = int(model.jnt_qposadr[free[0]])
        self._joints = np.array(
            [model.jnt_qposadr[joints[name]] for name in joint_names], dtype=np.int64
        )

    def pose(
        self, position_world_m: ArrayLike, quat_wxyz: ArrayLike, joint_position: ArrayLike
    ) -> RobotGeometryPose:
        """Return the body with its base at (3,) [m], (4,) and its joints at (J,) [rad or m]."""
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
    ) -> tuple[Array, Array]:
        """Return position (3,) [m] and optical-frame quaternion (4,) of a camera of the model."""
        self._move(position_world_m, quat_wxyz, joint_position)
        index = self.model.camera(camera).id
        rotation = self._data.cam_xmat[index].reshape(3, 3) @ OPTICAL_TO_OPENGL
        return self._data.cam_xpos[index].copy(), matrix_to_quat(rotation)

    def carrier_pose(self, camera: str) -> tuple[Array, Array]:
        """Return position (3,) [m] and rotation (3, 3) of the body that carries a camera.

        It is that of the last `pose` or `camera_pose`.
        """
        carrier = self._data.body(int(self.model.camera(camera).bodyid[0]))
        return carrier.xpos.copy(), carrier.xmat.reshape(3, 3).copy()

    def _move(self, position: ArrayLike, quat: ArrayLike, joints: ArrayLike) -> None:
        qpos = self._data.qpos
        qpos[self._base : self._base + 3] = position
        qpos[self._base + 3 : self._base + 7] = quat
        qpos[self._joints] = joints
        mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_camlight(self.model, self._data)
