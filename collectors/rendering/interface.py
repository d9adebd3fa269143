"""The one interface behind which renderers stand."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...formats.camera import CameraModel
from .robot_body import RobotGeometryPose


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
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """One frame.

        Args:
            camera: intrinsics.
            position_world_m: (3,) optical centre [m].
            quat_wxyz: (4,) rotation of the optical frame (x right, y down, z forward) to world.
            robot: body to draw, or None.
            cut_above_m: what of the scene lies above this world z is left out, for a camera above
                it; so a ceiling does not hide the room.

        Returns:
            RGB (H, W, 3) uint8 sRGB; depth (H, W) float32 planar z [m], 0 = nothing there.
        """
        ...

    def first_hit_m(self, origin_world_m: ArrayLike, direction_world: ArrayLike) -> float:
        """Distance [m] along a ray to the scene, the robot apart; inf when nothing is hit."""
        ...
