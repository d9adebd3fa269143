"""Observations of a policy: the robot's camera, the instruction, its own body and past."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..collectors.replay.world import World
from ..formats.core.camera import CameraModel
from ..formats.core.frames import quat_to_matrix, wrap_angle
from ..formats.core.rollout import Action
from ..rendering.camera.mounting import MountedBody
from ..rendering.camera.views import View
from ..rendering.interface import Renderer
from ..wayfinding.planning import floor_z

NO_ACTION = -1  # previous action before the first one


@dataclass(frozen=True)
class Start:
    """The start frame: on the floor under the base, gravity up, x along the first heading.

    Attributes:
        x_m, y_m, z_m: origin in the world [m].
        yaw_rad: heading in the world [rad].
    """

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float

    @classmethod
    def of(cls, world: World) -> "Start":
        """Return the frame of a robot's present pose."""
        pose = world.pose
        z = float(floor_z(world.freemap, np.array([pose.x_m, pose.y_m])))
        return cls(pose.x_m, pose.y_m, z, pose.yaw_rad)

    def pose_of(self, world: World) -> NDArray[np.float64]:
        """Return x, y [m] and yaw [rad] of a robot's base in this frame, (3,)."""
        pose = world.pose
        dx, dy = pose.x_m - self.x_m, pose.y_m - self.y_m
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        yaw = wrap_angle(pose.yaw_rad - self.yaw_rad)
        return np.array([cos * dx + sin * dy, -sin * dx + cos * dy, yaw])

    @property
    def rotation(self) -> NDArray[np.float64]:
        """(3, 3) rotation of world vectors into the start frame."""
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        return np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Lens:
    """The camera of an observation, as odometry and joint angles give it.

    Attributes:
        position_m: (3,) optical centre in the start frame [m].
        rotation: (3, 3) optical axes (columns x right, y down, z forward) in the start frame.
    """

    model: CameraModel
    position_m: NDArray[np.float64]
    rotation: NDArray[np.float64]


@dataclass(frozen=True)
class Labels:
    """The thing in each pixel, from the renderer: an oracle that no robot has.

    Attributes:
        thing: (H, W) int32 index into `categories`; negative = nothing, or the robot itself.
        categories: names of the scene's objects, one each (`dining table`), then its labels, for
            surfaces that belong to no object.
    """

    thing: NDArray[np.int32]
    categories: tuple[str, ...]


@dataclass(frozen=True)
class Observation:
    """An observation at one step, while physics stands still.

    Attributes:
        rgb: (H, W, 3) uint8 sRGB of the robot's own camera; smaller for policies with `reads_px`.
        depth_m: (H, W) float32 planar z [m], 0 = nothing there; likewise.
        pose: (3,) float64 x, y [m] and yaw [rad] in the frame of the start pose: x forward, y left.
        proprioception: (2 J + 9,) float64 joint positions [rad or m], joint velocities, linear
            velocity [m/s], angular velocity [rad/s] and the direction of gravity, the last three
            in the base frame.
        previous_action: `Action` taken before, `NO_ACTION` at first; a (3,) velocity or (K, 3)
            waypoints where those are the actions, zeros at first.
        step: number of actions taken so far.
        lens: the camera; only for policies with `wants_lens`, and never sent to servers.
        labels: the renderer's labels; only for policies with `wants_labels`.
    """

    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    instruction: str
    pose: NDArray[np.float64]
    proprioception: NDArray[np.float64]
    previous_action: int | NDArray[np.float64]
    step: int
    lens: Lens | None = None
    labels: Labels | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the fields by name, without `lens` and `labels`; arrays stay arrays."""
        names = [name for name in self.__dataclass_fields__ if name not in ("lens", "labels")]
        return {name: getattr(self, name) for name in names}


class Eye:
    """The robot's own camera in a world, looking at its present state.

    It renders with the calls that rendering a recorded rollout makes, from the same numbers, so
    that an observation is bit-equal to the frame that collection renders of that state, unless it
    is drawn for a side.
    """

    def __init__(self, world: World, view: View, renderer: Renderer) -> None:
        """Prepare the camera of `world`'s robot.

        Args:
            view: an `ego` view of this robot, from its own camera or a rig.
            renderer: renderer of the world's scene, made for the view's renderer and light.
        """
        self._world, self._view, self._renderer = world, view, renderer
        self._body = MountedBody(world.robot, world.robot.joint_names, view.rig)
        self._looked_from: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    def look(self, side_px: int | None = None) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return RGB (H, W, 3) uint8 and depth (H, W) float32 [m] of the state now.

        With `side_px` they are as `Renderer.render_for` draws them.
        """
        if side_px is None:
            return self._renderer.render(*self._view_arguments())
        return self._renderer.render_for(side_px, *self._view_arguments())

    def look_labelled(self) -> tuple[NDArray[np.uint8], NDArray[np.float32], Labels]:
        """Return RGB, depth and the labels of the state now."""
        frame = self._renderer.render_labelled(*self._view_arguments())
        bundle = self._world.bundle
        categories = (*(thing.category for thing in bundle.objects), *bundle.labels)
        # Scans may have labels without objects: all that has one label is one thing then.
        alone = (frame.thing < 0) & (frame.label >= 0)
        thing = np.where(alone, len(bundle.objects) + frame.label, frame.thing)
        return frame.rgb, frame.depth_m, Labels(thing, categories)

    def lens(self, start: Start) -> Lens:
        """Return the camera of the last look in the frame of the start.

        Raises:
            ValueError: there was no look yet.
        """
        if self._looked_from is None:
            raise ValueError("call look() or look_labelled() before lens()")
        position, quat = self._looked_from
        moved = np.asarray(position) - (start.x_m, start.y_m, start.z_m)
        rotation = start.rotation
        return Lens(self._view.camera, rotation @ moved, rotation @ quat_to_matrix(quat))

    def _state(self) -> tuple[NDArray[np.float64], ...]:
        world = self._world
        return world.base[:3], world.base[3:], world.data.qpos[world.handles.joint_qpos]

    def _view_arguments(self) -> tuple[Any, ...]:
        """Return the arguments of a rendering: camera, position, quaternion, body."""
        state = self._state()
        position, quat = self._body.eye(*state)
        self._looked_from = np.asarray(position), np.asarray(quat)
        body = self._body.pose(*state) if self._view.shows_robot else None
        return self._view.camera, *self._looked_from, body


class BlankEye:
    """A camera that renders nothing: black images of its size, without depth."""

    def __init__(self, camera: CameraModel) -> None:
        shape = (camera.height_px, camera.width_px)
        self._images = np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.float32)

    def look(self, side_px: int | None = None) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return RGB (H, W, 3) uint8 and depth (H, W) float32, all zeros."""
        return self._images


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
        ValueError: it is no action; the message names the answer and the valid ones.
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
