"""A robot's links as nodes of a viser scene."""

import fast_simplification
import mujoco
import numpy as np
from numpy.typing import ArrayLike
from viser import ViserServer

from ..formats.core.arrays import Floats
from ..rendering.scene.primitives import geom_surface
from ..rendering.scene.robot_body import geom_colors, visible_geoms
from .glb import Patch, unique_rows, unlit_glb
from .scene import WHITE_GAIN, before_tone_mapping

MOST = 120  # triangles of a geom
STILL = 1e-4  # a link that has moved less, in metres and of its quaternion, stays


def links_of(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the names of a robot-alone model's links that have visible geoms."""
    bodies = dict.fromkeys(model.geom_bodyid[visible_geoms(model)].tolist())
    return tuple(model.body(body).name for body in bodies)


class RobotNodes:
    """The visible links of a robot, moved together.

    Attributes:
        links: names of the L links, in the order of `place`.
    """

    def __init__(
        self,
        server: ViserServer,
        model: mujoco.MjModel,
        name: str = "/robot",
        *,
        color: tuple[int, int, int] | None = None,
        opacity: float = 1.0,
    ):
        """Add the links of a robot-alone `model` at the origin.

        Args:
            server: Where to.
            model: Compiled, with the robot's visible geoms (`RobotSpec.build_model`).
            name: Node above the links.
            color: sRGB of all links in place of their own, for a ghost.
            opacity: 0–1.
        """
        self._server = server
        self._root = server.scene.add_frame(name, show_axes=False)
        own = geom_colors(model)[:, :3]
        parts: dict[int, list[Floats]] = {}
        for geom in map(int, visible_geoms(model)):
            rgb = own[geom] if color is None else np.array(color) / 255
            corners = _shaded_corners(model, geom, rgb)
            parts.setdefault(int(model.geom_bodyid[geom]), []).append(corners)
        self.links = links_of(model)
        self._nodes = [
            server.scene.add_glb(
                f"{name}/{link}",
                unlit_glb([_patch(np.concatenate(corners))], WHITE_GAIN, opacity),
                cast_shadow=False,
                receive_shadow=False,
            )
            for link, corners in zip(self.links, parts.values(), strict=True)
        ]
        self._placed = np.zeros((len(self.links), 7), np.float32)

    def place(self, position_world_m: ArrayLike, quat_wxyz: ArrayLike) -> None:
        """Move the L links to positions (L, 3) [m] and orientations (L, 4), in one batch."""
        poses = np.column_stack([position_world_m, quat_wxyz])
        moved = np.abs(poses - self._placed).max(axis=1) > STILL
        self._placed[moved] = poses[moved]
        with self._server.atomic():
            for link in np.flatnonzero(moved).tolist():
                node, pose = self._nodes[link], poses[link]
                node.position, node.wxyz = pose[:3], pose[3:]

    def remove(self) -> None:
        """Take the robot out of the scene."""
        self._root.remove()


def _shaded_corners(model: mujoco.MjModel, geom: int, srgb: Floats) -> Floats:
    """Return corners (3 T, 6) of a geom's triangles: place in the link [m], linear RGB (0–255)."""
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    turned = rotation.reshape(3, 3).T
    corners, normals = (part.reshape(-1, 3) for part in geom_surface(model, geom))
    if len(corners) > 3 * MOST:
        corners, normals = _simplified(corners)
    # As if light came from above, wherever the link turns.
    shade = 0.72 + 0.22 * (normals @ turned)[:, 2:] + 0.06 * np.abs((normals @ turned)[:, :1])
    rgb = 255 * np.clip(shade * before_tone_mapping(srgb) ** 2.2, 0, 1)
    return np.column_stack([corners @ turned + model.geom_pos[geom], np.round(rgb)])


def _simplified(corners: Floats) -> tuple[Floats, Floats]:
    """Return corners (3 T, 3) and normals of about `MOST` triangles in place of more."""
    first, inverse = unique_rows(np.round(corners, 6).astype(np.float64))
    faces = inverse.reshape(-1, 3).astype(np.int32)
    ratio = 1 - MOST / len(faces)
    vertices = corners[first].astype(np.float64)
    points, faces = fast_simplification.simplify(vertices, faces, ratio)[:2]
    sums = np.zeros((len(points), 3))
    a, b, c = np.moveaxis(points[faces], 1, 0)
    np.add.at(sums, faces, np.cross(b - a, c - a)[:, None, :])
    normals = sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)
    return points[faces.ravel()], normals[faces.ravel()]


def _patch(corners: Floats) -> Patch:
    first, inverse = unique_rows(corners)
    return Patch(
        vertices=corners[first, :3].astype(np.float32),
        uv=np.empty((0, 2), np.float32),
        rgb=corners[first, 3:].astype(np.uint8),
        faces=inverse.reshape(-1, 3).astype(np.uint32),
        image=None,
    )
