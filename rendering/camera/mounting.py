"""The robot's body with its camera where a view wants it."""

from collections.abc import Sequence

import mujoco
import numpy as np

from ...collectors.robots import RobotSpec
from ...formats.core.frames import OPTICAL_TO_OPENGL, yaw_to_quat
from ..scene.robot_body import RobotBody
from .views import View


def body_for(robot: RobotSpec, joint_names: Sequence[str], view: View) -> RobotBody:
    """Return the robot's body for a view, its camera moved and tilted as an ego view asks.

    The camera stays fixed to its body of the robot, so that it sways with the gait. Height and
    pitch hold for the robot standing in its default pose.
    """
    body = RobotBody(robot.build_model(floor=False), joint_names)
    if view.kind == "ego" and (view.height_m, view.pitch_down_deg) != (None, None):
        _remount(body, robot, view.height_m, view.pitch_down_deg)
    return body


def _remount(
    body: RobotBody, robot: RobotSpec, height_m: float | None, pitch_down_deg: float | None
) -> None:
    model, name = body.model, robot.camera.name
    base = (0.0, 0.0, robot.base_height_m)
    lens, _ = body.camera_pose(name, base, yaw_to_quat(0.0), robot.default_joint_rad)
    carrier_position, carrier = body.carrier_pose(name)
    camera = model.camera(name).id
    if height_m is not None:
        model.cam_pos[camera] = carrier.T @ (
            np.array([lens[0], lens[1], height_m]) - carrier_position
        )
    if pitch_down_deg is not None:
        pitch = np.deg2rad(pitch_down_deg)
        right, down = np.array([0.0, -1.0, 0.0]), np.array([-np.sin(pitch), 0.0, -np.cos(pitch)])
        optical = np.column_stack([right, down, np.cross(right, down)])
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, (carrier.T @ optical @ OPTICAL_TO_OPENGL.T).ravel())
        model.cam_quat[camera] = quat
