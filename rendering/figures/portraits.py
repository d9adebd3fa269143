"""Portraits of a robot in the studio: a turntable and a film strip of its gait."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ...collectors.robots import RobotSpec
from ...formats.core.arrays import U8, Array
from ...formats.core.camera import CameraModel
from ...formats.core.frames import look_at, matrix_to_quat, yaw_to_quat
from ..embree import SceneRenderer
from ..scene.robot_body import RobotBody, RobotGeometryPose
from .stroll import Stroll

Picture = U8

TURNTABLE_PX, STRIP_PX = 250_000, 130_000  # area of a tile
FINER = 2  # pictures are rendered so many times larger and averaged down
VIEWS, COLUMNS = 8, 4
FRAMES = 12
MARGIN = 0.09  # of a tile, around the robot
HFOV_DEG = 24.0
ELEVATION_DEG = 13.0
# The light comes from the viewer's upper left.
CAMERA_AZIMUTH_DEG = 18.0
INK, QUIET = (38, 42, 48), (98, 106, 116)


@dataclass(frozen=True)
class StandingRobot:
    """A robot standing in its default pose, its soles on the floor."""

    robot: RobotSpec
    body: RobotBody

    @classmethod
    def of(cls, robot: RobotSpec) -> "StandingRobot":
        """Return `robot` in its default pose."""
        return cls(robot, RobotBody(robot.build_model(floor=False), robot.joint_names))

    @property
    def height_m(self) -> float:
        """Height of its highest point above the floor [m]."""
        return float(_points(self.standing(0.0))[:, 2].max())

    @property
    def camera_height_m(self) -> float:
        """Height of its ego camera above the floor, standing settled [m]."""
        robot = self.robot
        base, default = (0.0, 0.0, robot.base_height_m), robot.default_joint_rad
        position, _ = self.body.camera_pose(robot.camera.name, base, (1, 0, 0, 0), default)
        return float(position[2])

    def standing(self, yaw_rad: float) -> RobotGeometryPose:
        """Return the pose, turned about the vertical."""
        base = (0.0, 0.0, self.robot.spawn_height_m)
        return self.body.pose(base, yaw_to_quat(yaw_rad), self.robot.default_joint_rad)


def turntable(studio: SceneRenderer, robot: RobotSpec, tile_px2: int = TURNTABLE_PX) -> Picture:
    """Return eight views around a robot with its name, height and mass: (H, W, 3) uint8 sRGB.

    Args:
        studio: from `make_studio`.
        tile_px2: area of a view [px].
    """
    standing = StandingRobot.of(robot)
    elevation, azimuth = np.deg2rad(ELEVATION_DEG), np.deg2rad(CAMERA_AZIMUTH_DEG)
    flat = np.cos(elevation)
    away = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    # The robot turns, not the light; the first view shows its front and left.
    first = azimuth - np.deg2rad(32.0)
    poses = [standing.standing(first + 2 * np.pi * k / VIEWS) for k in range(VIEWS)]
    points = np.concatenate([_points(pose) for pose in poses])
    shot = _Shot.framing(points, away=away, tile_px2=tile_px2)
    tiles = [shot.take(studio, pose) for pose in poses]
    shot.draw_height(tiles[0], _points(poses[0]), standing.height_m)
    camera = robot.camera
    facts = [f"{_meters(standing.height_m)} tall"]
    if robot.joints:  # a bodyless agent's mass is a placeholder
        facts.append(f"{robot.mass_kg:.3g} kg")
    tilt = f"{camera.pitch_down_deg:.0f}° down" if camera.pitch_down_deg else "level"
    facts.append(f"camera {_meters(standing.camera_height_m)}, {tilt}")
    return _sheet(tiles, COLUMNS, title=robot.title, facts=" · ".join(facts))


def walking_strip(
    studio: SceneRenderer, robot: RobotSpec, stroll: Stroll, tile_px2: int = STRIP_PX
) -> Picture:
    """Return twelve moments of a stroll from the side, (H, W, 3) uint8 sRGB; a row is one cycle.

    Args:
        studio: from `make_studio`.
        stroll: two cycles of its gait, along +x.
        tile_px2: area of a moment [px].
    """
    standing = StandingRobot.of(robot)
    ticks = np.linspace(0.0, 1.0, FRAMES, endpoint=False) * (len(stroll.time_s) - 1)
    moments = ticks.round().astype(int)
    # Every moment is moved back to the origin at the mean velocity, so that swaying stays visible.
    x, y = stroll.position_m[:, 0], stroll.position_m[:, 1]
    steady = np.polyval(np.polyfit(stroll.time_s, x, 1), stroll.time_s)
    middle, body = np.array([0.0, float(y.mean()), 0.0]), standing.body
    states = [
        (stroll.position_m[i] - middle, stroll.quat_wxyz[i], stroll.joint_rad[i]) for i in moments
    ]
    poses = [_turned_back(body.pose(*state)) for state in states]
    centers = [np.array([-steady[i], 0.0, 0.0]) for i in moments]
    points = np.concatenate([_points(p) - c for p, c in zip(poses, centers, strict=True)])
    elevation = np.deg2rad(6.0)
    away = np.array([0.0, np.cos(elevation), np.sin(elevation)])
    shot = _Shot.framing(points, away=away, tile_px2=tile_px2)
    tiles = []
    for i, pose, center in zip(moments, poses, centers, strict=True):
        tile = shot.take(studio, pose, center)
        _write(tile, (0.05, 0.935), f"{stroll.time_s[i]:.2f} s", 0.045, QUIET)
        tiles.append(tile)
    facts = f"{_meters(standing.height_m)} tall · {stroll.caption}"
    return _sheet(tiles, FRAMES // 2, title=robot.title, facts=facts)


@dataclass(frozen=True)
class _Shot:
    """A fixed camera that frames a robot around the origin."""

    camera: CameraModel
    position_m: Array
    quat_wxyz: Array
    view: Array  # world to optical frame, (3, 3)

    @classmethod
    def framing(cls, points: Array, *, away: Array, tile_px2: int) -> "_Shot":
        """Return a camera that looks along −`away` and frames all points (N, 3) tightly."""
        low, high = points.min(0), points.max(0)
        target = 0.5 * (low + high)
        quat = matrix_to_quat(look_at(target + away, target))
        forward = -away
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        view = np.array([right, np.cross(forward, right), forward], dtype=np.float64)
        seen = (points - target) @ view.T
        # At the distance of a portrait lens; the width of the picture follows the robot's.
        half = np.abs(seen[:, :2]).max(0) / (1 - 2 * MARGIN)
        focal = 0.5 / np.tan(0.5 * np.deg2rad(HFOV_DEG))
        distance = 2 * max(half) * focal - seen[:, 2].min()
        nearest = distance + seen[:, 2]
        half = (np.abs(seen[:, :2]) / nearest[:, None]).max(0) / (1 - 2 * MARGIN)
        aspect = max(half[0] / half[1], 0.5)
        width, height = round((tile_px2 * aspect) ** 0.5), round((tile_px2 / aspect) ** 0.5)
        hfov = np.rad2deg(2 * np.arctan(half[1] * width / height))
        camera = CameraModel("studio", FINER * width, FINER * height, float(hfov))
        return cls(camera, target + distance * away, quat, view)

    def take(
        self, studio: SceneRenderer, pose: RobotGeometryPose, center_m: Array | None = None
    ) -> Picture:
        """Render one tile, (H, W, 3)."""
        position = self.position_m if center_m is None else self.position_m + center_m
        rgb, _ = studio.render(self.camera, position, self.quat_wxyz, pose)
        image = Image.fromarray(rgb)
        size = (image.width // FINER, image.height // FINER)
        return np.array(image.resize(size, Image.Resampling.BOX))

    def pixel(self, point_m: Array) -> tuple[float, float]:
        """Return the position of a point in a tile [px]."""
        x, y, z = self.view @ (point_m - self.position_m)
        focal = self.camera.focal_px
        across = (focal * x / z + 0.5 * self.camera.width_px) / FINER
        return across, (focal * y / z + 0.5 * self.camera.height_px) / FINER

    def draw_height(self, tile: Picture, points: Array, height_m: float) -> None:
        """Draw a dimension line of the robot's height beside it, in place."""
        left = points[np.argmin(points @ self.view[0])]
        foot = np.array([left[0], left[1], 0.0]) - 0.05 * height_m * self.view[0]
        head = foot + np.array([0.0, 0.0, height_m])
        (x, bottom), (_, top) = self.pixel(foot), self.pixel(head)
        x = max(x, 0.03 * tile.shape[1])
        image = Image.fromarray(tile)
        draw = ImageDraw.Draw(image)
        draw.line([(x, top), (x, bottom)], fill=QUIET, width=2)
        for y in (top, bottom):
            draw.line([(x - 5, y), (x + 5, y)], fill=QUIET, width=2)
        tile[:] = np.asarray(image)
        share = (x / tile.shape[1] + 0.02, top / tile.shape[0] - 0.005)
        _write(tile, share, _meters(height_m), 0.045, QUIET)


def _turned_back(pose: RobotGeometryPose) -> RobotGeometryPose:
    """Turn a pose by 180° about the vertical, so that the lit left side faces the camera."""
    flip = np.array([-1.0, -1.0, 1.0])
    return RobotGeometryPose(
        pose.surfaces, pose.position_world_m * flip, pose.rotation_world * flip[:, None]
    )


def _points(pose: RobotGeometryPose) -> Array:
    """Return all corners of a posed body, world (N, 3) [m]."""
    parts = zip(pose.surfaces, pose.rotation_world, pose.position_world_m, strict=True)
    corners = [s.corners.reshape(-1, 3) @ turn.T + position for s, turn, position in parts]
    return np.concatenate(corners)


def _meters(value: float) -> str:
    return f"{value:.2f} m" if value >= 0.3 else f"{100 * value:.1f} cm"


def _write(
    tile: Picture, at: tuple[float, float], text: str, size: float, color: tuple[int, int, int]
) -> None:
    """Write text into a tile, in place; `at` and `size` are fractions of its sides and height."""
    image = Image.fromarray(tile)
    font = ImageFont.load_default(size=size * tile.shape[0])
    place = (at[0] * tile.shape[1], at[1] * tile.shape[0])
    ImageDraw.Draw(image).text(place, text, font=font, fill=color, anchor="ls")
    tile[:] = np.asarray(image)


def _sheet(tiles: Sequence[Picture], columns: int, *, title: str, facts: str) -> Picture:
    """Arrange tiles in rows under a line with the robot's name and facts."""
    rows = [tiles[k : k + columns] for k in range(0, len(tiles), columns)]
    picture = np.concatenate([np.concatenate(row, axis=1) for row in rows], axis=0)
    band = max(tiles[0].shape[0] // 6, picture.shape[1] // 36)
    head = Image.new("RGB", (picture.shape[1], band), (255, 255, 255))
    draw = ImageDraw.Draw(head)
    large, small = (ImageFont.load_default(size=share * band) for share in (0.48, 0.28))
    draw.text((0.35 * band, 0.68 * band), title, font=large, fill=INK, anchor="ls")
    right = head.width - 0.35 * band
    draw.text((right, 0.68 * band), facts, font=small, fill=QUIET, anchor="rs")
    return np.concatenate([np.asarray(head), picture], axis=0)
