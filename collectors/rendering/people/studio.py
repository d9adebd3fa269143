"""Portraits of a robot on an endless floor: a turntable and a strip of its walk."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ....formats.core.camera import CameraModel
from ....formats.core.frames import yaw_to_quat
from ....formats.scene.bundle import Material, SceneBundle, VisualMesh, save_bundle
from ...robots import RobotSpec
from ...stroll import Stroll
from ..camera.chase import look_at
from ..embree import SceneRenderer
from ..scene.robot_body import RobotBody, RobotGeometryPose

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

TURNTABLE_PX, STRIP_PX = 250_000, 130_000  # area of a tile
FINER = 2  # pictures are rendered so many times larger and averaged down
VIEWS, COLUMNS = 8, 4
FRAMES = 12
MARGIN = 0.09  # of a tile, around the robot
HFOV_DEG = 24.0
ELEVATION_DEG = 13.0
# The light comes from the viewer's upper left.
CAMERA_AZIMUTH_DEG = 18.0
FLOOR_M, FLOOR_PX = 16.0, 2048  # side of the floor for a robot about a metre tall
NEAR_SRGB, FAR_SRGB, TOP_SRGB = (238, 238, 236), (205, 211, 219), (168, 178, 191)
INK, QUIET = (38, 42, 48), (98, 106, 116)


def make_studio(robot: RobotSpec) -> SceneRenderer:
    """A renderer of nothing but a floor with a fine grid that fades into the background.

    Its lines are 1 m and 0.25 m apart; for a robot the size of a toy a tenth of that.
    """
    scale = 10.0 ** round(math.log10(Sitter.of(robot).height_m))
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        Image.fromarray(_floor_picture()).save(root / "floor.png")
        Image.fromarray(_sky_picture()).save(root / "sky.png")
        bundle = SceneBundle(
            root=root,
            scene_id="studio",
            source={},
            source_to_world=np.eye(4),
            habitat_to_world=np.eye(4),
            materials=(
                Material("floor", (1.0, 1.0, 1.0), "floor.png"),
                Material("sky", (1.0, 1.0, 1.0), "sky.png"),
            ),
            labels=("studio",),
            objects=(),
            level_floor_z_m=(0.0,),
        )
        save_bundle(bundle, _mesh(scale), [])
        return SceneRenderer(bundle)


def _floor_picture() -> Picture:
    """Bright in the middle, with lines, and at the rim of the background's colour."""
    meters = (np.arange(FLOOR_PX, dtype=np.float32) + 0.5) / FLOOR_PX * FLOOR_M - 0.5 * FLOOR_M
    distance = np.hypot(meters[:, None], meters[None])
    fade = np.clip((distance - 0.8) / (0.42 * FLOOR_M - 0.8), 0.0, 1.0)[..., None] ** 0.8
    near, far = (np.array(color, dtype=np.float32) for color in (NEAR_SRGB, FAR_SRGB))
    color = near + fade * (far - near)
    for spacing, width, depth in ((0.25, 0.010, 9.0), (1.0, 0.016, 15.0)):
        off = np.abs((meters + 0.5 * spacing) % spacing - 0.5 * spacing)
        line = np.clip(1.3 - off / (0.5 * width), 0.0, 1.0)
        color -= depth * (1 - fade) * np.maximum(line[:, None], line[None])[..., None]
    return np.round(color).astype(np.uint8)


def _sky_picture() -> Picture:
    """The floor's rim below, darker towards the top: rows of one colour."""
    share = np.linspace(1.0, 0.0, 256)[:, None, None] ** 0.7
    rows = (1 - share) * np.array(FAR_SRGB) + share * np.array(TOP_SRGB)
    return np.round(np.repeat(rows, 8, axis=1)).astype(np.uint8)


def _mesh(scale: float) -> VisualMesh:
    """A square floor in a high round wall."""
    side = scale * FLOOR_M
    half = 0.5 * side
    corners = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    floor = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)
    wall = trimesh.creation.cylinder(0.99 * half, 2 * half, sections=96)
    wall.update_faces(np.abs(wall.face_normals[:, 2]) < 0.5)
    wall.apply_translation([0.0, 0.0, half - 0.001 * scale])
    vertices = np.concatenate([floor.vertices, wall.vertices])
    faces = np.concatenate([floor.faces, wall.faces + len(floor.vertices)])
    corner = vertices[faces]
    uv = corner[..., :2] / side + 0.5
    uv[2:, :, 0], uv[2:, :, 1] = 0.5, np.clip(corner[2:, :, 2] / (2 * half), 0.01, 0.99)
    material = np.where(np.arange(len(faces)) < 2, 0, 1)
    return VisualMesh(
        vertices=vertices.astype(np.float32),
        faces=faces.astype(np.int32),
        corner_uv=uv.astype(np.float32),
        face_material=material.astype(np.int32),
        face_label=np.zeros(len(faces), dtype=np.int32),
    )


@dataclass(frozen=True)
class Sitter:
    """A robot standing in its default pose, its soles on the floor.

    Attributes:
        robot: Robot to render.
        body: its shapes.
        lower_m, upper_m: (3,) bounds of everything that is seen of it.
    """

    robot: RobotSpec
    body: RobotBody
    lower_m: Array
    upper_m: Array

    @classmethod
    def of(cls, robot: RobotSpec) -> Sitter:
        """Stand `robot` up."""
        body = RobotBody(robot.build_model(floor=False), robot.joint_names)
        points = _points(cls._standing(robot, body, 0.0))
        return cls(robot, body, points.min(0), points.max(0))

    @staticmethod
    def _standing(robot: RobotSpec, body: RobotBody, yaw_rad: float) -> RobotGeometryPose:
        base = (0.0, 0.0, robot.spawn_height_m)
        return body.pose(base, yaw_to_quat(yaw_rad), robot.default_joint_rad)

    @property
    def height_m(self) -> float:
        """From the floor to its highest point [m]."""
        return float(self.upper_m[2])

    @property
    def camera_height_m(self) -> float:
        """From the floor to its ego camera, standing settled [m]."""
        robot = self.robot
        base, default = (0.0, 0.0, robot.base_height_m), robot.default_joint_rad
        position, _ = self.body.camera_pose(robot.camera.name, base, (1, 0, 0, 0), default)
        return float(position[2])

    def standing(self, yaw_rad: float) -> RobotGeometryPose:
        """The pose, turned."""
        return self._standing(self.robot, self.body, yaw_rad)


def turntable(studio: SceneRenderer, robot: RobotSpec, tile_px2: int = TURNTABLE_PX) -> Picture:
    """Eight views all around a robot, with its name, height and mass: (H, W, 3) uint8 sRGB.

    Args:
        studio: from `make_studio`.
        robot: Robot to render.
        tile_px2: area of a view.
    """
    sitter = Sitter.of(robot)
    elevation, azimuth = np.deg2rad(ELEVATION_DEG), np.deg2rad(CAMERA_AZIMUTH_DEG)
    away = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    # The robot turns, not the light; the first view shows its front and left.
    first = azimuth - np.deg2rad(32.0)
    poses = [sitter.standing(first + 2 * np.pi * k / VIEWS) for k in range(VIEWS)]
    points = np.concatenate([_points(pose) for pose in poses])
    shot = _Shot.framing(points, away, tile_px2)
    tiles = [shot.take(studio, pose) for pose in poses]
    shot.draw_height(tiles[0], _points(poses[0]), sitter.height_m)
    camera = robot.camera
    facts = [f"{_meters(sitter.height_m)} tall"]
    if robot.joints:  # a bodyless agent's mass is a stand-in
        facts.append(f"{robot.mass_kg:.3g} kg")
    tilt = f"{camera.pitch_down_deg:.0f}° down" if camera.pitch_down_deg else "level"
    facts.append(f"camera {_meters(sitter.camera_height_m)}, {tilt}")
    return _sheet(tiles, COLUMNS, robot.title, " · ".join(facts))


def walking_strip(
    studio: SceneRenderer, robot: RobotSpec, stroll: Stroll, tile_px2: int = STRIP_PX
) -> Picture:
    """Twelve moments of a stroll seen from the side, (H, W, 3) uint8 sRGB; a row is one cycle.

    Args:
        studio: from `make_studio`.
        robot: Robot to render.
        stroll: two cycles of its gait, along +x or on the spot.
        tile_px2: area of a moment.
    """
    sitter = Sitter.of(robot)
    ticks = np.linspace(0.0, 1.0, FRAMES, endpoint=False) * (len(stroll.time_s) - 1)
    moments = ticks.round().astype(int)
    # Every moment is moved back to the origin by the mean way, so that swaying still shows.
    x, y = stroll.position_m[:, 0], stroll.position_m[:, 1]
    way = np.polyval(np.polyfit(stroll.time_s, x, 1), stroll.time_s)
    middle = np.array([0.0, float(y.mean()), 0.0])
    poses = [
        _turned_back(
            sitter.body.pose(
                stroll.position_m[i] - middle, stroll.quat_wxyz[i], stroll.joint_rad[i]
            )
        )
        for i in moments
    ]
    centers = [np.array([-way[i], 0.0, 0.0]) for i in moments]
    points = np.concatenate([_points(p) - c for p, c in zip(poses, centers, strict=True)])
    elevation = np.deg2rad(6.0)
    away = np.array([0.0, np.cos(elevation), np.sin(elevation)])
    shot = _Shot.framing(points, away, tile_px2)
    tiles = []
    for i, pose, center in zip(moments, poses, centers, strict=True):
        tile = shot.take(studio, pose, center)
        _write(tile, (0.05, 0.935), f"{stroll.time_s[i]:.2f} s", 0.045, QUIET)
        tiles.append(tile)
    facts = f"{_meters(sitter.height_m)} tall · {stroll.doing} · {stroll.cycles}"
    return _sheet(tiles, FRAMES // 2, robot.title, facts)


@dataclass(frozen=True)
class _Shot:
    """A fixed camera that frames a robot around the origin."""

    camera: CameraModel
    position_m: Array
    quat_wxyz: Array
    view: Array  # world to optical frame, (3, 3)

    @classmethod
    def framing(cls, points: Array, away: Array, tile_px2: int) -> _Shot:
        """Look along −`away` so that all points (N, 3) fit, in a tile no wider than needed."""
        low, high = points.min(0), points.max(0)
        target = 0.5 * (low + high)
        quat = look_at(target + away, target)
        forward = -away
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        view = np.array([right, np.cross(forward, right), forward], dtype=np.float64)
        seen = (points - target) @ view.T
        # From as far as a portrait lens: the picture's width follows the robot's.
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
        """One tile, (H, W, 3)."""
        position = self.position_m if center_m is None else self.position_m + center_m
        rgb, _ = studio.render(self.camera, position, self.quat_wxyz, pose)
        image = Image.fromarray(rgb)
        size = (image.width // FINER, image.height // FINER)
        return np.array(image.resize(size, Image.Resampling.BOX))

    def pixel(self, point_m: Array) -> tuple[float, float]:
        """Where a point is in a tile [px]."""
        x, y, z = self.view @ (point_m - self.position_m)
        focal = self.camera.focal_px
        across = (focal * x / z + 0.5 * self.camera.width_px) / FINER
        return across, (focal * y / z + 0.5 * self.camera.height_px) / FINER

    def draw_height(self, tile: Picture, points: Array, height_m: float) -> None:
        """Draw a dimension line from the floor to the robot's top beside it, in place."""
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
    """Half a turn about the vertical: a walk along +x then leads to −x, with its left lit."""
    flip = np.array([-1.0, -1.0, 1.0])
    return RobotGeometryPose(
        pose.surfaces, pose.position_world_m * flip, pose.rotation_world * flip[:, None]
    )


def _points(pose: RobotGeometryPose) -> Array:
    """All corners of a posed body, world (N, 3) [m]."""
    return np.concatenate(
        [
            surface.corners.reshape(-1, 3) @ rotation.T + position
            for surface, rotation, position in zip(
                pose.surfaces, pose.rotation_world, pose.position_world_m, strict=True
            )
        ]
    )


def _meters(value: float) -> str:
    return f"{value:.2f} m" if value >= 0.3 else f"{100 * value:.1f} cm"


def _write(
    tile: Picture, at: tuple[float, float], text: str, size: float, color: tuple[int, int, int]
) -> None:
    """Write text into a tile, in place; `at` and `size` are shares of its sides and its height."""
    image = Image.fromarray(tile)
    font = ImageFont.load_default(size=size * tile.shape[0])
    place = (at[0] * tile.shape[1], at[1] * tile.shape[0])
    ImageDraw.Draw(image).text(place, text, font=font, fill=color, anchor="ls")
    tile[:] = np.asarray(image)


def _sheet(tiles: Sequence[Picture], columns: int, title: str, facts: str) -> Picture:
    """Tiles in rows under a line with the robot's name and facts."""
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
