"""Free bodies pushed through the compiled collision of a level, and what they touch."""

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vlnpe.collectors.physics.level_model import build_level_model
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.scene.bundle import Obstacles, SceneBundle


def level_geoms(bundle: SceneBundle, level: int = 0, robot: str = "h1") -> mujoco.MjSpec:
    """The obstacles of a level as a robot's compiled model has them, without the robot."""
    model = build_level_model(bundle, level, get_robot(robot))
    spec = mujoco.MjSpec()
    for k in range(model.ngeom):
        if model.geom(k).name.startswith("obstacle_"):
            spec.worldbody.add_geom(
                name=model.geom(k).name,
                type=mujoco.mjtGeom.mjGEOM_BOX,
                pos=model.geom_pos[k],
                quat=model.geom_quat[k],
                size=model.geom_size[k],
            )
    return spec


def touched_on_the_way(
    spec: mujoco.MjSpec,
    start_xy_m: ArrayLike,
    end_xy_m: ArrayLike,
    size_m: tuple[float, float, float],
    bottom_m: float = 0.06,
    step_m: float = 0.01,
) -> list[tuple[str, NDArray[np.float64]]]:
    """Slide an upright box (length along the way, width, height) along a straight line.

    Returns:
        Each obstacle that it touched, with the box's position at the first touch.
    """
    start, end = np.asarray(start_xy_m, float), np.asarray(end_xy_m, float)
    body = spec.worldbody.add_body(name="mover")
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=np.array(size_m) / 2)
    model = spec.compile()
    spec.delete(body)
    data = mujoco.MjData(model)
    yaw = np.arctan2(*(end - start)[::-1])
    data.qpos[3:] = (np.cos(yaw / 2), 0, 0, np.sin(yaw / 2))
    found: dict[str, NDArray[np.float64]] = {}
    for t in np.linspace(0, 1, round(np.linalg.norm(end - start) / step_m) + 1):
        data.qpos[:3] = (*(start + t * (end - start)), bottom_m + size_m[2] / 2)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        for contact in data.contact[: data.ncon]:
            name = next(n for g in contact.geom if (n := model.geom(g).name))
            found.setdefault(name, data.qpos[:3].copy())
    return list(found.items())


def inside_boxes(
    obstacles: Obstacles, points: NDArray[np.float64], slack_m: float = 0.0
) -> NDArray[np.bool_]:
    """Return whether points (N, 3) lie in any box, or as near to one as the slack."""
    gap = np.abs(points[:, None, :] - obstacles.center_m) - obstacles.half_m
    return np.any(np.all(gap <= slack_m, axis=2), axis=1)
