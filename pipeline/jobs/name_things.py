"""Objects of scenes without labels, named by a vision-language model in frames along the paths."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from ...collectors.rendering.registry import make_renderer
from ...collectors.rendering.scene.robot_body import RobotBody
from ...collectors.robots import RobotSpec
from ...formats.core.camera import CameraModel
from ...formats.core.episode import Episode
from ...formats.core.frames import quat_to_matrix, yaw_to_quat
from ...formats.scene.bundle import LabeledObject, SceneBundle, load_bundle
from ...formats.vlnce.files import scene_stem
from ...instruction_gen.language.nouns import noun_of
from ...instruction_gen.llm.client import Client
from ...instruction_gen.llm.sight import View, name_things
from .visibility import looks_along

WIDTH_PX, HEIGHT_PX = 320, 240
EVERY = 4  # looks of `looks_along` from one frame to the next: two metres


def named_objects(
    episodes: Sequence[Episode], scenes: Path, robot: RobotSpec, client: Client
) -> dict[str, list[LabeledObject]]:
    """Return objects of the scenes that have no label with a known noun, by scene.

    Args:
        episodes: their paths are looked along; those of one trajectory share a path.
        scenes: folder of repaired scenes.
        robot: its camera looks.
        client: asks for `instruction_gen.llm.sight.Sights`.

    Raises:
        ModelDownError: the model fails again and again.
        BudgetError: no more may be spent.
    """
    paths: dict[str, dict[str, Episode]] = {}
    for episode in episodes:
        paths.setdefault(scene_stem(episode.scene_id), {})[episode.trajectory_id] = episode
    result = {}
    for scene, some in paths.items():
        bundle = load_bundle(scenes / scene)
        if not any(noun_of(o.category) for o in bundle.objects):
            result[scene] = name_things(client, _views(bundle, list(some.values()), robot))
    return result


def _views(bundle: SceneBundle, episodes: Sequence[Episode], robot: RobotSpec) -> list[View]:
    body = RobotBody(robot.build_model(floor=False), robot.joint_names)
    defaults = [joint.default_rad for joint in robot.joints]
    camera = CameraModel("look", WIDTH_PX, HEIGHT_PX, robot.camera.model.hfov_deg)
    row, column = np.indices((HEIGHT_PX, WIDTH_PX))
    ray = np.stack(
        [
            (column - (WIDTH_PX - 1) / 2) / camera.focal_px,
            (row - (HEIGHT_PX - 1) / 2) / camera.focal_px,
            np.ones(row.shape),
        ],
        axis=-1,
    )
    renderer = make_renderer(bundle)
    views = []
    for episode in episodes:
        for _, point, yaw in looks_along(episode.reference_path_world_m)[::EVERY]:
            stand = (*point[:2], point[2] + robot.base_height_m)
            position, quat = body.camera_pose(robot.camera.name, stand, yaw_to_quat(yaw), defaults)
            frame = renderer.render_labelled(camera, position, quat)
            depth = np.where(frame.depth_m > 0, frame.depth_m, np.nan)
            points = (ray * depth[..., None]) @ quat_to_matrix(quat).T + position
            png = cv2.imencode(".png", np.ascontiguousarray(frame.rgb[..., ::-1]))[1].tobytes()
            views.append(View(png, points, episode.level))
    return views
