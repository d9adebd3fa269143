"""The one interface behind which renderers stand."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...formats.core.camera import CameraModel
from .scene.robot_body import RobotGeometryPose

# Position (3,) [m] and optical quaternion (4,) in the world.
Pose = tuple[ArrayLike, ArrayLike]

# Names of pixels that show no labelled thing; others are indices ≥ 0.
NOTHING, ROBOT = -1, -2


class Frame(NamedTuple):
    """All that a renderer can tell of one view.

    Attributes:
        rgb: (H, W, 3) uint8 sRGB.
        depth_m: (H, W) float32 planar z [m], 0 = nothing there.
        label: (H, W) int32 index into the bundle's labels; `NOTHING` or `ROBOT`.
        thing: (H, W) int32 index into the bundle's objects; `NOTHING` or `ROBOT`.
    """

    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    label: NDArray[np.int32]
    thing: NDArray[np.int32]


class Renderer(Protocol):
    """Turns camera poses into pixels; built once per scene and light.

    Attributes:
        name: registry name of the renderer.
        light: registry name of the light.
    """

    name: str
    light: str

    def render(
        self,
        camera: CameraModel,
        position_world_m: ArrayLike,
        quat_wxyz: ArrayLike,
        robot: RobotGeometryPose | None = None,
        cut_above_m: float = np.inf,
        lamp_pose: Pose | None = None,
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """One frame.

        Args:
            camera: intrinsics.
            position_world_m: (3,) optical centre [m].
            quat_wxyz: (4,) rotation of the optical frame (x right, y down, z forward) to world.
            robot: body to draw, or None.
            cut_above_m: what of the scene lies above this world z is left out, for a camera above
                it; so a ceiling does not hide the room.
            lamp_pose: where the light `CL` is, if not at the camera.

        Returns:
            RGB (H, W, 3) uint8 sRGB; depth (H, W) float32 planar z [m], 0 = nothing there.
        """
        ...

    def render_labelled(
        self,
        camera: CameraModel,
        position_world_m: ArrayLike,
        quat_wxyz: ArrayLike,
        robot: RobotGeometryPose | None = None,
        cut_above_m: float = np.inf,
        lamp_pose: Pose | None = None,
    ) -> Frame:
        """One frame, and which label and object each pixel's centre shows; as `render`."""
        ...

    def first_hit_m(self, origin_world_m: ArrayLike, direction_world: ArrayLike) -> float:
        """Distance [m] along a ray to the scene, the robot apart; inf when nothing is hit."""
        ...
