"""The interface of all renderers, and what they have in common."""

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..formats.core.arrays import F32, U8
from ..formats.core.camera import CameraModel
from ..formats.scene.bundle import SceneBundle, VisualMesh
from .frame import NOTHING, ROBOT, Drawn, Frame, Pose, RenderRequest
from .scene.robot_body import RobotGeometryPose
from .scene.textures import MaterialTable, load_materials
from .scene_tracer import SceneTracer


class Renderer(ABC):
    """Renders one scene under one light from any camera pose; built once and reused."""

    name: ClassVar[str]

    def __init__(self, bundle: SceneBundle, light: str = "baked"):
        """Load the mesh and textures and build the ray structure.

        Raises:
            UnknownNameError: no such light; the message lists the valid names.
            FileFormatError: the mesh or a texture cannot be read.
        """
        self.light = light
        mesh, materials = bundle.visual(), load_materials(bundle)
        self._scene = SceneTracer(bundle, light, mesh, materials)
        self._prepare(mesh, materials)

    def render(
        self,
        camera: CameraModel,
        position_world_m: ArrayLike,
        quat_wxyz: ArrayLike,
        robot: RobotGeometryPose | None = None,
        cut_above_m: float = np.inf,
        lamp_pose: Pose | None = None,
    ) -> tuple[U8, F32]:
        """Render one frame.

        Args:
            position_world_m: (3,) optical centre [m].
            quat_wxyz: (4,) rotation of the optical frame (x right, y down, z forward) to world.
            robot: body to render, or None.
            cut_above_m: if the camera is above this world z, the scene above it is left out, so
                that a ceiling does not hide the rooms.
            lamp_pose: pose of the lamp of the light `CL`; None = at the camera.

        Returns:
            RGB (H, W, 3) uint8 sRGB; depth (H, W) float32 planar z [m], 0 = nothing there.
        """
        drawn = self._draw(
            RenderRequest(camera, position_world_m, quat_wxyz, robot, cut_above_m, lamp_pose)
        )
        return drawn.rgb, drawn.depth_m

    def render_for(
        self,
        side_px: int,
        camera: CameraModel,
        position_world_m: ArrayLike,
        quat_wxyz: ArrayLike,
        robot: RobotGeometryPose | None = None,
    ) -> tuple[U8, F32]:
        """Render one frame for a reader who shrinks it to a square; see `render`.

        The reader averages RGB over areas (`cv2.INTER_AREA`) and picks depth
        (`cv2.INTER_NEAREST_EXACT`). It may get less than the camera's image: smaller RGB of nearly
        the same averages, and the depth (side, side) that it would pick.
        """
        return self.render(camera, position_world_m, quat_wxyz, robot)

    def render_labelled(
        self,
        camera: CameraModel,
        position_world_m: ArrayLike,
        quat_wxyz: ArrayLike,
        robot: RobotGeometryPose | None = None,
        cut_above_m: float = np.inf,
        lamp_pose: Pose | None = None,
    ) -> Frame:
        """Render one frame with the label and object at each pixel's centre; see `render`."""
        request = RenderRequest(camera, position_world_m, quat_wxyz, robot, cut_above_m, lamp_pose)
        drawn = self._draw(request)
        prim = self._scene.triangles(request) if drawn.prim is None else drawn.prim
        label, thing = (
            np.where(drawn.robot, ROBOT, np.where(prim < 0, NOTHING, ids[prim]))
            for ids in (self._scene.label, self._scene.thing)
        )
        return Frame(drawn.rgb, drawn.depth_m, label.astype(np.int32), thing.astype(np.int32))

    def first_hit_m(self, origin_world_m: ArrayLike, direction_world: ArrayLike) -> float:
        """Return the distance [m] along a ray to the scene without the robot; inf = no hit."""
        return self._scene.first_hit_m(origin_world_m, direction_world)

    def _prepare(self, mesh: VisualMesh, materials: MaterialTable) -> None:
        """Build what a renderer needs beside the ray structure; neither argument is kept."""
        return

    @abstractmethod
    def _draw(self, request: RenderRequest) -> Drawn:
        """Render one frame."""
