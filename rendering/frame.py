"""Records of a renderer's input and output."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..formats.core.arrays import F32, I32, U8, Array, Mask
from ..formats.core.camera import CameraModel
from ..formats.core.frames import quat_to_matrix
from .scene.robot_body import RobotGeometryPose

# Position (3,) [m] and optical quaternion (4,) in the world.
Pose = tuple[ArrayLike, ArrayLike]

# Ids of pixels that show nothing or the robot; other pixels have indices ≥ 0.
NOTHING, ROBOT = -1, -2


@dataclass(frozen=True, eq=False)
class RenderRequest:
    """One frame to render; see `Renderer.render` for the fields."""

    camera: CameraModel
    position_world_m: ArrayLike
    quat_wxyz: ArrayLike
    robot: RobotGeometryPose | None
    cut_above_m: float
    lamp_pose: Pose | None

    @cached_property
    def position(self) -> Array:
        """(3,) optical centre in the world [m]."""
        return np.asarray(self.position_world_m, dtype=np.float64)

    @cached_property
    def rotation(self) -> Array:
        """(3, 3) optical axes (columns x right, y down, z forward) in the world."""
        return quat_to_matrix(self.quat_wxyz)


class Drawn(NamedTuple):
    """A rendered frame before its pixels are labelled.

    Attributes:
        rgb: (H, W, 3) uint8 sRGB.
        depth_m: (H, W) float32 planar z [m], 0 = nothing there.
        robot: (H, W) bool, whether the pixel's centre shows the robot.
        prim: (H, W) int32 triangle at the pixel's centre, −1 = none; None if not known.
    """

    rgb: U8
    depth_m: F32
    robot: Mask
    prim: I32 | None


class Frame(NamedTuple):
    """A rendered frame with labels.

    Attributes:
        rgb: (H, W, 3) uint8 sRGB.
        depth_m: (H, W) float32 planar z [m], 0 = nothing there.
        label: (H, W) int32 index into the bundle's labels; `NOTHING` or `ROBOT`.
        thing: (H, W) int32 index into the bundle's objects; `NOTHING` or `ROBOT`.
    """

    rgb: U8
    depth_m: F32
    label: I32
    thing: I32
