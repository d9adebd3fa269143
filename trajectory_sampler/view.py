"""Views at the ends of a path: a near wall teaches no model to stop."""

from collections.abc import Callable
from functools import cached_property

import numpy as np

from ..formats.core.camera import CameraModel
from ..formats.core.frames import Array, look_at
from ..formats.core.geometry import arc_length, path_length, point_along
from ..formats.scene.bundle import SceneBundle
from ..geometry.rays.packets import PacketScene

# Cameras of a quadruped, of a wheeled robot or small humanoid, and of a tall humanoid, all of which
# must see, since paths serve all robots: height above the floor and distance ahead of the robot's
# centre [m], pitch below the horizon [deg].
CAMERAS = ((0.45, 0.37, 8.0), (1.25, 0.1, 0.0), (1.6, 0.12, 15.0))
_MODEL = CameraModel("end", 24, 24, 90.0)
_RAYS = _MODEL.pixel_rays()
_MIDDLE = slice(8, 16)
_FAR_M = 20.0
_GOAL_M, _START_M = 0.4, 0.75  # headings at goal and start are the path's over this length
# A robot stops up to this far from the goal.
_MARGIN_M = 0.25
CUTS_M = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 2.5)


class SceneView:
    """Depth that cameras above the floor of a scene would see.

    Args:
        bundle: the scene; its visual mesh is loaded when the first view is taken.
    """

    def __init__(self, bundle: SceneBundle):
        self._bundle = bundle

    @cached_property
    def _rays(self) -> PacketScene | None:
        mesh = self._bundle.visual()
        return PacketScene(mesh.vertices, mesh.faces) if len(mesh.faces) else None

    def open_from(self, floor_m: Array, yaw_rad: float, least_m: float) -> bool:
        """Return whether all cameras above a place (3,) [m] see far enough in a direction.

        Args:
            least_m: least median depth of the picture, and of its middle third [m].
        """
        if self._rays is None:
            return True
        return all(
            self._depth_m(self._rays, floor_m, yaw_rad, camera) >= least_m + _MARGIN_M
            for camera in CAMERAS
        )

    def trimmed(self, path_m: Array, least_m: float, *, both: bool) -> Array | None:
        """Return a path (P, 3) [m] cut short to ends from which cameras see far enough.

        At most 2.5 m are cut off at the goal and, with `both`, at the start. Return None if no such
        ends exist.
        """
        path: Array | None = path_m
        if both:
            back = self._trimmed(path_m[::-1], least_m, _start_pose)
            path = None if back is None else back[::-1]
        return None if path is None else self._trimmed(path, least_m, _goal_pose)

    def _trimmed(
        self, path_m: Array, least_m: float, end_pose: Callable[[Array], tuple[Array, float]]
    ) -> Array | None:
        """Return the longest first part of a path whose end, in a pose, sees far enough."""
        length = path_length(path_m)
        for cut_m in CUTS_M:
            if length - cut_m <= _START_M:
                break
            shorter = _up_to(path_m, length - cut_m) if cut_m else path_m
            if self.open_from(*end_pose(shorter), least_m):
                return shorter
        return None

    def _depth_m(
        self, rays: PacketScene, floor_m: Array, yaw_rad: float, camera: tuple[float, float, float]
    ) -> float:
        """Return the smaller one of the median depths of a picture and of its middle [m]."""
        height_m, forward_m, pitch_deg = camera
        pitch = np.deg2rad(pitch_deg)
        ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad), -np.tan(pitch)])
        lens = floor_m + forward_m * ahead * (1, 1, 0) + np.array([0.0, 0.0, height_m])
        directions = (_RAYS @ look_at(lens, lens + ahead).T).reshape(-1, 3)
        far = np.full(len(directions), _FAR_M, dtype=np.float32)
        origins = np.broadcast_to(lens, directions.shape)
        depth = rays.trace(origins=origins, directions=directions, far=far).depth
        depth = depth.reshape(_MODEL.height_px, _MODEL.width_px)
        return float(min(np.median(depth), np.median(depth[_MIDDLE, _MIDDLE])))


def start_heading(path_m: Array) -> float:
    """Return the direction of the first 0.75 m of a path (P, 3) [rad]."""
    ahead = point_along(path_m, _START_M) - path_m[0]
    return float(np.arctan2(ahead[1], ahead[0]))


def _start_pose(back_m: Array) -> tuple[Array, float]:
    """Return the first point (3,) [m] of a path that is given backward, and its direction [rad]."""
    return back_m[-1], start_heading(back_m[::-1])


def _goal_pose(path_m: Array) -> tuple[Array, float]:
    """Return the last point (3,) [m] of a path and its direction there [rad]."""
    step = path_m[-1] - point_along(path_m, path_length(path_m) - _GOAL_M)
    return path_m[-1], float(np.arctan2(step[1], step[0]))


def _up_to(path_m: Array, along_m: float) -> Array:
    """Return the first `along_m` metres of a path (P, 3) [m]."""
    return np.vstack([path_m[arc_length(path_m) < along_m - 1e-6], point_along(path_m, along_m)])
