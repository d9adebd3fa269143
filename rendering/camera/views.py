"""Views of a rollout: from the robot's own camera or a rig, from behind it, from above."""

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...collectors.robots import RobotSpec, get_robot
from ...formats.core.arrays import I64, Array
from ...formats.core.camera import CameraModel
from ...formats.core.errors import InputError, check_name
from ...formats.core.frames import matrix_to_quat
from ...formats.core.rollout import Rollout
from ..interface import Renderer
from .chase import chase_poses
from .mounting import MountedBody, own_rig
from .rigs import LEVEL, RIG_NAMES, Rig, is_rig, parse_rigs


@dataclass(frozen=True)
class CameraPath:
    """Camera poses of N frames.

    Attributes:
        position_world_m: (N, 3) optical centre [m].
        quat_wxyz: (N, 4) optical frame to world.
        cut_above_m: (N,) world z above which the scene is left out; inf = nothing.
    """

    position_world_m: Array
    quat_wxyz: Array
    cut_above_m: Array


@dataclass(frozen=True)
class Shot:
    """Inputs from which a view kind computes its camera poses."""

    rollout: Rollout
    samples: I64
    camera: CameraModel
    robot: RobotSpec
    body: MountedBody
    renderer: Renderer


@dataclass(frozen=True)
class ViewKind:
    """One kind of view.

    Attributes:
        default_camera: function that returns the default intrinsics for a robot.
        path: function that computes the camera poses.
        onboard: whether it is the robot's own camera, which carries its lamp.
    """

    default_camera: Callable[[RobotSpec], CameraModel]
    path: Callable[[Shot], CameraPath]
    onboard: bool = False


@dataclass(frozen=True)
class View:
    """Camera, light and renderer of a rendering.

    Attributes:
        kind: key of `VIEWS`.
        rig: where an `ego` camera is mounted; None = the robot's own place.
    """

    kind: str
    camera: CameraModel
    light: str = "baked"
    renderer: str = "embree"
    rig: Rig | None = None

    @property
    def name(self) -> str:
        """Folder name: kind or rig, resolution, field of view, and light."""
        c = self.camera
        mount = self.rig.name.replace(":", "-") if self.rig else self.kind
        return f"{mount}-{c.width_px}x{c.height_px}-{c.hfov_deg:g}deg-{self.light}"

    @property
    def shows_robot(self) -> bool:
        """Whether the robot's body is drawn; a rig may stand inside it, and sees none of it."""
        return self.rig is None


@dataclass(frozen=True, kw_only=True)
class CameraOverrides:
    """Intrinsics in place of those of a view kind, and a mounting of `ego`; None = the default."""

    width_px: int | None = None
    height_px: int | None = None
    hfov_deg: float | None = None
    height_m: float | None = None
    pitch_down_deg: float | None = None

    def rig(self, robot: RobotSpec) -> Rig | None:
        """Return the rig that replaces the robot's own camera, if any; one value may be its own."""
        if self.height_m is None and self.pitch_down_deg is None:
            return None
        own = own_rig(robot)
        return Rig(
            own.height_m if self.height_m is None else self.height_m,
            own.pitch_down_deg if self.pitch_down_deg is None else self.pitch_down_deg,
        )


def make_view(
    kind: str,
    robot: str | RobotSpec,
    *,
    width_px: int | None = None,
    height_px: int | None = None,
    hfov_deg: float | None = None,
    light: str = "baked",
    renderer: str = "embree",
    rig: Rig | None = None,
) -> View:
    """Return a view of kind `kind` of a robot or its name; None = the kind's default.

    A rig is for `ego` only.

    Raises:
        UnknownNameError: no such kind or robot; the message lists the valid names.
    """
    check_name("camera", kind, VIEWS)
    spec = get_robot(robot) if isinstance(robot, str) else robot
    default = VIEWS[kind].default_camera(spec)
    camera = CameraModel(
        name=rig.name if rig else kind,
        width_px=default.width_px if width_px is None else width_px,
        height_px=default.height_px if height_px is None else height_px,
        hfov_deg=default.hfov_deg if hfov_deg is None else hfov_deg,
    )
    return View(kind, camera, light, renderer, rig)


def chase_view(renderer: Renderer, width_px: int, height_px: int) -> View:
    """Return the view from behind the robot, for a renderer and its light."""
    camera = CameraModel("chase", width_px, height_px, CHASE.hfov_deg)
    return View("chase", camera, renderer.light, renderer.name)


CHASE = CameraModel("chase", 640, 480, 75.0)
CAMERA = re.compile(
    rf"(?P<mount>rig:[^:]+(:{LEVEL})?|[a-z_]+)"
    r"(:(?P<width>\d+)x(?P<height>\d+))?(:(?P<hfov>\d+(\.\d+)?))?"
)
_NAME = re.compile(
    r"(?P<mount>[a-z_]+|rig-[^-]+cm_-?[^-]+deg(?:-level)?)-(?P<size>\d+x\d+)-(?P<hfov>[\d.]+)deg"
    r"-(?P<light>\w+)"
)
MAX_SIDE_PX = 8192


def camera_and_light(view: str) -> tuple[str, str]:
    """Return the camera, as `parse_views` reads it, and the light of a `View.name`.

    Raises:
        InputError: it is no such name.
    """
    match = _NAME.fullmatch(view)
    if match is None:
        raise InputError(f"view {view!r}; valid: a name like ego-256x256-90deg-baked")
    mount = match["mount"].replace("rig-", "rig:").replace(f"-{LEVEL}", f":{LEVEL}")
    return f"{mount}:{match['size']}:{match['hfov']}", match["light"]


def named_view(name: str, robot: str | RobotSpec, renderer: str) -> View:
    """Return the view with a `View.name`; raise InputError if there is none."""
    camera, light = camera_and_light(name)
    return parse_views(camera, robot, CameraOverrides(), light=light, renderer=renderer)[0]


def parse_views(
    text: str, robot: str | RobotSpec, defaults: CameraOverrides, *, light: str, renderer: str
) -> list[View]:
    """Parse views like `ego,rig:n1,chase:640x480,top:480x480:50`: kind, size [px], HFOV [deg].

    Args:
        text: one or more cameras, separated by commas; a preset of rigs is several.
        defaults: intrinsics of cameras that do not specify their own, height and pitch of `ego`.

    Raises:
        UnknownNameError: no such kind, rig or robot; the message lists the valid names.
        InputError: a camera cannot be parsed, has a size that video codecs do not support, cannot
            be mounted so, or is given twice.
    """
    spec = get_robot(robot) if isinstance(robot, str) else robot
    moved, views = defaults.rig(spec), []
    for word in map(str.strip, text.split(",")):
        match = CAMERA.fullmatch(word)
        if match is None:
            raise InputError(
                f"camera {word!r}; valid: KIND[:WIDTHxHEIGHT][:HFOV], e.g. ego:640x480:79 or "
                "rig:125cm_30deg:level:640x480"
            )
        kind, rigs = match["mount"], [moved if match["mount"] == "ego" else None]
        if is_rig(kind):
            kind, rigs = "ego", parse_rigs(kind)
        check_name("camera", kind, (*VIEWS, *RIG_NAMES))
        views += [
            make_view(
                kind,
                spec,
                width_px=int(match["width"]) if match["width"] else defaults.width_px,
                height_px=int(match["height"]) if match["height"] else defaults.height_px,
                hfov_deg=float(match["hfov"]) if match["hfov"] else defaults.hfov_deg,
                light=light,
                renderer=renderer,
                rig=rig,
            )
            for rig in rigs
        ]
        camera = views[-1].camera
        for side in (camera.width_px, camera.height_px):
            if side % 2 or not 16 <= side <= MAX_SIDE_PX:
                raise InputError(
                    f"camera {word!r} has {camera.width_px} x {camera.height_px} px; "
                    f"valid: even sides from 16 to {MAX_SIDE_PX}"
                )
        if not 1.0 <= camera.hfov_deg <= 170.0:
            raise InputError(f"camera {word!r} has HFOV {camera.hfov_deg:g}°; valid: 1 to 170")
    names = [view.name for view in views]
    if len(set(names)) < len(names):
        raise InputError(f"camera {text!r} contains a view twice; valid: each view once")
    if moved and not any(view.rig is moved for view in views):
        raise InputError(f"camera {text!r} is not moved by a height or pitch; valid: ego")
    return views


def _ego_path(shot: Shot) -> CameraPath:
    poses = [
        shot.body.eye(
            shot.rollout.position_world_m[i],
            shot.rollout.quat_wxyz[i],
            shot.rollout.joint_position_rad[i],
        )
        for i in shot.samples
    ]
    return CameraPath(
        np.array([p for p, _ in poses]),
        np.array([q for _, q in poses]),
        np.full(len(poses), np.inf),
    )


def _chase_path(shot: Shot) -> CameraPath:
    position, quat = chase_poses(
        shot.rollout, shot.samples, shot.robot.base_height_m, shot.camera, shot.renderer
    )
    return CameraPath(position, quat, np.full(len(position), np.inf))


TOP_HEIGHT_M = 9.0
# Below the lintels of most doors, so that doorways are open from above.
TOP_CUT_M = 2.0
# Looking straight down, north (+y) up in the image.
DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])


def _top_path(shot: Shot) -> CameraPath:
    rollout, samples = shot.rollout, shot.samples
    floor = rollout.floor_z_m[samples]
    position = rollout.position_world_m[samples].copy()
    position[:, 2] = floor + TOP_HEIGHT_M
    return CameraPath(position, np.tile(matrix_to_quat(DOWN), (len(samples), 1)), floor + TOP_CUT_M)


VIEWS: dict[str, ViewKind] = {
    "ego": ViewKind(lambda robot: robot.camera.model, _ego_path, onboard=True),
    "chase": ViewKind(lambda robot: CHASE, _chase_path),
    "top": ViewKind(lambda robot: CameraModel("top", 480, 480, 50.0), _top_path),
}
