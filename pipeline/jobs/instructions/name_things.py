"""Objects of scenes without labels, named by a vision-language model in frames along the paths."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np

from ....collectors.rendering.registry import make_renderer
from ....collectors.robots import RobotSpec, get_robot
from ....formats.core.atomic import write_json
from ....formats.core.camera import CameraModel
from ....formats.core.episode import Episode
from ....formats.core.frames import quat_to_matrix
from ....formats.scene.bundle import LabeledObject, SceneBundle, load_bundle
from ....formats.vlnce.files import read_episodes, scene_stem
from ....instruction_gen.language.nouns import noun_of
from ....instruction_gen.llm.client import Client, openai_backend
from ....instruction_gen.llm.settings import LlmSettings
from ....instruction_gen.llm.sight import Sights, View, name_things
from ...engine.work import ItemResult
from .visibility import StandingEye, looks_along

WIDTH_PX, HEIGHT_PX = 320, 240
EVERY = 4  # looks of `looks_along` from one frame to the next: two metres


@dataclass(frozen=True)
class NameThingsJob:
    """Name what the camera sees along the paths of one episode file.

    Attributes:
        robot: Name or folder of the robot whose camera looks.
        out: JSON file to write: objects by scene.
    """

    scenes: Path
    episodes: Path
    settings: LlmSettings
    robot: str
    cache: Path
    out: Path

    def run(self) -> ItemResult:
        """Name the things of the scenes that have no labels.

        Raises:
            ModelDownError: The model fails again and again.
            BudgetError: No more may be spent.
        """
        client = Client(self.settings, self.cache, openai_backend(self.settings, form=Sights))
        robot = get_robot(self.robot)
        found = named_objects(read_episodes(self.episodes), self.scenes, robot, client)
        written = {scene: [asdict(one) for one in objects] for scene, objects in found.items()}
        write_json(self.out, written)
        named = {scene: len(objects) for scene, objects in found.items()}
        return ItemResult({"named_things": named, "language_model": asdict(client.budget.used())})


def named_objects(
    episodes: Sequence[Episode], scenes: Path, robot: RobotSpec, client: Client
) -> dict[str, list[LabeledObject]]:
    """Return objects of the scenes that have no label with a known noun, by scene.

    Args:
        episodes: their paths are looked along; those of one trajectory share a path.
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
    eye = StandingEye(robot)
    camera = CameraModel("look", WIDTH_PX, HEIGHT_PX, robot.camera.model.hfov_deg)
    ray = camera.pixel_rays()
    renderer = make_renderer(bundle)
    views = []
    for episode in episodes:
        for _, point, yaw in looks_along(episode.reference_path_world_m)[::EVERY]:
            position, quat = eye.pose(point, yaw)
            frame = renderer.render_labelled(camera, position, quat)
            depth = np.where(frame.depth_m > 0, frame.depth_m, np.nan)
            points = (ray * depth[..., None]) @ quat_to_matrix(quat).T + position
            png = cv2.imencode(".png", np.ascontiguousarray(frame.rgb[..., ::-1]))[1].tobytes()
            views.append(View(png, points, episode.level))
    return views
