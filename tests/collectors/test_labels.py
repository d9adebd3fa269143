"""Labels of every robot and controller lead where the robot went, and stops are stops."""

import math
from itertools import pairwise

import numpy as np
import pytest

from tests.collectors.test_replay import make_episode
from vlnpe.collectors.controllers import Expert, Pose, Task
from vlnpe.collectors.locomotion.runtime.coasting import measure_coasting
from vlnpe.collectors.locomotion.runtime.drives import gait_for
from vlnpe.collectors.replay.replay import ReplayConfig, replay_in
from vlnpe.collectors.replay.world import World, open_world
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.frames import quat_to_yaw
from vlnpe.formats.core.rollout import (
    FORWARD_STEP_M,
    TURN_STEP_RAD,
    Action,
    EndReason,
    Rollout,
)
from vlnpe.formats.rendered.discrete_steps import discrete_steps, execute, total_turning
from vlnpe.formats.scene.bundle import SceneBundle

pytestmark = pytest.mark.chain

WALKS = (((1, 1), (7, 3), 0.4), ((7, 3), (0.8, 1.2), -2.6))
ROBOTS = ("aliengo", "jetbot", "h1", "g1")
CREWS = [*((robot, drive) for robot in ROBOTS for drive in ("path", "speed")), ("aliengo", "flash")]


def rollouts(world: World, controller: str) -> list[Rollout]:
    config = ReplayConfig(controller=controller)
    return [
        replay_in(world, make_episode(world.bundle, start, goal, yaw, name=f"e{n}"), config)
        for n, (start, goal, yaw) in enumerate(WALKS)
    ]


def task_of(episode: Episode, bundle: SceneBundle, name: str) -> Task:
    robot = get_robot(name)
    return Task(
        episode.reference_path_world_m[:, :2],
        episode.goal_position_world_m[:2],
        bundle.freemap(episode.level),
        robot.footprint_radius_m,
        robot.command_limits,
        0.25,
    )


def event_sample(r: Rollout, kind: str) -> int:
    return round(next(e.time_s for e in r.events if e.kind == kind) * 100)


@pytest.mark.parametrize(("name", "controller"), CREWS)
def test_executing_the_labels_ends_where_the_robot_did(
    two_rooms: SceneBundle, name: str, controller: str
) -> None:
    for r in rollouts(open_world(two_rooms, 0, get_robot(name)), controller):
        assert r.end_reason is EndReason.SUCCESS
        # An immediate turn back would answer a turn that is still under way.
        executed = [span.action for span in r.actions]
        assert sum({a, b} == {Action.LEFT, Action.RIGHT} for a, b in pairwise(executed)) <= 2
        at = r.frame_samples(4)
        yaw = np.unwrap(quat_to_yaw(r.quat_wxyz[at])).astype(np.float64)
        poses = np.column_stack([r.position_world_m[at, :2], yaw]).astype(np.float64)
        steps = discrete_steps(poses)
        end = execute(steps.action, poses[0])[-1]
        assert np.hypot(*(end[:2] - poses[-1, :2])) <= 0.5
        # Of 40 walks from other places 1 or 2 of Aliengo's are off by more than 15°, by 16.3° at
        # most (with its gait before this one 2, by 15.4° at most), and none of the H1's.
        assert math.degrees(abs(end[2] - poses[-1, 2])) <= 17.0
        turned = TURN_STEP_RAD * np.isin(steps.action, (Action.LEFT, Action.RIGHT)).sum()
        assert math.degrees(abs(turned - total_turning(poses[:, 2]))) <= 15.0
        # The last frame shows a robot at rest, and is the first one that does after the stop.
        assert np.hypot(*r.linear_velocity_base_m_s[at[-1], :2]) < 0.06
        if controller != "flash":
            assert 0 <= at[-1] - event_sample(r, "rest") < 25


@pytest.mark.parametrize("name", ["aliengo", "jetbot"])
def test_recorded_labels_are_what_the_expert_says_online(two_rooms: SceneBundle, name: str) -> None:
    world = open_world(two_rooms, 0, get_robot(name))
    r = rollouts(world, "path")[0]
    expert, yaw = Expert(task_of(r.episode, world.bundle, name)), quat_to_yaw(r.quat_wxyz)
    x, y = r.position_world_m[:, :2].T
    expected = [
        expert.next_action(Pose(float(x[k]), float(y[k]), float(yaw[k])))
        for k in range(0, len(r.time_s), 25)
    ]
    assert list(r.labels) == expected
    assert Action.FORWARD in expected


@pytest.mark.parametrize("name", ROBOTS)
def test_an_agent_that_asks_at_its_own_poses_arrives(two_rooms: SceneBundle, name: str) -> None:
    """From any heading, also beside the path, with actions that come out by up to 30 % wrong."""
    rng = np.random.default_rng(0)
    for n in range(40):
        start, goal, _ = WALKS[n % 2]
        episode = make_episode(two_rooms, start, goal)
        expert, noise = Expert(task_of(episode, two_rooms, name)), 0.1 * (n % 4)
        x, y = np.add(start, rng.uniform(-0.15, 0.15, 2)).tolist()
        yaw, count = float(rng.uniform(-math.pi, math.pi)), 0
        while (action := expert.next_action(Pose(x, y, yaw))) is not Action.STOP:
            count += 1
            assert count < 200
            size = 1.0 + noise * float(rng.uniform(-1.0, 1.0))
            if action is Action.FORWARD:
                x += size * FORWARD_STEP_M * math.cos(yaw)
                y += size * FORWARD_STEP_M * math.sin(yaw)
            else:
                yaw += size * TURN_STEP_RAD * (1.0 if action is Action.LEFT else -1.0)
        assert math.hypot(x - goal[0], y - goal[1]) <= 0.25


@pytest.mark.parametrize("name", ["aliengo", "jetbot"])
def test_robots_stop_at_their_measured_coasting_distance(two_rooms: SceneBundle, name: str) -> None:
    robot = get_robot(name)
    coasting = measure_coasting(robot, gait_for(robot))
    assert 0.0 < coasting.turn_lag_s < 0.5
    assert 0.0 == coasting.distance(0.0) < coasting.distance(0.5) < coasting.distance(0.9) < 0.6
    for r in rollouts(open_world(two_rooms, 0, robot), "speed"):
        stop, rest = event_sample(r, "stop"), event_sample(r, "rest")
        speed = float(np.hypot(*r.linear_velocity_base_m_s[stop - 20 : stop, :2].T).mean())
        went = float(np.linalg.norm(np.subtract(*r.position_world_m[[rest, stop], :2])))
        # A quadruped's 40 walks miss it by 6 cm in the median and 11.3 cm at most (5 and 10.9 cm
        # with its gait before this one).
        assert went == pytest.approx(coasting.distance(speed), abs=0.115)
        assert r.metrics.navigation_error_euclidean_m <= 0.25
