"""A robot's links and visible shapes for MCAP files."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...formats.core.arrays import F32
from ...formats.core.rollout import Rollout
from ...formats.mcap.robot_links import CUBE, CYLINDER, SPHERE, TRIANGLES, LinkShape, RobotLinks
from .primitives import geom_surface
from .robot_body import geom_colors, visible_geoms

GEOM = mujoco.mjtGeom


def robot_links(model: mujoco.MjModel, rollout: Rollout, every: int) -> RobotLinks:
    """Return the links at every `every`-th sample of a rollout of the robot-alone `model`.

    Raises:
        ValueError: the model does not have exactly one free joint.
        KeyError: the model lacks a joint of the rollout.
    """
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    if len(free) != 1:
        raise ValueError(f"the robot model has {len(free)} free joints; valid: exactly one")
    shapes = body_shapes(model)
    bodies = list(shapes)
    joints = np.array(
        [model.jnt_qposadr[model.joint(name).id] for name in rollout.joint_names], np.int64
    )
    samples = np.arange(0, len(rollout.time_s), every)
    base = int(model.jnt_qposadr[free[0]])
    data = mujoco.MjData(model)
    # With the base at the origin, poses in the world are poses in the base.
    data.qpos[base : base + 7] = [0, 0, 0, 1, 0, 0, 0]
    position = np.empty((len(samples), len(bodies), 3))
    rotation = np.empty((len(samples), len(bodies), 4))
    for k, sample in enumerate(samples):
        data.qpos[joints] = rollout.joint_position_rad[sample]
        mujoco.mj_kinematics(model, data)
        position[k], rotation[k] = data.xpos[bodies], data.xquat[bodies]
    return RobotLinks(
        names=tuple(model.body(body).name for body in bodies),
        shapes=tuple(shapes.values()),
        time_s=rollout.time_s[samples],
        position_base_m=position,
        quat_wxyz=rotation,
    )


def body_shapes(model: mujoco.MjModel) -> dict[int, tuple[LinkShape, ...]]:
    """Return the visible shapes of each body that has some, by ascending id."""
    colors, shapes = geom_colors(model), dict[int, tuple[LinkShape, ...]]()
    for geom in visible_geoms(model):
        body = int(model.geom_bodyid[geom])
        own = _shapes(model, int(geom), colors[geom])
        shapes[body] = (*shapes.get(body, ()), *own)
    return dict(sorted(shapes.items()))


def _shapes(model: mujoco.MjModel, geom: int, rgba: F32) -> list[LinkShape]:
    position, quat = model.geom_pos[geom].copy(), model.geom_quat[geom].copy()
    size = model.geom_size[geom]
    red, green, blue, alpha = (float(v) for v in rgba)
    color = (red, green, blue, alpha)

    def shape(kind: str, extent: NDArray, *, at: NDArray = position) -> LinkShape:
        return LinkShape(kind, at, quat, np.asarray(extent, float), color)

    match model.geom_type[geom]:
        case GEOM.mjGEOM_BOX:
            return [shape(CUBE, 2 * size)]
        case GEOM.mjGEOM_SPHERE:
            return [shape(SPHERE, np.full(3, 2 * size[0]))]
        case GEOM.mjGEOM_ELLIPSOID:
            return [shape(SPHERE, 2 * size)]
        case GEOM.mjGEOM_CYLINDER:
            return [shape(CYLINDER, 2 * size[[0, 0, 1]])]
        case GEOM.mjGEOM_CAPSULE:
            axis = np.zeros(9)
            mujoco.mju_quat2Mat(axis, quat)
            along = size[1] * axis.reshape(3, 3)[:, 2]
            ball = np.full(3, 2 * size[0])
            ends = [shape(SPHERE, ball, at=position + sign * along) for sign in (-1, 1)]
            return [shape(CYLINDER, 2 * size[[0, 0, 1]]), *ends]
    corners, _ = geom_surface(model, geom)
    return [LinkShape(TRIANGLES, position, quat, np.ones(3), color, corners.astype(np.float64))]
