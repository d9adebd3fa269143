"""The stage that makes rollouts of drives: what was recorded once stays."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.collectors.test_driving import AHEAD, LEFT, Driver
from tests.collectors.test_replay import make_episode
from vlnpe.collectors.replay.world import open_world
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.core.rollout import EndReason
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.pipeline.stages.rollouts.drive_items import drive_walker
from vlnpe.pipeline.stages.rollouts.drive_job import DriveJob
from vlnpe.pipeline.stages.rollouts.replay_job import Walker

pytestmark = pytest.mark.chain


def test_a_recorded_drive_stays_when_words_or_physics_change(
    two_rooms: SceneBundle, tmp_path: Path
) -> None:
    robot = get_robot("jetbot")
    episode = make_episode(two_rooms)
    driver = Driver(open_world(two_rooms, 0, robot), episode, "path", tmp_path / "a.drive")
    driver.hold(AHEAD, 2.0)
    driver.stop()
    driver.drive.keep(episode)
    walker = Walker(robot, driver.config)
    out = tmp_path / "a.mcap"
    job = DriveJob(two_rooms.root, episode, walker, driver.path, "Ada", tmp_path / "models", out)
    facts = job.run().facts
    assert (facts["controller"], facts["driver"]) == ("human", "Ada")
    first = read_rollout(out)
    # Another seed is other physics: the journal cannot be repeated with it.
    other = Walker(robot, replace(driver.config, seed=1))
    told = replace(episode, instruction="Walk to the wall.")
    replace(job, walker=other, episode=told).run()
    again = read_rollout(out)
    assert np.array_equal(again.position_world_m, first.position_world_m)
    assert again.episode.instruction == "Walk to the wall."
    out.unlink()
    with pytest.raises(FileFormatError, match="another state"):
        replace(job, walker=other).run()


@pytest.mark.parametrize(
    ("goal", "end"), [((1.8, 1.0), EndReason.SUCCESS), ((2.2, 1.0), EndReason.STOPPED_NEAR)]
)
@pytest.mark.parametrize("controller", ["path", "speed"])
def test_a_stop_within_1_m_of_the_goal_is_a_success(
    two_rooms: SceneBundle,
    tmp_path: Path,
    controller: str,
    goal: tuple[float, float],
    end: EndReason,
) -> None:
    robot = get_robot("jetbot")
    episode = make_episode(two_rooms, start=(1.0, 1.0), goal=goal)
    walker = drive_walker(robot, {"controller": controller, "seed": 0})
    world = open_world(two_rooms, 0, robot)
    driver = Driver(world, episode, controller, tmp_path / "a.drive", walker.config)
    driver.hold(LEFT, 0.5)
    assert (driver.stop() is EndReason.SUCCESS) is (end is EndReason.SUCCESS)
    driver.drive.keep(episode)
    out = tmp_path / "a.mcap"
    DriveJob(two_rooms.root, episode, walker, driver.path, "Ada", tmp_path / "models", out).run()
    assert read_rollout(out).end_reason is end
