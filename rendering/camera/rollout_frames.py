"""The frames of a recorded rollout under one view: camera poses, then pictures."""

import functools
from collections.abc import Iterator
from dataclasses import dataclass

from ...collectors.robots import RobotSpec, get_robot
from ...formats.core.arrays import F32, I64, U8, Array
from ...formats.core.errors import check_name
from ...formats.core.rollout import Rollout
from ..frame import Frame, Pose
from ..interface import Renderer
from ..light.lights import get_light
from ..scene.robot_body import RobotGeometryPose
from .mounting import MountedBody
from .rigs import Rig
from .views import VIEWS, CameraPath, Shot, View

Picture = tuple[U8, F32]


@dataclass(frozen=True)
class RolloutFrames:
    """The frames of a rollout before they are rendered.

    Attributes:
        sample_index: (N,) samples of the rollout.
        lamp: robot's camera that carries the lamp of the light `CL`; None = the view's camera.
    """

    rollout: Rollout
    view: View
    body: MountedBody
    sample_index: I64
    path: CameraPath
    lamp: str | None = None

    @classmethod
    def plan(
        cls,
        renderer: Renderer,
        rollout: Rollout,
        view: View,
        samples: I64,
        robot: RobotSpec | None = None,
    ) -> "RolloutFrames":
        """Compute the camera poses of a view at `samples` (N,).

        Args:
            renderer: renderer of the view's name and light.
            samples: indices of samples of the rollout.
            robot: robot of the rollout; None = the registry's robot of that name.

        Raises:
            UnknownNameError: no such view kind or robot; the message lists the valid names.
            ValueError: the renderer is not the one that the view names.
        """
        check_name("camera", view.kind, VIEWS)
        if (renderer.name, renderer.light) != (view.renderer, view.light):
            raise ValueError(
                f"view {view.name} requires renderer {view.renderer} with light {view.light}, "
                f"not {renderer.name} with {renderer.light}"
            )
        robot = robot or get_robot(rollout.robot)
        body = _body(robot, tuple(rollout.joint_names), view.rig)
        shot = Shot(rollout, samples, view.camera, robot, body, renderer)
        kind = VIEWS[view.kind]
        carried = get_light(view.light).lamp > 0 and not kind.onboard
        lamp = robot.camera.name if carried else None
        return cls(rollout, view, body, samples, kind.path(shot), lamp)

    def render(self, renderer: Renderer) -> Iterator[Picture]:
        """Yield RGB (H, W, 3) uint8 and depth (H, W) float32 [m] of each frame."""
        for n in range(len(self.sample_index)):
            yield renderer.render(self.view.camera, *self._instant(n))

    def render_labelled(self, renderer: Renderer) -> Iterator[Frame]:
        """Yield each frame with the labels of its pixels."""
        for n in range(len(self.sample_index)):
            yield renderer.render_labelled(self.view.camera, *self._instant(n))

    def _instant(self, n: int) -> tuple[Array, Array, RobotGeometryPose | None, float, Pose | None]:
        """Return the arguments of `Renderer.render` for frame `n`, after the camera."""
        sample = self.sample_index[n]
        state = (
            self.rollout.position_world_m[sample],
            self.rollout.quat_wxyz[sample],
            self.rollout.joint_position_rad[sample],
        )
        return (
            self.path.position_world_m[n],
            self.path.quat_wxyz[n],
            self.body.pose(*state) if self.view.shows_robot else None,
            float(self.path.cut_above_m[n]),
            self.body.camera_pose(self.lamp, *state) if self.lamp else None,
        )


# Tessellating a body, and building its ray structures, takes as long as drawing four frames.
@functools.lru_cache(maxsize=4)
def _body(robot: RobotSpec, joint_names: tuple[str, ...], rig: Rig | None) -> MountedBody:
    return MountedBody(robot, joint_names, rig)
