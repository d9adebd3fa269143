"""Objects that the robot's own camera sees along the paths, for the instructions.

Images are small and drawn every half metre: they name pixels, they are not looked at. The camera
stands where the robot's does when it stands, and looks along the path.
"""

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....collectors.robots import RobotSpec
from ....formats.core.camera import CameraModel
from ....formats.core.episode import Episode
from ....formats.core.frames import quat_to_matrix, yaw_to_quat
from ....formats.core.geometry import path_length, point_along_plan, resample, triangle_areas
from ....formats.scene.bundle import SceneBundle, VisualMesh, load_bundle
from ....formats.scene.visibility import Glimpse, PathSight, SightCamera, visibility_writer
from ....formats.vlnce.files import read_episodes
from ....rendering.frame import Frame
from ....rendering.scene.robot_body import RobotBody
from ...engine.work import ItemResult
from ..scenes.renderer import scene_renderer

WIDTH_PX, HEIGHT_PX = 128, 96
SPACING_M = 0.5
_AHEAD_M = 0.4
_OUTLINE_POINTS = 300
_NEARER_M = 0.08  # what covers an object is at least this much nearer


@dataclass(frozen=True)
class LookJob:
    """Look along the paths of one scene's episodes.

    Attributes:
        every: also along paths that have an instruction already.
    """

    scene: Path
    episodes: Path
    out: Path
    robot: RobotSpec
    every: bool

    def run(self) -> ItemResult:
        """Write what is seen along each path of an episode file."""
        started = time.process_time()
        targets = [e for e in read_episodes(self.episodes) if self.every or not e.instruction]
        eye = StandingEye(self.robot)
        paths = images = 0
        with visibility_writer(self.out, eye.described()) as write:
            for trajectory_id, sight in look(load_bundle(self.scene), targets, eye):
                write(trajectory_id, sight)
                paths, images = paths + 1, images + len(sight.looks_m)
        used = round(time.process_time() - started, 2)
        return ItemResult(
            {"robot": self.robot.name, "paths": paths, "images": images, "cpu_s": used}
        )


def look(
    bundle: SceneBundle, episodes: Iterable[Episode], eye: "StandingEye"
) -> Iterator[tuple[str, PathSight]]:
    """Render ids along the reference paths; yield each trajectory's id with what is seen."""
    paths: dict[str, NDArray[np.float64]] = {}
    for episode in episodes:
        paths.setdefault(episode.trajectory_id, episode.reference_path_world_m)
    # Where nothing has a name, or nothing is asked, a renderer would be built for nothing.
    if not paths or all(":" in thing.category for thing in bundle.objects):
        return
    camera, (_, renderer) = eye.camera, scene_renderer(bundle.root, "embree")
    counter = _Counter(bundle, bundle.visual(), camera)
    for trajectory_id, path_m in paths.items():
        poses, glimpses = looks_along(path_m), []
        for along, point, yaw in poses:
            position, quat = eye.pose(point, yaw)
            frame = renderer.render_labelled(camera, position, quat)
            glimpses += counter.glimpses(frame, along, position, quat_to_matrix(quat))
        yield trajectory_id, PathSight(tuple(a for a, _, _ in poses), tuple(glimpses))


class StandingEye:
    """The robot's own camera, as it stands."""

    def __init__(self, robot: RobotSpec):
        self._robot = robot
        self.camera = CameraModel("look", WIDTH_PX, HEIGHT_PX, robot.camera.model.hfov_deg)
        self._body = RobotBody(robot.build_model(floor=False), robot.joint_names)

    def pose(
        self, floor_m: ArrayLike, yaw_rad: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return position (3,) [m] and quat_wxyz (4,) of the optical frame of a robot on a floor.

        Args:
            floor_m: (3,) floor under the base.
        """
        x, y, z = np.asarray(floor_m, np.float64)
        base = (x, y, z + self._robot.base_height_m)
        return self._body.camera_pose(
            self._robot.camera.name, base, yaw_to_quat(yaw_rad), self._robot.default_joint_rad
        )

    def described(self) -> SightCamera:
        """Return what the camera is, for the record."""
        mount = self._robot.camera
        lens, _ = self.pose((0.0, 0.0, 0.0), 0.0)
        return SightCamera(
            self._robot.name, WIDTH_PX, HEIGHT_PX, mount.model.hfov_deg, round(float(lens[2]), 3),
            mount.pitch_down_deg, SPACING_M,
        )  # fmt: skip


def looks_along(path_m: NDArray[np.float64]) -> list[tuple[float, NDArray[np.float64], float]]:
    """Return distance [m], point (3,) [m], heading [rad] of each look along a path (P, 3) [m].

    Distances are those in plan, as in the facts of a path.
    """
    points = resample(path_m, 0.1)
    length = path_length(points[:, :2])
    at = np.linspace(0.0, length, max(2, round(length / SPACING_M) + 1))
    here = point_along_plan(points, at)
    ahead = point_along_plan(points, np.minimum(at + _AHEAD_M, length))
    behind = point_along_plan(points, np.maximum(np.minimum(at, length - _AHEAD_M), 0.0))
    delta = ahead - behind
    return [
        (float(a), p, float(np.arctan2(d[1], d[0])))
        for a, p, d in zip(at, here, delta, strict=True)
    ]


class _Counter:
    """Counts what images show: the objects' own faces or, without those, their boxes."""

    def __init__(self, bundle: SceneBundle, mesh: VisualMesh, camera: CameraModel):
        self._things, self._camera = bundle.objects, camera
        self._outlines = _outlines(mesh, len(bundle.objects))
        self._boxed = not (mesh.face_object >= 0).any()
        named = [k for k, o in enumerate(bundle.objects) if ":" not in o.category]
        size = [float(np.prod(np.subtract(o.upper_m, o.lower_m))) for o in bundle.objects]
        # The largest first, so that the smallest box around a pixel names it.
        self._named = sorted(named, key=lambda k: -size[k])

    def glimpses(
        self,
        frame: Frame,
        along_m: float,
        position_m: NDArray[np.float64],
        rotation: NDArray[np.float64],
    ) -> list[Glimpse]:
        """Return what one image shows, by object."""
        ids = self._by_box(frame, position_m, rotation) if self._boxed else frame.thing
        counts = np.bincount(ids[ids >= 0].ravel(), minlength=len(self._things))
        result = []
        for k in np.flatnonzero(counts):
            mask = ids == k
            red, green, blue = np.median(frame.rgb[mask], axis=0).astype(int).tolist()
            occluded = self._occluded(int(k), ids, frame.depth_m, position_m, rotation)
            thing = self._things[k].name
            result.append(Glimpse(thing, along_m, int(counts[k]), occluded, (red, green, blue)))
        return result

    def _occluded(
        self,
        thing: int,
        ids: NDArray[np.int32],
        depth_m: NDArray[np.float32],
        position_m: NDArray[np.float64],
        rotation: NDArray[np.float64],
    ) -> float:
        """Return the fraction of the object's points in the image that something nearer covers."""
        points = self._outlines.get(thing)
        if points is None:
            return 0.0
        camera = self._camera
        seen = (points - position_m) @ rotation
        seen = seen[seen[:, 2] > 0.05]
        pixel = seen[:, :2] / seen[:, 2:] * camera.focal_px
        column = np.rint(pixel[:, 0] + (camera.width_px - 1) / 2).astype(int)
        row = np.rint(pixel[:, 1] + (camera.height_px - 1) / 2).astype(int)
        inside = (row >= 0) & (row < camera.height_px) & (column >= 0) & (column < camera.width_px)
        if not inside.any():
            return 0.0
        # One vote per pixel, by the nearest of its points: far sides are hidden by near ones.
        order = np.argsort(seen[inside, 2])
        code = (row * camera.width_px + column)[inside][order]
        code, first = np.unique(code, return_index=True)
        far = seen[inside, 2][order][first]
        row, column = np.divmod(code, camera.width_px)
        near = depth_m[row, column]
        hidden = (ids[row, column] != thing) & (near > 0) & (near < far - _NEARER_M)
        return float(hidden.mean())

    def _by_box(
        self, frame: Frame, position_m: NDArray[np.float64], rotation: NDArray[np.float64]
    ) -> NDArray[np.int32]:
        camera, depth = self._camera, frame.depth_m
        points = (camera.pixel_rays() * depth[..., None]) @ rotation.T + position_m
        ids = np.full(depth.shape, -1, dtype=np.int32)
        for k in self._named:
            low, high = np.array(self._things[k].lower_m), np.array(self._things[k].upper_m)
            inside = ((points > low - 0.03) & (points < high + 0.03)).all(axis=-1) & (depth > 0)
            ids[inside] = k
        return ids


def _outlines(mesh: VisualMesh, things: int) -> dict[int, NDArray[np.float64]]:
    """Sample points (≤ 300, 3) [m] on each object's surface, uniformly by area."""
    rng = np.random.default_rng(0)
    result = {}
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    area = triangle_areas(corners)
    for k in range(things):
        faces = np.flatnonzero(mesh.face_object == k)
        if not len(faces) or area[faces].sum() <= 0:
            continue
        share = area[faces] / area[faces].sum()
        pick = faces[rng.choice(len(faces), _OUTLINE_POINTS, p=share)]
        u, v = rng.random((2, _OUTLINE_POINTS, 1))
        flip = u + v > 1
        u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
        a, b, c = corners[pick, 0], corners[pick, 1], corners[pick, 2]
        result[k] = a + u * (b - a) + v * (c - a)
    return result
