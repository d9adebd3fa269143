"""Controllers by themselves, driving an ideal unicycle over the two-room map."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from vlnpe.collectors.controllers import (
    CONTROLLERS,
    Controller,
    PathConfig,
    Pose,
    SpeedConfig,
    Task,
    get_controller,
)
from vlnpe.collectors.controllers.expert import Expert, ExpertConfig
from vlnpe.collectors.controllers.path import PathController
from vlnpe.collectors.controllers.route import STEP_M, make_route, plan_route
from vlnpe.collectors.controllers.speed import SpeedController
from vlnpe.collectors.robots import CommandLimits
from vlnpe.formats.errors import UnknownNameError
from vlnpe.formats.freemap import Freemap
from vlnpe.formats.planning import plan_path
from vlnpe.formats.rollout import Action
from vlnpe.formats.scene_bundle import SceneBundle

RADIUS = 0.3
LIMITS = CommandLimits((-0.3, 1.0), (-0.3, 0.3), (-1.05, 1.05))
WEST = st.tuples(st.floats(0.6, 3.2), st.floats(0.6, 2.4))
EAST = st.tuples(st.floats(4.8, 7.4), st.floats(1.6, 3.4))
YAW = st.floats(-math.pi, math.pi)


def make_task(freemap: Freemap, path: np.ndarray) -> Task:
    return Task(path[:, :2], path[-1, :2], freemap, RADIUS, LIMITS, 0.25)


@dataclass
class Drive:
    """What an ideal body did: poses at 100 Hz, decisions, whether the controller stopped."""

    poses: np.ndarray
    commands: np.ndarray
    notes: list[tuple[str, str]]
    done: bool


def drive(controller: Controller, pose: Pose, seconds: float, obey: float = 1.0) -> Drive:
    """A body that does what it is told, at once (`obey` times as fast)."""
    poses, commands, notes = [], [], []
    command, x, y, yaw = (0.0, 0.0, 0.0), pose.x_m, pose.y_m, pose.yaw_rad
    every = 100 // controller.rate_hz
    for tick in range(round(seconds * 100)):
        if tick % every == 0:
            decision = controller.step(tick / 100, Pose(x, y, yaw))
            command = decision.command
            notes += decision.notes
            if decision.done:
                return Drive(np.array(poses), np.array(commands), notes, True)
        poses.append((x, y, yaw))
        commands.append(command)
        vx, vy, rate = (obey * c for c in command)
        x += 0.01 * (vx * math.cos(yaw) - vy * math.sin(yaw))
        y += 0.01 * (vx * math.sin(yaw) + vy * math.cos(yaw))
        yaw = math.remainder(yaw + 0.01 * rate, 2 * math.pi)
    return Drive(np.array(poses), np.array(commands), notes, False)


def clearance(freemap: Freemap, xy: np.ndarray) -> np.ndarray:
    row, column = freemap.grid.cell_of(xy).T
    return freemap.clearance_m[row, column]


@pytest.mark.parametrize("kind", ["path", "speed"])
@settings(max_examples=25, deadline=None)
@given(start=WEST, goal=EAST, yaw=YAW)
def test_any_start_reaches_any_goal(two_rooms: SceneBundle, kind, start, goal, yaw) -> None:
    freemap = two_rooms.freemap(0)
    path = plan_path(freemap, start, goal, RADIUS)
    assume(path is not None and min(clearance(freemap, path[:, :2])) >= RADIUS)
    task = make_task(freemap, path)
    entry = CONTROLLERS[kind]
    controller = entry.build(task, entry.config())
    done = drive(controller, Pose(*start, yaw), 3 * controller.nominal_s)  # type: ignore[arg-type,union-attr]
    assert done.done
    assert np.hypot(*(done.poses[-1, :2] - task.goal_xy_m)) <= 0.25
    assert clearance(freemap, done.poses[:, :2]).min() >= RADIUS - 0.15
    limits = np.array([LIMITS.vx_m_s, LIMITS.vy_m_s, LIMITS.yaw_rad_s])
    assert (done.commands >= limits[:, 0] - 1e-9).all()
    assert (done.commands <= limits[:, 1] + 1e-9).all()


def corner(freemap: Freemap) -> np.ndarray:
    path = plan_path(freemap, (1.0, 1.0), (7.0, 3.0), RADIUS)
    assert path is not None
    return path


def test_curves_are_driven_slowly_and_straights_fast(two_rooms: SceneBundle) -> None:
    path = np.array([[1.0, 1.0], [3.0, 1.0], [3.0, 3.2]])
    task = make_task(two_rooms.freemap(0), path)
    done = drive(PathController(task, PathConfig()), Pose(1.0, 1.0, 0.0), 30)
    assert done.done
    at_corner = np.hypot(*(done.poses[:, :2] - path[1]).T) < 0.2
    on_straight = np.abs(done.poses[:, 0] - 2.0) < 0.2
    assert done.commands[at_corner, 0].max() < 0.5
    assert done.commands[on_straight, 0].min() > 0.7


def test_it_turns_on_the_spot_before_it_walks(two_rooms: SceneBundle) -> None:
    freemap = two_rooms.freemap(0)
    done = drive(
        PathController(make_task(freemap, corner(freemap)), PathConfig()), Pose(1, 1, 3), 5
    )
    walking = np.argmax(done.commands[:, 0] > 0.05)
    assert walking > 100
    assert np.hypot(*(done.poses[walking, :2] - done.poses[0, :2])) < 0.02


def test_a_robot_that_was_moved_away_replans_and_arrives(two_rooms: SceneBundle) -> None:
    freemap = two_rooms.freemap(0)
    controller = PathController(make_task(freemap, corner(freemap)), PathConfig())
    drive(controller, Pose(1.0, 1.0, 0.3), 1.0)
    done = drive(controller, Pose(2.0, 2.6, 0.0), 30)
    assert any(kind == "replan" and "off the route" in why for kind, why in done.notes)
    assert done.done


def test_a_robot_that_cannot_move_backs_off(two_rooms: SceneBundle) -> None:
    freemap = two_rooms.freemap(0)
    controller = PathController(make_task(freemap, corner(freemap)), PathConfig())
    done = drive(controller, Pose(1.0, 1.0, 0.3), 10.0, obey=0.0)
    assert not done.done
    assert sum("no progress" in why for _, why in done.notes) >= 2
    assert done.commands[:, 0].min() < 0


def test_a_weak_body_still_arrives(two_rooms: SceneBundle) -> None:
    """A gait may give half of what it is asked for."""
    freemap = two_rooms.freemap(0)
    for controller in (
        PathController(make_task(freemap, corner(freemap)), PathConfig()),
        SpeedController(make_task(freemap, corner(freemap)), SpeedConfig()),
    ):
        assert drive(controller, Pose(1.0, 1.0, -1.0), 60, obey=0.5).done


def test_a_free_reference_is_followed_as_it_is(two_rooms: SceneBundle) -> None:
    path = np.array([[1.0, 1.0], [3.0, 1.2], [3.2, 2.0], [5.0, 2.0]])
    route = plan_route(two_rooms.freemap(0), path, RADIUS)
    assert route.problems == ()
    for point in path:
        assert np.linalg.norm(route.xy_m - point, axis=1).min() <= STEP_M / 2
    assert route.length_m == pytest.approx(
        np.linalg.norm(np.diff(path, axis=0), axis=1).sum(), rel=0.01
    )


def test_a_reference_through_a_wall_is_planned_around(two_rooms: SceneBundle) -> None:
    freemap = two_rooms.freemap(0)
    route = plan_route(freemap, [[3.0, 1.0], [5.0, 1.0]], RADIUS)
    assert route.problems == ()
    assert clearance(freemap, route.xy_m).min() >= RADIUS - 0.05
    assert route.length_m > 2.5


def test_an_impossible_reference_says_so_and_is_tried(two_rooms: SceneBundle) -> None:
    freemap = two_rooms.freemap(0)
    route = plan_route(freemap, [[3.0, 2.0], [5.0, 2.0]], 0.6)  # the doorway is 1 m wide
    assert len(route.problems) == 1
    assert "radius 0.60" in route.problems[0]
    assert route.length_m == pytest.approx(2.0)


@pytest.mark.parametrize("radius", [0.5, 1.0, 2.0])
def test_the_curvature_of_a_circle(radius: float) -> None:
    angle = np.linspace(0, math.pi, 200)
    route = make_route(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    inner = slice(20, -20)
    assert route.curvature_per_m()[inner] == pytest.approx(1 / radius, rel=0.05)
    assert route.turning_rad == pytest.approx(math.pi, rel=0.05)


@settings(max_examples=30, deadline=None)
@given(start=WEST, goal=EAST, yaw=YAW)
def test_the_expert_arrives_with_exact_actions(two_rooms: SceneBundle, start, goal, yaw) -> None:
    freemap = two_rooms.freemap(0)
    path = plan_path(freemap, start, goal, RADIUS)
    assume(path is not None and min(clearance(freemap, path[:, :2])) >= RADIUS)
    assert path is not None
    expert = Expert(make_route(path[:, :2]), ExpertConfig())
    (x, y), actions = start, []
    for _ in range(200):
        action = expert.next_action(Pose(x, y, yaw))
        actions.append(action)
        if action is Action.STOP:
            break
        if action is Action.FORWARD:
            x, y = x + 0.25 * math.cos(yaw), y + 0.25 * math.sin(yaw)
        else:
            yaw += math.radians(15 if action is Action.LEFT else -15)
    assert actions[-1] is Action.STOP
    assert math.hypot(x - path[-1, 0], y - path[-1, 1]) <= 0.25
    turns = [a for a in actions if a in (Action.LEFT, Action.RIGHT)]
    assert len(turns) < len(actions) - len(turns) + 14


def test_an_unknown_controller_lists_the_valid_ones() -> None:
    with pytest.raises(UnknownNameError, match="valid: flash, path, speed"):
        get_controller("teleport")
