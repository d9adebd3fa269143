"""Write rendered episodes as MCAP files that Foxglove shows."""

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np

from ....collectors.robots import RobotSpec
from ....formats.convert.facts import DatasetFacts
from ....formats.core.licences import licence_id
from ....formats.core.rollout import Rollout
from ....formats.mcap.episode import write_episode_mcap
from ....formats.mcap.robot_links import robot_topics
from ....formats.mcap.rollout import SHOW_EVERY
from ....formats.mcap.shown import ShownTopic, map_topic
from ....formats.rendered.folder import read_frame_folder
from ....formats.scene.bundle import SceneBundle, load_bundle
from ....rendering.scene.link_shapes import robot_links
from ...engine.work import ItemResult
from ...provenance import encoding_facts, scene_provenance
from ..rollouts.handover import DepthKeeper
from .reviewed import reviewed_rollout


@dataclass(frozen=True)
class McapJob:
    """Write one episode's MCAP, which knows the dataset it belongs to.

    Attributes:
        held_out: scenes that are held out for validation.
        review: what people decided about the instructions, if there is such a file.
        code_sha256: digest of the code that made the episode and its pixels.
        depth: holds the depth codes of `frames`, or nothing: then the video is decoded.
    """

    rollout: Path
    frames: Path
    scene: Path
    robot: RobotSpec
    name: str
    held_out: tuple[str, ...]
    depth_storage: str
    review: Path
    code_sha256: str
    out: Path
    depth: DepthKeeper = field(default_factory=DepthKeeper, compare=False)

    def run(self) -> ItemResult:
        """Write one episode's MCAP."""
        bundle = _bundle(self.scene)
        seen = read_frame_folder(self.frames)
        encoding = encoding_facts(seen.facts, self.depth_storage)
        facts = DatasetFacts(
            self.name,
            licence_id(str(bundle.source.get("licence") or "")),
            scene_provenance(bundle, self.held_out, encoding, self.code_sha256),
            depth_storage=self.depth_storage,
        )
        recorded = reviewed_rollout(self.rollout, self.review)
        links = robot_links(_body(self.robot), recorded, SHOW_EVERY)
        write_episode_mcap(
            self.out,
            recorded,
            self.frames,
            shown=(maps_on_the_way(bundle, recorded), *robot_topics(links)),
            dataset=facts.to_json(),
            depth_codes=self.depth.of(seen.depth_video),
        )
        return ItemResult({"bytes": self.out.stat().st_size})


def maps_on_the_way(bundle: SceneBundle, rollout: Rollout) -> ShownTopic:
    """Return the map of the level on which the robot is; stairs change it halfway."""
    episode = rollout.episode
    levels = episode.levels_along(rollout.position_world_m)
    changes = np.flatnonzero(np.diff(levels)) + 1
    later = ((float(rollout.time_s[k]), int(levels[k])) for k in changes)
    return _maps(bundle.root, ((0.0, episode.level), *later), episode.free_height_m)


# The same for all episodes of a scene and robot; they take a tenth of writing one.
@lru_cache(maxsize=1)
def _bundle(scene: Path) -> SceneBundle:
    return load_bundle(scene)


@lru_cache(maxsize=4)
def _maps(scene: Path, starts: tuple[tuple[float, int], ...], free_height_m: float) -> ShownTopic:
    maps = ((at_s, _bundle(scene).freemap(level)) for at_s, level in starts)
    return map_topic(*((at_s, freemap.for_height(free_height_m)) for at_s, freemap in maps))


@lru_cache(maxsize=4)
def _body(robot: RobotSpec) -> mujoco.MjModel:
    return robot.build_model(floor=False)
