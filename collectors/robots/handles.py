"""Addresses of a robot's state in a compiled model, alone or attached under any prefix."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...formats.core.arrays import Array
from ...formats.core.errors import InputError
from .spec import RobotSpec


@dataclass(frozen=True)
class RobotHandles:
    """Addresses of one robot in a model's arrays.

    Attributes:
        prefix: prefix that the scene put before every name of the robot.
        root_qpos, root_dof: first index of the floating base in qpos and qvel.
        joint_qpos, joint_dof: (J,) indices of the actuated joints in qpos and qvel.
        actuators: (J,) indices of their servos in ctrl and actuator_force.
        bodies: ids of all bodies of the robot.
        sole_geoms: (F, S) ids of each foot's spheres (for a wheel, its tyre).
        sole_radius_m: (F, S) distance from each centre to its lowest point when upright [m].
        foot_touch: (F,) addresses of the foot touch sensors in sensordata [N].
        gyro, accelerometer: first address of each 3-vector in sensordata.
        camera: id of the ego camera.
    """

    robot: RobotSpec
    prefix: str
    root_qpos: int
    root_dof: int
    joint_qpos: NDArray[np.intp]
    joint_dof: NDArray[np.intp]
    actuators: NDArray[np.intp]
    root_body: int
    bodies: frozenset[int]
    sole_geoms: NDArray[np.intp]
    sole_radius_m: Array
    foot_touch: NDArray[np.intp]
    gyro: int
    accelerometer: int
    camera: int

    @classmethod
    def find(cls, robot: RobotSpec, model: mujoco.MjModel) -> "RobotHandles":
        """Find `robot` in `model` by its names, under any prefix it was attached with.

        Raises:
            InputError: the robot is not in the model, or more than once.
        """
        names = [model.joint(i).name for i in range(model.njnt)]
        roots = [n for n in names if n == robot.root_joint or n.endswith("/" + robot.root_joint)]
        if len(roots) != 1:
            raise InputError(
                f"the model contains robot {robot.name} {len(roots)} times; valid: once, with "
                "its own names or under a prefix that ends in '/'"
            )
        prefix = roots[0].removesuffix(robot.root_joint)
        joints = [model.joint(prefix + name) for name in robot.joint_names]
        root_body = model.body(prefix + robot.root_body).id
        soles = np.array(
            [[model.geom(prefix + name).id for name in foot.soles] for foot in robot.feet]
        )
        return cls(
            robot=robot,
            prefix=prefix,
            root_qpos=int(model.joint(roots[0]).qposadr[0]),
            root_dof=int(model.joint(roots[0]).dofadr[0]),
            # The dtype is explicit because an agent without joints has empty lists.
            joint_qpos=np.array([joint.qposadr[0] for joint in joints], dtype=np.intp),
            joint_dof=np.array([joint.dofadr[0] for joint in joints], dtype=np.intp),
            actuators=np.array(
                [model.actuator(prefix + name).id for name in robot.joint_names], dtype=np.intp
            ),
            root_body=root_body,
            bodies=frozenset(
                int(i) for i in np.flatnonzero(model.body_rootid == model.body_rootid[root_body])
            ),
            sole_geoms=soles,
            sole_radius_m=sole_radius_m(model, soles),
            foot_touch=np.array(
                [model.sensor(f"{prefix}{name}_touch").adr[0] for name in robot.foot_names]
            ),
            gyro=int(model.sensor(prefix + "gyro").adr[0]),
            accelerometer=int(model.sensor(prefix + "accelerometer").adr[0]),
            camera=model.camera(prefix + robot.camera.name).id,
        )

    def spawn(
        self,
        data: mujoco.MjData,
        *,
        x_m: float = 0.0,
        y_m: float = 0.0,
        floor_z_m: float = 0.0,
        yaw_rad: float = 0.0,
    ) -> None:
        """Place the robot at rest in its default pose on the floor; the only write to qpos/qvel."""
        q = self.root_qpos
        data.qpos[q : q + 3] = x_m, y_m, floor_z_m + self.robot.spawn_height_m
        data.qpos[q + 3 : q + 7] = np.cos(0.5 * yaw_rad), 0.0, 0.0, np.sin(0.5 * yaw_rad)
        data.qvel[self.root_dof : self.root_dof + 6] = 0.0
        data.qpos[self.joint_qpos] = self.robot.default_joint_rad
        data.qvel[self.joint_dof] = 0.0
        data.ctrl[self.actuators] = self.robot.default_joint_rad

    def com_to_foot_m(self, data: mujoco.MjData) -> float:
        """Return the height of the centre of mass above the lowest foot's contact point [m]."""
        lowest = data.geom_xpos[self.sole_geoms, 2] - self.sole_radius_m
        return float(data.subtree_com[self.root_body, 2] - lowest.min())


def sole_radius_m(model: mujoco.MjModel, geoms: NDArray[np.intp]) -> Array:
    """Return the radius [m] of spheres and lying cylinders; of ellipsoids the largest half axis."""
    cylinder = model.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_CYLINDER
    return np.where(cylinder, model.geom_size[geoms, 0], model.geom_rbound[geoms])
