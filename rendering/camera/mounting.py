"""The robot's body with its camera on a rig."""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from ...collectors.robots import RobotSpec
from ...formats.core.arrays import Array
from ...formats.core.frames import OPTICAL_TO_OPENGL, quat_to_yaw, yaw_to_quat
from ..scene.robot_body import RobotBody
from .rigs import Rig


class MountedBody(RobotBody):
    """A robot's body whose camera is on a rig, or where the robot has it.

    A rig is on the vertical through the lens of the robot's own camera in its default pose, and
    fixed to the same body, so that it sways with the gait.
    """

    def __init__(self, robot: RobotSpec, joint_names: Sequence[str], rig: Rig | None) -> None:
        """Mount the camera; None leaves it where it is."""
        super().__init__(robot.build_model(floor=False), joint_names)
        self._robot, self._rig = robot, rig
        if rig is not None:
            self._mount(rig)

    def eye(
        self, position_world_m: ArrayLike, quat_wxyz: ArrayLike, joint_position: ArrayLike
    ) -> tuple[Array, Array]:
        """Return position (3,) [m] and optical-frame quaternion (4,) of the camera.

        A level rig is carried as if the robot stood upright where its base is.
        """
        robot = self._robot
        if self._rig is not None and self._rig.level:
            quat_wxyz = yaw_to_quat(float(quat_to_yaw(np.asarray(quat_wxyz))))
            joint_position = robot.default_joint_rad
        return self.camera_pose(robot.camera.name, position_world_m, quat_wxyz, joint_position)

    def _mount(self, rig: Rig) -> None:
        robot, model = self._robot, self.model
        lens = _standing_lens(self, robot)
        carrier_position, carrier = self.carrier_pose(robot.camera.name)
        pitch = np.deg2rad(rig.pitch_down_deg)
        right, down = np.array([0.0, -1.0, 0.0]), np.array([-np.sin(pitch), 0.0, -np.cos(pitch)])
        optical = np.column_stack([right, down, np.cross(right, down)])
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, (carrier.T @ optical @ OPTICAL_TO_OPENGL.T).ravel())
        camera = model.camera(robot.camera.name).id
        model.cam_pos[camera] = carrier.T @ (np.array([*lens[:2], rig.height_m]) - carrier_position)
        model.cam_quat[camera] = quat


def own_rig(robot: RobotSpec) -> Rig:
    """Return height, to the millimetre, and pitch of a robot's own camera."""
    lens = _standing_lens(RobotBody(robot.build_model(floor=False), robot.joint_names), robot)
    return Rig(round(float(lens[2]), 3), robot.camera.pitch_down_deg)


def _standing_lens(body: RobotBody, robot: RobotSpec) -> Array:
    base = (0.0, 0.0, robot.base_height_m)
    return body.camera_pose(robot.camera.name, base, yaw_to_quat(0.0), robot.default_joint_rad)[0]
