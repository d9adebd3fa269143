"""A LeRobot dataset of walks that were really replayed and rendered, in a few seconds."""

from collections.abc import Sequence
from pathlib import Path

from vlnpe.collectors.replay.replay import ReplayConfig, replay_in
from vlnpe.collectors.replay.world import open_world
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.rollout import Rollout
from vlnpe.formats.lerobot import assemble_dataset, write_episode_unit
from vlnpe.formats.rendered.folder import read_frame_folder
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.rendering.camera.rollout_views import render_rollout
from vlnpe.rendering.camera.views import View
from vlnpe.rendering.registry import make_renderer


def write_walks(
    root: Path, bundle: SceneBundle, episodes: Sequence[Episode], view: View, robot: str = "vlnce"
) -> list[Rollout]:
    """Write `root/lerobot/<robot>`, of the expert's walks under flash; return the rollouts."""
    world = open_world(bundle, 0, get_robot(robot))
    renderer = make_renderer(bundle, view.renderer, light=view.light)
    rollouts, units = [], []
    for episode in episodes:
        rollout = replay_in(world, episode, ReplayConfig(robot=robot, controller="flash"))
        frames, unit = (root / kind / episode.episode_id for kind in ("frames", "units"))
        render_rollout(bundle, renderer, rollout, view, frames, robot=world.robot)
        unit.parent.mkdir(parents=True, exist_ok=True)
        write_episode_unit(unit, rollout, read_frame_folder(frames))
        rollouts.append(rollout)
        units.append(unit)
    assemble_dataset(units, root / "lerobot" / robot, provenance={}, licence="mit", title=robot)
    return rollouts
