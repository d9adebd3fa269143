"""A robot's links as nodes of a viser scene."""

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from viser import ViserServer

from ..formats.core.arrays import Floats
from ..rendering.scene.primitives import geom_surface
from ..rendering.scene.robot_body import geom_colors, visible_geoms

Color = tuple[int, int, int]


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
        color: Color | None = None,
        opacity: float | None = None,
    ):
        """Add the links of a robot-alone `model` at the origin.

        Args:
            server: Where to.
            model: Compiled, with the robot's visible geoms (`RobotSpec.build_model`).
            name: Node above the links.
            color: sRGB of all links in place of their own, for a ghost.
            opacity: 0–1; None is opaque.
        """
        self._server = server
        self._root = server.scene.add_frame(name, show_axes=False)
        own = np.round(255 * geom_colors(model)[:, :3]).astype(int).tolist()
        parts: dict[int, dict[Color, list[Floats]]] = {}
        for geom in map(int, visible_geoms(model)):
            rotation = np.zeros(9)
            mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
            corners, _ = geom_surface(model, geom)
            placed = corners @ rotation.reshape(3, 3).T + model.geom_pos[geom]
            colors = parts.setdefault(int(model.geom_bodyid[geom]), {})
            colors.setdefault(color or tuple(own[geom]), []).append(placed)
        self.links = links_of(model)
        self._nodes = [
            server.scene.add_frame(f"{name}/{link}", show_axes=False) for link in self.links
        ]
        for link, colors in zip(self.links, parts.values(), strict=True):
            for k, (rgb, triangles) in enumerate(colors.items()):
                points, faces = np.unique(
                    np.concatenate(triangles).reshape(-1, 3).astype(np.float32),
                    axis=0,
                    return_inverse=True,
                )
                server.scene.add_mesh_simple(
                    f"{name}/{link}/{k}",
                    points,
                    faces.reshape(-1, 3),
                    color=rgb,
                    opacity=opacity,
                    side="double",
                    cast_shadow=False,
                    receive_shadow=False,
                )
        self._ids: tuple[object, list[int]] = (None, [])

    @property
    def visible(self) -> bool:
        """Whether the robot is shown."""
        return self._root.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        self._root.visible = visible

    def update(self, data: mujoco.MjData, prefix: str = "") -> None:
        """Move all links to where a simulation has them.

        Args:
            data: Of any model whose bodies have the links' names, e.g. of `level_model`.
            prefix: Of these names there, e.g. `ROBOT_PREFIX`.

        Raises:
            KeyError: that model lacks a link.
        """
        if self._ids[0] is not data.model:
            self._ids = data.model, [data.model.body(prefix + link).id for link in self.links]
        self.place(data.xpos[self._ids[1]], data.xquat[self._ids[1]])

    def place(self, position_world_m: ArrayLike, quat_wxyz: ArrayLike) -> None:
        """Move the L links to positions (L, 3) [m] and orientations (L, 4), in one batch."""
        position, rotation = np.asarray(position_world_m), np.asarray(quat_wxyz)
        with self._server.atomic():
            for node, at, quat in zip(self._nodes, position, rotation, strict=True):
                node.position, node.wxyz = at, quat

    def remove(self) -> None:
        """Take the robot out of the scene."""
        self._root.remove()
