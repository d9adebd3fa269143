"""Low robots pass where a standing humanoid is stopped: a board across the only doorway."""

import numpy as np
import pytest

from tests.support.scenes import scans
from vlnpe.collectors.physics import free_height
from vlnpe.collectors.replay.replay import ReplayConfig, replay_episode
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.errors import InputError, SceneError
from vlnpe.formats.core.rollout import EndReason
from vlnpe.formats.scene import FULL_HEIGHT_M
from vlnpe.formats.scene.bundle import SceneBundle, load_bundle
from vlnpe.formats.scene.freemap import Freemap
from vlnpe.pipeline.inputs.crews import chosen_robots
from vlnpe.pipeline.inputs.sampling_plan import chosen_free_height
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.repair import repair_scene
from vlnpe.trajectory_sampler.config import SampleConfig
from vlnpe.trajectory_sampler.sampling import sample_episodes
from vlnpe.wayfinding.distance import distance_field

pytestmark = pytest.mark.chain

BOARD_M = 0.72
HERE, THERE = (1.0, 2.0), (7.0, 2.0)


@pytest.fixture(scope="module")
def barred(tmp_path_factory: pytest.TempPathFactory) -> SceneBundle:
    """Two rooms whose only doorway is crossed by a board at table height."""
    folder = tmp_path_factory.mktemp("barred")
    board = scans.box((3.6, 1.4, BOARD_M), (4.5, 2.6, BOARD_M + 0.04))
    source = scans.write_glb([*scans.two_rooms(1.0), board], folder / "barred.glb")
    repair_scene(source, folder, RepairConfig(picture_px=200))
    return load_bundle(folder)


def reached(freemap: Freemap) -> bool:
    return bool(np.isfinite(distance_field(freemap, HERE, 0.25).at(THERE)))


def test_headroom_is_that_of_the_board(barred):
    freemap = barred.freemap(0)
    under = freemap.headroom_m[tuple(freemap.grid.cell_of((4.05, 2.0)))]
    assert under == pytest.approx(BOARD_M, abs=0.01)
    assert np.isinf(freemap.headroom_m[freemap.traversable]).all()


@pytest.mark.parametrize(
    ("height_m", "passes"), [(0.3, True), (0.7, True), (0.75, False), (2.0, False)]
)
def test_only_what_fits_under_the_board_passes(barred, height_m, passes):
    freemap = barred.freemap(0)
    low = freemap.for_height(height_m)
    assert reached(low) is passes
    assert (low.traversable >= freemap.traversable).all()


def test_scenes_without_headrooms_raise_an_error(barred):
    old = barred.freemap(0)
    old = Freemap(old.grid, old.floor_z_m, old.traversable)
    assert old.for_height(FULL_HEIGHT_M) is old
    with pytest.raises(SceneError, match="repair it again"):
        old.for_height(0.5)


def test_aliengo_walks_the_sampled_path_under_the_board_and_h1_cannot(barred):
    aliengo = free_height(get_robot("aliengo"))
    assert aliengo < BOARD_M < free_height(get_robot("h1"))
    crossing = SampleConfig(count=1, free_height_m=aliengo, min_length_m=4.0, min_crossings=1)
    (episode,) = sample_episodes(barred, crossing, np.random.default_rng(0)).episodes
    ends_x = episode.reference_path_world_m[[0, -1], 0]
    assert ends_x.min() < 4.0 < ends_x.max()
    assert episode.free_height_m == aliengo
    rollout = replay_episode(barred, episode, ReplayConfig(robot="aliengo", controller="path"))
    assert rollout.end_reason is EndReason.SUCCESS
    tall = replay_episode(barred, episode, ReplayConfig(robot="h1", controller="path"))
    assert tall.end_reason is not EndReason.SUCCESS


def test_the_free_height_follows_the_tallest_robot():
    assert chosen_free_height(chosen_robots("jetbot@1"), FULL_HEIGHT_M) == FULL_HEIGHT_M
    assert chosen_free_height(chosen_robots("aliengo,jetbot@1"), 0) == free_height(
        get_robot("aliengo")
    )
    with pytest.raises(InputError, match="aliengo needs"):
        chosen_free_height(chosen_robots("aliengo"), 0.3)
    with pytest.raises(InputError, match="--robot"):
        chosen_free_height([], 0)
