"""Controllers and the expert over storeys, on bodies that do exactly as they are told."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from vlnpe.collectors.controllers import (
    PACE_M_S,
    Controller,
    PathConfig,
    Pose,
    SpeedConfig,
    Task,
    expert_for,
)
from vlnpe.collectors.controllers.flight import FlightController
from vlnpe.collectors.controllers.legs import path_controller
from vlnpe.collectors.controllers.speed import SpeedController
from vlnpe.collectors.locomotion.trials.driven import open_ground
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.rollout import FORWARD_STEP_M, TURN_STEP_RAD, Action

ALIENGO = get_robot("aliengo")
# Up along x, over a landing with a turn to the left, and up along y: the floor before the steps,
# foot, head, corner of the landing, foot, head, the floor behind.
STAIRS = np.array(
    [(-0.45, 0.0), (0.0, 0.0), (2.2, 0.0), (2.7, 0.0), (2.7, 0.5), (2.7, 2.7), (2.7, 3.15)]
)
BELOW = np.array([(-4.0, -1.0), (-1.5, -1.0), (-0.45, 0.0)])
ABOVE = np.array([(2.7, 3.15), (2.7, 4.5), (5.0, 4.5)])


def on_treads(x: float, y: float) -> bool:
    """Whether feet 0.25 m before and behind a base are on steps."""
    return (-0.25 < x < 2.45 and abs(y) < 0.2) or 0.25 < y < 2.95


def leg(xy: np.ndarray, **facts: Any) -> Task:
    return Task(xy, xy[-1], open_ground(), 0.3, ALIENGO.command_limits, 0.25, **facts)


def storeys() -> Task:
    whole = leg(np.vstack([BELOW, STAIRS, ABOVE]))
    stairs = leg(STAIRS, is_stairs=True, passes_on=True)
    return replace(whole, legs=(leg(BELOW, passes_on=True), stairs, leg(ABOVE)))


def walk(controller: Controller, pose: Pose, seconds: float = 90.0):
    """Yield poses and decisions of a body that follows every command at once."""
    step = 1.0 / controller.rate_hz
    for k in range(round(seconds / step)):
        decision = controller.step(k * step, pose)
        yield pose, decision
        if decision.done:
            return
        vx, vy, yaw = decision.command
        cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        x, y = pose.x_m + step * (cos * vx - sin * vy), pose.y_m + step * (sin * vx + cos * vy)
        pose = Pose(x, y, pose.yaw_rad + step * yaw)
    pytest.fail(f"still going at {pose}")


@pytest.mark.parametrize(("aside", "askew"), [(0.0, 0.0), (0.25, -0.9), (-0.3, 1.8)])
def test_flights_are_taken_in_line_and_without_turns(aside: float, askew: float):
    task = leg(STAIRS, is_stairs=True)
    at = Pose(-0.5, aside, askew)
    steps = list(walk(FlightController(task), at))
    on = [(p, d) for p, d in steps if on_treads(p.x_m, p.y_m)]
    first = next(p for p, _ in steps if p.x_m > -0.25)
    assert abs(first.y_m) <= 0.1 and abs(first.yaw_rad) <= math.radians(10)
    for pose, decision in on:
        vx, _, yaw = decision.command
        assert 0.2 < vx <= PACE_M_S and abs(yaw) < 0.5
        x, y = pose.x_m, pose.y_m
        assert min(abs(y) if x < 2.45 else 9.0, abs(x - 2.7)) <= 0.1
    # The turn on the landing is made on the spot.
    turning = [p for p, d in steps if abs(d.command[2]) > 0.5 and p.x_m > 2.0]
    assert np.ptp([p.x_m for p in turning]) < 0.1 and len(turning) > 10
    last = steps[-1][0]
    assert math.dist((last.x_m, last.y_m), STAIRS[-1]) < 0.12


def test_path_hands_over_from_leg_to_leg_without_a_stop():
    controller = path_controller(storeys(), PathConfig())
    steps = list(walk(controller, Pose(-4.0, -1.0, 0.0)))
    last = steps[-1][0]
    assert math.dist((last.x_m, last.y_m), ABOVE[-1]) < 0.2
    assert [d.done for _, d in steps].count(True) == 1
    # Level legs are walked fast, flights slowly, and behind the stairs it goes straight on.
    speed = np.array([math.hypot(*d.command[:2]) for _, d in steps])
    y = np.array([p.y_m for p, _ in steps])
    assert speed[: len(speed) // 4].max() == pytest.approx(0.8, abs=0.01)
    assert speed[(y > 2.9) & (y < 4.0)].min() > 0.3
    assert controller.nominal_s == pytest.approx(len(steps) / controller.rate_hz, rel=0.5)


def test_the_expert_leads_over_stairs_and_stops_only_at_the_goal():
    expert, pose = expert_for(storeys()), Pose(-4.0, -1.0, 0.4)
    taken: list[tuple[Action, bool]] = []
    while len(taken) < 200 and (not taken or taken[-1][0] is not Action.STOP):
        action = expert.next_action(pose)
        taken.append((action, on_treads(pose.x_m, pose.y_m)))
        if action is Action.FORWARD:
            x = pose.x_m + FORWARD_STEP_M * math.cos(pose.yaw_rad)
            pose = Pose(x, pose.y_m + FORWARD_STEP_M * math.sin(pose.yaw_rad), pose.yaw_rad)
        sense = {Action.LEFT: 1.0, Action.RIGHT: -1.0}.get(action, 0.0)
        pose = replace(pose, yaw_rad=pose.yaw_rad + sense * TURN_STEP_RAD)
    assert math.dist((pose.x_m, pose.y_m), ABOVE[-1]) <= 0.2
    on = [action for action, treads in taken if treads]
    assert on.count(Action.FORWARD) >= 16 and Action.STOP not in on
    # A turn of 15° is worth taking now and then, never two of them.
    assert on.count(Action.FORWARD) > 2 * (len(on) - on.count(Action.FORWARD))
    assert all(Action.FORWARD in pair for pair in pairwise(on))


def test_discrete_actions_have_the_time_that_stairs_take():
    whole = storeys()
    flat = SpeedController(replace(whole, legs=()), SpeedConfig())
    over = SpeedController(whole, SpeedConfig())
    slower_s = 6.3 / PACE_M_S - 6.3 / 1.0  # the stairs' length at their pace
    assert over.nominal_s - flat.nominal_s == pytest.approx(slower_s, rel=0.2)
