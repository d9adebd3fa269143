"""Things and rooms of a scene without labels, named by a vision-language model along its paths."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from pydantic import BaseModel

from ....collectors.robots import RobotSpec
from ....formats.core.episode import Episode
from ....formats.core.frames import quat_to_matrix
from ....formats.scene.bundle import SceneBundle, load_bundle
from ....formats.vlnce.files import read_episodes
from ....instruction_gen.facts.named import Named, write_named
from ....instruction_gen.language.nouns import noun_of, room_of
from ....instruction_gen.llm.budget import Budget
from ....instruction_gen.llm.client import Client, openai_backend
from ....instruction_gen.llm.rooms import RoomSight, name_rooms
from ....instruction_gen.llm.settings import LlmSettings
from ....instruction_gen.llm.sight import Sights, Tally, View, name_things
from ....rendering.registry import make_renderer
from ....wayfinding.regions import ROOM_PREFIX, region_map
from ...engine.work import ItemResult
from .visibility import StandingEye, looks_along

WIDTH_PX, HEIGHT_PX = 320, 240
EVERY = 4  # looks of `looks_along` from one frame to the next: two metres


@dataclass(frozen=True)
class NameThingsJob:
    """Name what the camera sees along the paths of one scene's episodes.

    Attributes:
        episodes: Files; of each, the episodes in the scene are looked at.
        robot: The robot whose camera looks.
        every: Also along paths that have an instruction already.
        cache: Folder of the model's answers.
    """

    scene: Path
    episodes: tuple[Path, ...]
    settings: LlmSettings
    robot: RobotSpec
    every: bool
    cache: Path
    out: Path

    def run(self) -> ItemResult:
        """Name the things and the rooms, whichever the scene has no labels for.

        Raises:
            ModelDownError: The model fails again and again.
            BudgetError: No more may be spent.
        """
        targets = [e for path in self.episodes for e in read_episodes(path)]
        targets = [e for e in targets if self.every or not e.instruction]
        bundle = load_bundle(self.scene)
        things, rooms = lacking(bundle)
        if not (targets and (things or rooms)):
            write_named(self.out, None)
            return ItemResult({"labelled": not (things or rooms)})
        views = views_along(bundle, targets, self.robot)
        named, seen, entered = Named(), Tally(), Tally()
        if things:
            objects, seen = name_things(self._client(Sights), views)
            named = Named(tuple(objects))
        if rooms:
            furnished = replace(bundle, objects=(*bundle.objects, *named.objects))
            regions = {k: region_map(furnished, k) for k in {view.level for view in views}}
            rooms_named, entered = name_rooms(self._client(RoomSight), views, regions)
            named = replace(named, rooms=tuple(rooms_named))
        write_named(self.out, named)
        used = Budget(self.cache / "usage.json", self.settings).used()
        return ItemResult(
            {
                "labelled": False,
                "things": len(named.objects),
                "rooms": len(named.rooms),
                "asked_for_things": asdict(seen),
                "asked_for_rooms": asdict(entered),
                "language_model": asdict(used),
            }
        )

    def _client(self, form: type[BaseModel]) -> Client:
        return Client(self.settings, self.cache, openai_backend(self.settings, form=form))


def lacking(bundle: SceneBundle) -> tuple[bool, bool]:
    """Return whether a scene has no label of a known thing, and none of a known kind of room."""
    labels = [o.category for o in bundle.objects]
    kinds = [label[len(ROOM_PREFIX) :] for label in labels if label.startswith(ROOM_PREFIX)]
    return not any(noun_of(label) for label in labels), not any(room_of(kind) for kind in kinds)


def views_along(bundle: SceneBundle, episodes: Sequence[Episode], robot: RobotSpec) -> list[View]:
    """Return frames along the paths of episodes, each picture once.

    Args:
        episodes: those of one trajectory share a path.
    """
    eye = StandingEye(robot)
    ray = eye.camera.pixel_rays()
    renderer = make_renderer(bundle)
    views: dict[bytes, View] = {}
    for episode in {episode.trajectory_id: episode for episode in episodes}.values():
        looks = looks_along(episode.reference_path_world_m)[::EVERY]
        levels = episode.levels_along(np.array([point for _, point, _ in looks])).tolist()
        for (_, point, yaw), level in zip(looks, levels, strict=True):
            position, quat = eye.pose(point, yaw)
            frame = renderer.render_labelled(eye.camera, position, quat)
            depth = np.where(frame.depth_m > 0, frame.depth_m, np.nan)
            points = (ray * depth[..., None]) @ quat_to_matrix(quat).T + position
            png = cv2.imencode(".png", np.ascontiguousarray(frame.rgb[..., ::-1]))[1].tobytes()
            views.setdefault(png, View(png, points, position, level))
    return list(views.values())
