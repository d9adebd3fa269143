"""Episodes over storeys: the Aliengo walks up and down a flight of ten low steps."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.support.scenes.storeys import FOOT_X, HEAD_X, write_two_storeys
from vlnpe.collectors.controllers import PACE_M_S
from vlnpe.collectors.physics.outcome import OutcomeConfig, OutcomeWatch
from vlnpe.collectors.replay.checkpoint import checkpoint, rewind
from vlnpe.collectors.replay.config import ReplayConfig
from vlnpe.collectors.replay.episode_run import TILT_EVENT, EpisodeRun
from vlnpe.collectors.replay.replay import replay_in
from vlnpe.collectors.replay.world import World, open_world
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.rollout import Action, Rollout
from vlnpe.formats.scene.bundle import SceneBundle

ALIENGO = get_robot("aliengo")
RISE_M, RISERS, STAIRS = 1.0, 10, 1


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> SceneBundle:
    folder: Path = tmp_path_factory.mktemp("storeys")
    return write_two_storeys(folder, 0.025, RISE_M, RISERS)


def open_storeys(building: SceneBundle, up: bool) -> World:
    return open_world(building, 0 if up else 1, ALIENGO, staircase=STAIRS)


def episode_over(building: SceneBundle, up: bool) -> Episode:
    line = building.staircases[STAIRS].line_world_m
    path = np.vstack([(8.5, 2.6, 0.0), line, (14.6, 1.5, RISE_M)])[:: 1 if up else -1]
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    name, levels = "up" if up else "down", [0, 1] if up else [1, 0]
    return Episode(
        name, name, "two_storeys", "train", levels[0], path[0], 0.0 if up else np.pi, path[-1],
        path, length, extra={"staircases": [STAIRS], "levels": levels},
    )  # fmt: skip


@pytest.fixture(scope="module", params=[True, False], ids=["up", "down"])
def walk(request: pytest.FixtureRequest, building: SceneBundle) -> Rollout:
    world = open_storeys(building, request.param)
    return replay_in(world, episode_over(building, request.param), ReplayConfig())


def test_a_flight_is_walked_from_storey_to_storey(walk: Rollout):
    assert walk.end_reason == "success"
    start, goal = walk.episode.start_position_world_m, walk.episode.goal_position_world_m
    place, floor = walk.position_world_m, walk.floor_z_m
    # The floor under it is that of the sheet it walks on, step by step.
    assert floor[0] == pytest.approx(start[2], abs=1e-6)
    assert floor[-1] == pytest.approx(goal[2], abs=1e-6)
    steps = np.unique(floor.round(3))
    np.testing.assert_allclose(steps, np.linspace(0.0, RISE_M, RISERS + 1), atol=1e-3)
    on = (place[:, 0] > FOOT_X) & (place[:, 0] < HEAD_X)
    height = place[on, 2] - floor[on]
    assert height.min() > 0.2 and height.max() < 0.6
    assert np.abs(place[on, 1] - 2.0).max() < 0.15
    assert walk.metrics.success and walk.metrics.spl > 0.85
    assert walk.metrics.navigation_error_m < 0.3 and walk.metrics.ndtw > 0.8


def test_stairs_are_taken_slowly_and_labelled_to_the_end(walk: Rollout):
    place, ahead = walk.position_world_m, walk.command[:, 0]
    near = (place[:, 0] > FOOT_X - 0.3) & (place[:, 0] < HEAD_X + 0.3)
    assert ahead[near].max() <= PACE_M_S + 1e-9
    assert ahead.max() > 1.3 * PACE_M_S
    # Before it is lined up, it stands before the flight; on the steps it never stops to turn.
    on = (place[:, 0] > FOOT_X) & (place[:, 0] < HEAD_X)
    assert ahead[on].min() > 0.3
    labels = np.array(walk.labels)
    frames = place[:: len(place) // (len(labels) - 1)][: len(labels)]
    far = np.linalg.norm(frames - walk.episode.goal_position_world_m - (0, 0, 0.36), axis=1) > 0.5
    assert not (labels[far] == Action.STOP).any()
    assert walk.facts["stairs_policy_sha256"] != walk.facts["policy_sha256"]


def test_a_walk_goes_on_from_a_checkpoint_on_the_flight(building: SceneBundle):
    world = open_storeys(building, True)
    run = EpisodeRun(world, episode_over(building, True), ReplayConfig())
    assert run.begin() is None
    while world.pose.x_m < FOOT_X + 0.5:
        assert run.advance() is None
    before = checkpoint(run)
    states = []
    for _ in range(2):
        for _ in range(60):
            assert run.advance() is None
        states.append((world.data.qpos.copy(), run.command))
        rewind(run, before)
    np.testing.assert_array_equal(states[0][0], states[1][0])
    assert states[0][1] == states[1][1]


def test_discrete_actions_lead_over_storeys(building: SceneBundle):
    world = open_storeys(building, False)
    rollout = replay_in(world, episode_over(building, False), ReplayConfig(controller="speed"))
    assert rollout.end_reason == "success"
    actions = [span.action for span in rollout.actions]
    assert actions.index(Action.STOP) == len(actions) - 1
    assert rollout.position_world_m[-1, 2] < 0.5


def test_a_fall_on_stairs_counts_against_their_slope(building: SceneBundle):
    world = open_storeys(building, True)
    watch = OutcomeWatch(
        world.data, world.handles, ALIENGO.fall, world.surface, OutcomeConfig(), world.ground
    )
    slope = np.degrees(np.arctan2(RISE_M / RISERS, (HEAD_X - FOOT_X) / (RISERS - 1)))  # 19°
    middle = 0.5 * (FOOT_X + HEAD_X)
    for pitch, fallen, tilted in (
        (-slope, False, False),
        (-slope - 28, False, True),
        (-slope - 42, True, False),
        (42 - slope, True, False),
        (28 - slope, False, False),
    ):
        half = 0.5 * np.radians(pitch)
        world.base[:] = middle, 2.0, 0.5 * RISE_M + 0.36, np.cos(half), 0.0, np.sin(half), 0.0
        mujoco.mj_forward(world.model, world.data)
        watch.tilt = ""
        down = watch.down()
        assert (down is not None) == fallen, (pitch, down)
        assert (watch.tilt != "") == tilted
        assert not fallen or "on a slope of" in str(down)
    # Between the storeys, and beside the flight, there is nothing to stand on.
    world.base[:3] = middle, 3.5, 0.5 * RISE_M + 0.36
    mujoco.mj_forward(world.model, world.data)
    world.base[3:] = 1.0, 0.0, 0.0, 0.0
    assert "no floor" in str(watch.down())


def test_what_would_be_a_fall_on_level_ground_is_noted_once(building: SceneBundle):
    world = open_storeys(building, True)
    run = EpisodeRun(world, episode_over(building, True), ReplayConfig())
    assert run.begin() is None
    run.watch.tilt = "pitch 36°"
    for _ in range(2):
        assert run.advance() is None
        run.watch.tilt = "pitch 37°"
    assert run.advance() is None
    assert [event.detail for event in run.events if event.kind == TILT_EVENT] == ["pitch 36°"]
