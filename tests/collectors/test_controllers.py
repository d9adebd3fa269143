"""Controllers by themselves, driving an ideal unicycle over the two-room map."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from vlnpe.collectors.controllers import (
    CONTROLLERS,
    Coasting,
    Controller,
    PathConfig,
    Pose,
    SpeedConfig,
    Task,
    get_controller,
)
from vlnpe.collectors.controllers.expert import Expert
from vlnpe.collectors.controllers.path import PathController
from vlnpe.collectors.controllers.route import STEP_M, make_route, plan_route
from vlnpe.collectors.controllers.servo import ServoConfig, Track, steer
from vlnpe.collectors.controllers.speed import SpeedController
from vlnpe.collectors.robots import CommandLimits
from vlnpe.formats.core.errors import UnknownNameError
from vlnpe.formats.core.rollout import TURN_STEP_RAD, Action
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.scene.freemap import Freemap
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.wayfinding.planning import plan_path

RADIUS = 0.3
LIMITS = CommandLimits(vx_m_s=(-0.3, 1.0), vy_m_s=(-0.3, 0.3), yaw_rad_s=(-1.05, 1.05))
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


def drive(
    controller: Controller,
    pose: Pose,
    seconds: float,
    obey: float = 1.0,
    *,
    error_m_s: tuple[float, float] = (0.0, 0.0),
    lag_s: float = 0.0,
) -> Drive:
    """Drive a body that follows commands `obey` times as fast.

    While it is commanded, a lasting error adds to its velocity, which lags behind.
    """
    poses, commands, notes, speed = [], [], [], np.zeros(2)
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
        speed += (np.array([vx, vy]) + error_m_s - speed) * min(1.0, 0.01 / max(lag_s, 0.01))
        vx, vy = speed
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


@pytest.mark.parametrize("error_m_s", [(0.1, 0.0), (-0.1, 0.0), (0.0, 0.1), (0.0, -0.1)])
def test_a_lasting_error_of_the_velocity_is_absorbed(error_m_s: tuple[float, float]) -> None:
    grid = GridSpec((-5.0, -5.0), 0.25, 100, 100)
    ground = Freemap(grid, np.zeros(grid.shape, np.float32), np.ones(grid.shape, dtype=bool))
    path = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 6.0]])
    task = replace(make_task(ground, path), coasting=Coasting(lag_s=0.3))
    wrong = []  # mean speed on the second leg, and distance from it
    for most_m_s in (0.0, PathConfig().trim_m_s):
        controller = PathController(task, PathConfig(trim_m_s=most_m_s))
        done = drive(controller, Pose(0, 0, 0), 40, error_m_s=error_m_s, lag_s=0.3)
        assert done.done
        leg = done.poses[(done.poses[:, 1] > 2.5) & (done.poses[:, 1] < 5.0)]
        speed_m_s = np.ptp(leg[:, 1]) / (0.01 * len(leg))
        wrong.append(np.hypot(speed_m_s - 0.8, np.abs(leg[:, 0] - 6.0).mean()))
    assert wrong[0] > 0.02
    assert wrong[1] < 0.4 * wrong[0]


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


def test_a_body_that_moves_at_half_the_command_still_arrives(two_rooms: SceneBundle) -> None:
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


def test_an_impossible_reference_is_noted_and_tried(two_rooms: SceneBundle) -> None:
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
    expert = Expert(make_task(freemap, path))
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


@settings(max_examples=40, deadline=None)
@given(start=WEST, goal=EAST, yaw=YAW, seed=st.integers(0, 1000))
def test_an_agent_that_asks_at_its_own_poses_arrives(
    two_rooms: SceneBundle, start, goal, yaw, seed
) -> None:
    """The agent slips and sometimes takes another action, as a learner would."""
    freemap, rng = two_rooms.freemap(0), np.random.default_rng(seed)
    path = plan_path(freemap, start, goal, RADIUS)
    assume(path is not None and min(clearance(freemap, path[:, :2])) >= RADIUS)
    assert path is not None
    expert, (x, y), action = Expert(make_task(freemap, path)), start, Action.FORWARD
    for step in range(400):
        action = expert.next_action(Pose(x, y, yaw))
        if action is Action.STOP:
            break
        if step < 60 and rng.random() < 0.2:
            action = Action(int(rng.integers(1, 4)))
        ahead = 0.25 * rng.uniform(0.6, 1.1) * (action is Action.FORWARD)
        to = (x + ahead * math.cos(yaw), y + ahead * math.sin(yaw))
        if clearance(freemap, np.array([to]))[0] > 0.1:
            x, y = to
        turn = {Action.LEFT: TURN_STEP_RAD, Action.RIGHT: -TURN_STEP_RAD}.get(action, 0.0)
        yaw += turn * rng.uniform(0.6, 1.1)
    assert action is Action.STOP
    assert math.hypot(x - path[-1, 0], y - path[-1, 1]) <= 0.25


@pytest.mark.parametrize("steps", [10, 24, 50])
def test_short_actions_take_as_long_as_usual_ones_in_all(two_rooms: SceneBundle, steps) -> None:
    freemap = two_rooms.freemap(0)
    path = plan_path(freemap, (0.8, 0.8), (7.2, 3.2), RADIUS)
    assert path is not None
    task = make_task(freemap, path)
    usual = SpeedController(task, SpeedConfig()).nominal_s
    controller = SpeedController(task, SpeedConfig(steps_per_action=steps))
    assert controller.nominal_s == pytest.approx(usual)
    assert drive(controller, Pose(0.8, 0.8, math.pi), 3 * controller.nominal_s).done


def test_an_unknown_controller_lists_the_valid_ones() -> None:
    with pytest.raises(UnknownNameError, match="valid: flash, path, speed"):
        get_controller("teleport")


@dataclass
class Body:
    """A planar body that answers commands late, as a walking robot does, and sways.

    Attributes:
        lag_s: time constant of its answer.
        sway_m: how far it swings sideways, once a second.
        weak: share of each command that it obeys.
    """

    lag_s: float
    sway_m: float = 0.0
    weak: float = 1.0

    def drive(self, controller: SpeedController, pose: Pose, seconds: float) -> list[tuple]:
        """(action, pose at its start) of every action; the robot moves on until done."""
        x, y, yaw, started = pose.x_m, pose.y_m, pose.yaw_rad, []
        velocity, command = np.zeros(3), np.zeros(3)
        for tick in range(round(seconds * 100)):
            sway = self.sway_m * math.sin(2 * math.pi * tick / 100)
            seen = Pose(x - sway * math.sin(yaw), y + sway * math.cos(yaw), yaw)
            decision = controller.step(tick / 100, seen)
            if decision.action is not None:
                started.append((decision.action, seen))
            if decision.done:
                break
            command = self.weak * np.array(decision.command)
            velocity += (command - velocity) * 0.01 / self.lag_s
            x += 0.01 * (velocity[0] * math.cos(yaw) - velocity[1] * math.sin(yaw))
            y += 0.01 * (velocity[0] * math.sin(yaw) + velocity[1] * math.cos(yaw))
            yaw = math.remainder(yaw + 0.01 * velocity[2], 2 * math.pi)
        return started


def own_errors(started: list[tuple]) -> tuple[np.ndarray, np.ndarray]:
    """Each action's error in position [m] and heading [°], as it is measured of robots."""
    position, heading = [], []
    for (action, a), (_, b) in pairwise(started):
        dx, dy = b.x_m - a.x_m, b.y_m - a.y_m
        ahead = dx * math.cos(a.yaw_rad) + dy * math.sin(a.yaw_rad)
        left = dy * math.cos(a.yaw_rad) - dx * math.sin(a.yaw_rad)
        nominal = {Action.LEFT: 15.0, Action.RIGHT: -15.0}.get(action, 0.0)
        turned = math.degrees(math.remainder(b.yaw_rad - a.yaw_rad, 2 * math.pi))
        position.append(math.hypot(ahead - 0.25 * (action is Action.FORWARD), left))
        heading.append(abs(turned - nominal))
    return np.array(position), np.array(heading)


CLOSED = SpeedConfig(end_on_displacement=True)


@pytest.mark.parametrize(
    "body",
    [Body(0.05), Body(0.2), Body(0.35), Body(0.2, sway_m=0.02), Body(0.2, weak=0.7)],
    ids=["brisk", "slow", "very slow", "swaying", "weak"],
)
def test_closed_loop_holds_each_action_to_its_displacement(two_rooms: SceneBundle, body) -> None:
    freemap = two_rooms.freemap(0)
    path = corner(freemap)
    controller = SpeedController(make_task(freemap, path), CLOSED)
    started = body.drive(controller, Pose(1.0, 1.0, -1.0), 120)
    assert started[-1][0] is Action.STOP
    end = started[-1][1]
    assert math.hypot(end.x_m - path[-1, 0], end.y_m - path[-1, 1]) <= 0.25
    position, heading = own_errors(started)
    assert np.quantile(position, 0.9) < 0.08
    assert np.quantile(heading, 0.9) < 6.0


def test_steps_in_a_row_do_not_slow_down(two_rooms: SceneBundle) -> None:
    task = make_task(two_rooms.freemap(0), np.array([[0.6, 1.0], [3.4, 1.0]]))
    started = Body(0.2).drive(SpeedController(task, CLOSED), Pose(0.6, 1.0, 0.0), 60)
    assert {action for action, _ in started[:-1]} == {Action.FORWARD}
    done = drive(SpeedController(task, CLOSED), Pose(0.6, 1.0, 0.0), 60)
    cruising = (done.poses[:, 0] > 1.0) & (done.poses[:, 0] < 2.8)
    assert done.commands[cruising, 0].min() == pytest.approx(CLOSED.servo.cruise_m_s)
    assert done.commands[-1, 0] < 0.3


def test_a_blocked_action_is_given_up_in_closed_loop(two_rooms: SceneBundle) -> None:
    freemap = two_rooms.freemap(0)
    controller = SpeedController(make_task(freemap, corner(freemap)), CLOSED)
    started = Body(0.2, weak=0.0).drive(controller, Pose(1.0, 1.0, 0.3), 10.0)
    assert len(started) == pytest.approx(10.0 / CLOSED.servo.longest_s, abs=1.0)


@pytest.mark.parametrize("action", [Action.FORWARD, Action.LEFT, Action.RIGHT])
@settings(max_examples=40, deadline=None)
@given(x=st.floats(-5, 5), y=st.floats(-5, 5), yaw=YAW)
def test_a_track_ends_where_nothing_remains(action: Action, x, y, yaw) -> None:
    track = Track(action, Pose(x, y, yaw))
    assert track.remaining(track.start) == pytest.approx(0.25 if not track.sense else TURN_STEP_RAD)
    assert track.remaining(track.end) == pytest.approx(0.0, abs=1e-9)
    moved = np.hypot(track.end.x_m - x, track.end.y_m - y)
    assert moved == pytest.approx(0.25 * (action is Action.FORWARD))


@settings(max_examples=60, deadline=None)
@given(
    x=st.floats(-1, 1),
    y=st.floats(-1, 1),
    yaw=YAW,
    kind=st.sampled_from(list(Action)),
    v=st.floats(0, 2),
)
def test_steering_keeps_the_limits_and_leads_back(x, y, yaw, kind, v) -> None:
    track = Track(kind, Pose(0.0, 0.0, 0.0))
    vx, vy, rate = steer(track, Pose(x, y, yaw), v, ServoConfig(), LIMITS)
    limits = np.array([LIMITS.vx_m_s, LIMITS.vy_m_s, LIMITS.yaw_rad_s])
    assert (np.array([vx, vy, rate]) >= limits[:, 0]).all()
    assert (np.array([vx, vy, rate]) <= limits[:, 1]).all()
    if kind is Action.FORWARD:
        assert vy * y <= 0.0 and (vy != 0.0 or abs(y) < 1e-9)
        # From a half turn, both ways lead back.
        assert rate * yaw <= 0.0 or math.pi - abs(yaw) < 1e-9
        assert rate != 0.0 or abs(yaw) < 1e-9
    elif track.sense:
        # As far as its limits let it, it moves towards the spot it turns on.
        towards = -(x * (vx * math.cos(yaw) - vy * math.sin(yaw)))
        towards -= y * (vx * math.sin(yaw) + vy * math.cos(yaw))
        assert towards >= -1e-9
