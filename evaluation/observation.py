"""What a policy is shown: the robot's camera, the instruction, its own body and past."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..collectors.rendering.camera.mounting import body_for
from ..collectors.rendering.camera.views import View
from ..collectors.rendering.interface import Renderer
from ..collectors.world import World
from ..formats.core.frames import quat_to_matrix, wrap_angle
from ..formats.core.rollout import Action

NO_ACTION = -1  # previous action before the first one


@dataclass(frozen=True)
class Observation:
    """One look of a policy, taken while physics stands still.

    Attributes:
        rgb: (H, W, 3) uint8 sRGB of the robot's own camera.
        depth_m: (H, W) float32 planar z [m], 0 = nothing there.
        instruction: what the robot is told.
        pose: (3,) float64 x, y [m] and yaw [rad] in the frame of the start pose: x forward, y left.
        proprioception: (2 J + 9,) float64 joint positions [rad or m], joint velocities, linear
            velocity [m/s], angular velocity [rad/s] and the direction of gravity, the last three
            in the base frame.
        previous_action: `Action` taken before, `NO_ACTION` at first; a (3,) velocity or (K, 3)
            waypoints where those are the actions, zeros at first.
        step: number of actions taken so far.
    """

    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    instruction: str
    pose: NDArray[np.float64]
    proprioception: NDArray[np.float64]
    previous_action: int | NDArray[np.float64]
    step: int

    def to_dict(self) -> dict[str, Any]:
        """Return the fields by name; arrays stay arrays."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}


class Eye:
    """The robot's own camera in a world, looking at its present state.

    It renders with the calls that rendering a recorded rollout makes, from the same numbers, so
    that an observation is bit-equal to the frame that collection renders of that state.
    """

    def __init__(self, world: World, view: View, renderer: Renderer) -> None:
        """Prepare the camera of `world`'s robot.

        Args:
            world: the level with the robot in it.
            view: an `ego` view of this robot.
            renderer: of the world's scene, made for the view's renderer and light.
        """
        self._world, self._view, self._renderer = world, view, renderer
        self._body = body_for(world.robot, world.robot.joint_names, view)

    def look(self) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return RGB (H, W, 3) uint8 and depth (H, W) float32 [m] of the state now."""
        world = self._world
        state = (world.base[:3], world.base[3:], world.data.qpos[world.handles.joint_qpos])
        position, quat = self._body.camera_pose(world.robot.camera.name, *state)
        body = self._body.pose(*state) if self._view.shows_robot else None
        return self._renderer.render(self._view.camera, position, quat, body)


class BlankEye:
    """A camera that renders nothing: black images of a view's size, without depth."""

    def __init__(self, view: View) -> None:
        shape = (view.camera.height_px, view.camera.width_px)
        self._images = np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.float32)

    def look(self) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return RGB (H, W, 3) uint8 and depth (H, W) float32, all zeros."""
        return self._images


def relative_pose(world: World, start: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return x, y [m] and yaw [rad] of the base in the frame of `start`: x, y, yaw in the world."""
    pose = world.pose
    dx, dy = pose.x_m - start[0], pose.y_m - start[1]
    cos, sin = np.cos(start[2]), np.sin(start[2])
    yaw = wrap_angle(pose.yaw_rad - start[2])
    return np.array([cos * dx + sin * dy, -sin * dx + cos * dy, yaw])


def proprioception(world: World) -> NDArray[np.float64]:
    """Return what `Observation.proprioception` holds, of the state now."""
    data, handles = world.data, world.handles
    to_base = quat_to_matrix(world.base[3:]).T
    velocity = data.qvel[handles.root_dof : handles.root_dof + 6]
    return np.concatenate(
        [
            data.qpos[handles.joint_qpos],
            data.qvel[handles.joint_dof],
            to_base @ velocity[:3],
            velocity[3:],
            to_base @ (0.0, 0.0, -1.0),
        ]
    )


def checked_action(answer: Any) -> Action:
    """Return a policy's answer as an action.

    Args:
        answer: 0–3 as a number (also a numpy scalar or an array of one), or a name of `Action`.

    Raises:
        ValueError: it is none; the message names the answer and the valid ones.
    """
    valid = ", ".join(f"{a.value} {a.name}" for a in Action)
    if isinstance(answer, str):
        if answer.upper() in Action.__members__:
            return Action[answer.upper()]
        raise ValueError(f"action {answer!r:.80}; valid: {valid}")
    value = np.asarray(answer)
    if value.size == 1 and value.dtype.kind in "iuf" and float(value.reshape(())) in (0, 1, 2, 3):
        return Action(int(value.reshape(())))
    raise ValueError(f"action {answer!r:.80}; valid: {valid}")
