"""Several robots and controllers in one run."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.support.cart import make_cart
from vlnpe.collectors.controllers import CONTROLLERS, SpeedConfig
from vlnpe.collectors.replay.replay import ReplayConfig
from vlnpe.collectors.robots import ROBOTS
from vlnpe.formats.core.errors import InputError
from vlnpe.pipeline.collect.command import _widened
from vlnpe.pipeline.engine.ledger import Ledger, Row
from vlnpe.pipeline.inputs.crews import action_timing, chosen_robots, crews
from vlnpe.pipeline.stages.rollouts import replay_items
from vlnpe.trajectory_sampler.config import SampleConfig

BODYLESS = replace(make_cart(), name="ghost", joints=(), policy_joints=0)


def names(text: str) -> list[str]:
    return [robot.name for robot in chosen_robots(text)]


def test_names_lists_and_all_choose_robots() -> None:
    bodies = [name for name, robot in ROBOTS.items() if robot.joints]
    assert names("aliengo") == ["aliengo"]
    assert names("all") == bodies
    assert names(f"aliengo, {bodies[-1]},aliengo") == list(dict.fromkeys(["aliengo", bodies[-1]]))
    for name, robot in ROBOTS.items():
        if not robot.joints:
            assert name not in names("all")
            assert names(f"all,{name}") == [*bodies, name]


@pytest.mark.parametrize("text", ["walle", "aliengo,walle", "", "aliengo,,h1", ","])
def test_unusable_names_are_refused(text: str) -> None:
    with pytest.raises(InputError):
        chosen_robots(text)
    with pytest.raises(InputError):
        crews([make_cart()], text)


def test_a_robot_gets_the_controllers_that_can_drive_it() -> None:
    cart = make_cart()
    assert crews([cart, BODYLESS], "all") == [
        *((cart, name) for name in CONTROLLERS),
        (BODYLESS, "flash"),
    ]
    assert crews([cart, BODYLESS], "path,flash") == [
        (cart, "path"),
        (cart, "flash"),
        (BODYLESS, "flash"),
    ]
    with pytest.raises(InputError, match=r"ghost has no joints to drive; valid for it: flash"):
        crews([cart, BODYLESS], "path,speed")


def test_timing_of_discrete_actions_concerns_the_speed_controller_alone() -> None:
    closed = action_timing(SpeedConfig().steps_per_action, closed_loop=True)
    assert closed.end_on_displacement
    assert action_timing(50, closed_loop=False) == SpeedConfig()
    slow = action_timing(100, closed_loop=False)
    assert (slow.steps_per_action, slow.linear_m_s) == (100, 0.5)
    for controller in ("path", "flash"):
        walker = replay_items.walker(ROBOTS["h1"], controller, 3, closed)
        assert walker.config == ReplayConfig(robot="h1", controller=controller, seed=3)
    walker = replay_items.walker(ROBOTS["h1"], "speed", 3, closed)
    assert walker.config.speed == closed
    for name, controller, state in (
        ("h1", "path", "estimated"), ("h1", "flash", "true"), ("jetbot", "path", "true"),
    ):  # fmt: skip
        walker = replay_items.walker(ROBOTS[name], controller, 3, closed, "estimated")
        assert walker.config.state == state
    for steps in (0, -2, 33):
        with pytest.raises(InputError, match="VLN-PE uses 50"):
            action_timing(steps, closed_loop=False)


def test_episodes_keep_room_for_the_widest_robot(tmp_path: Path) -> None:
    ledger, plain = Ledger(tmp_path), SampleConfig()
    narrow = replace(make_cart(), footprint_radius_m=0.2)
    wide = replace(make_cart(), name="wide", footprint_radius_m=0.5)
    assert _widened(plain, [narrow], ledger) == plain
    both = _widened(plain, [narrow, wide], ledger)
    assert both.robot_radius_m == both.ends_m == 0.5
    ledger.add(Row("sample", "scene", "k", "done", facts={"robot_radius_m": 0.5}))
    # A narrower robot that joins later walks the same episodes.
    assert _widened(plain, [narrow], ledger) == both
