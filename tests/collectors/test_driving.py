"""Drives of a person: what is on disk, undo and resumption to the bit."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from tests.collectors.test_replay import make_episode
from tests.support.cart import CartGait, make_cart
from vlnpe.collectors.driving.controls import SILENCE_S, Controls
from vlnpe.collectors.driving.drive import Drive, driven_episode, replay_drive, state_digest
from vlnpe.collectors.driving.journal import read_journal
from vlnpe.collectors.physics.outcome import OutcomeConfig
from vlnpe.collectors.replay.config import ReplayConfig
from vlnpe.collectors.replay.world import World, open_world
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.errors import FileFormatError, InputError
from vlnpe.formats.core.rollout import HUMAN, Action, EndReason, Rollout
from vlnpe.formats.scene.bundle import SceneBundle

pytestmark = pytest.mark.chain

AHEAD, LEFT, NOTHING = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
CONTROLLERS = ("path", "speed")  # velocities, discrete actions


class Clock:
    """Time that passes when it is told to."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture(scope="module", params=["cart", "aliengo"])
def world(request: pytest.FixtureRequest, two_rooms: SceneBundle) -> World:
    if request.param == "cart":
        return open_world(two_rooms, 0, make_cart(), CartGait())
    return open_world(two_rooms, 0, get_robot(request.param))


@pytest.fixture
def episode(two_rooms: SceneBundle) -> Episode:
    return make_episode(two_rooms)


class Driver:
    """A drive, and a person who holds sticks for a time."""

    def __init__(
        self,
        world: World,
        episode: Episode,
        controller: str,
        path: Path,
        config: ReplayConfig | None = None,
    ) -> None:
        self.clock = Clock()
        self.controls = Controls(clock=self.clock)
        self.config = config or ReplayConfig(
            robot=world.robot.name,
            controller=controller,
            outcome=OutcomeConfig(timeout_factor=math.inf),
        )
        header = None if path.is_file() else {"driver": "Ada"}
        self.drive = Drive(world, episode, self.config, self.controls, path, header)
        self.path = path

    def hold(self, axes: tuple[float, float, float], seconds: float) -> None:
        for _ in range(round(seconds * 50)):
            self.controls.hold(*axes)
            self.drive.step()
            self.clock.now_s += 0.02

    def stop(self) -> EndReason:
        self.controls.stop()
        for _ in range(1000):
            self.drive.step()
            if self.drive.end is not None:
                return self.drive.end
        raise AssertionError("it does not end")

    def rollout(self) -> Rollout:
        run = self.drive.run
        return replay_drive(run.world, run.episode, self.config, self.path, "Ada")


def assert_equal(one: Rollout, other: Rollout) -> None:
    for name in ("position_world_m", "quat_wxyz", "joint_torque_nm", "imu", "command"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert one.actions == other.actions and one.end_reason == other.end_reason


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_the_rollout_of_the_journal_is_the_drive(
    world: World, episode: Episode, controller: str, tmp_path: Path
) -> None:
    driver = Driver(world, episode, controller, tmp_path / "drive.drive")
    driver.hold(AHEAD, 2.0)
    driver.hold(LEFT, 1.0)
    end = driver.stop()
    live = driver.drive.run.finish(end)
    driver.drive.keep(episode)
    rollout = driver.rollout()
    assert_equal(rollout, live)
    assert (rollout.controller, rollout.facts["driver"]) == (HUMAN, "Ada")
    assert bool(rollout.actions) == (controller == "speed")
    track = rollout.position_world_m[:, :2]
    assert np.linalg.norm(track[-1] - track[0]) > 0.5
    assert rollout.end_reason is EndReason.STOPPED_FAR


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_undo_leaves_the_bits_of_a_drive_that_never_erred(
    world: World, episode: Episode, controller: str, tmp_path: Path
) -> None:
    straight = Driver(world, episode, controller, tmp_path / "straight.drive")
    straight.hold(AHEAD, 2.0)
    tick, digest = straight.drive.run.tick, state_digest(world)
    straight.hold(LEFT, 1.0)
    straight.stop()
    straight.drive.keep(episode)

    erring = Driver(world, episode, controller, tmp_path / "erring.drive")
    erring.hold(AHEAD, 2.0)
    erring.hold(LEFT, 1.0)
    erring.hold(AHEAD, 1.3)
    erring.drive.undo(2.1)
    assert erring.drive.run.tick == tick
    assert state_digest(world) == digest
    erring.hold(LEFT, 1.0)
    erring.drive.undo(0.9)  # twice to the same state
    erring.hold(LEFT, 1.0)
    erring.stop()
    erring.drive.keep(episode)

    undone = erring.rollout()
    assert_equal(undone, straight.rollout())
    events = [event for event in undone.events if event.kind == "undo"]
    assert [event.time_s for event in events] == [2.0, 2.0]
    first, *_ = cast("list[tuple[float, float]]", undone.facts["undone"])
    assert first[1] == 2.0


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("cut", [0, 7])
def test_a_killed_drive_goes_on_where_it_was(
    world: World, episode: Episode, controller: str, cut: int, tmp_path: Path
) -> None:
    whole = Driver(world, episode, controller, tmp_path / "whole.drive")
    whole.hold(AHEAD, 1.3)
    whole.hold(LEFT, 0.6)
    whole.stop()

    path = tmp_path / "killed.drive"
    killed = Driver(world, episode, controller, path)
    killed.hold(AHEAD, 1.3)  # nothing is closed
    content = path.read_bytes()
    path.write_bytes(content[: len(content) - cut])
    resumed = Driver(world, episode, controller, path)
    if not cut:
        assert resumed.drive.run.tick == killed.drive.run.tick
    resumed.hold(AHEAD, 1.3 - resumed.drive.time_s)
    resumed.hold(LEFT, 0.6)
    resumed.stop()
    assert_equal(resumed.rollout(), whole.rollout())


def test_time_stands_still_while_nothing_is_asked_for(
    world: World, episode: Episode, tmp_path: Path
) -> None:
    driver = Driver(world, episode, "path", tmp_path / "drive.drive")
    driver.hold(NOTHING, 5.0)
    driver.drive.undo(1.0)
    assert driver.drive.time_s == 0.0
    assert not driver.path.exists()
    driver.hold(AHEAD, 1.0)
    driver.hold(NOTHING, 5.0)
    assert 1.2 < driver.drive.time_s < 3.6  # until it was at rest
    assert driver.drive.run.watch.speed_m_s() < 0.2


def test_silence_lets_go(world: World, episode: Episode, tmp_path: Path) -> None:
    driver = Driver(world, episode, "path", tmp_path / "drive.drive")
    driver.hold(AHEAD, 1.5)
    assert driver.drive.run.command[0] > 0.5
    driver.clock.now_s += SILENCE_S
    for _ in range(20):
        driver.drive.step()
    assert driver.drive.run.command == (0.0, 0.0, 0.0)


def test_a_tap_is_one_action(world: World, episode: Episode, tmp_path: Path) -> None:
    driver = Driver(world, episode, "speed", tmp_path / "drive.drive")
    driver.controls.hold(*AHEAD)
    driver.controls.hold(*NOTHING)
    for _ in range(100):
        driver.drive.step()
    assert [action for action, _ in driver.drive.run.actions] == [Action.FORWARD]
    assert driver.drive.time_s == 0.25


def test_what_ended_a_drive_can_be_taken_back(two_rooms: SceneBundle, tmp_path: Path) -> None:
    world = open_world(two_rooms, 0, make_cart(), CartGait())
    driver = Driver(
        world, make_episode(two_rooms, start=(3.0, 1.0)), "path", tmp_path / "drive.drive"
    )
    driver.hold(AHEAD, 30.0)
    assert driver.drive.end is EndReason.STUCK
    driver.drive.undo(driver.drive.time_s)
    assert driver.drive.end is None and driver.drive.time_s == 0.0
    driver.hold(LEFT, 1.0)
    driver.stop()
    driver.drive.keep(driver.drive.run.episode)
    rollout = driver.rollout()
    assert rollout.end_reason is EndReason.STOPPED_FAR and rollout.metrics.duration_s < 5.0
    assert rollout.events[0].kind == "undo"


def test_a_free_drive_becomes_an_episode_of_its_own_way(
    world: World, episode: Episode, tmp_path: Path
) -> None:
    driver = Driver(world, episode, "path", tmp_path / "drive.drive")
    driver.hold(AHEAD, 3.0)
    track = driver.drive.run.recorder.arrays()["position_world_m"][:, :2]
    with pytest.raises(InputError, match="no path"):
        driven_episode(world, episode, track[:10])
    driver.stop()
    own = driver.drive.own_episode
    rollout = replay_drive(world, own, driver.config, driver.path, "")
    assert rollout.end_reason is EndReason.SUCCESS
    assert rollout.metrics.success and rollout.metrics.ndtw > 0.95
    assert np.allclose(own.goal_position_world_m[:2], rollout.position_world_m[-1, :2])


def test_damage_and_other_physics_are_told(world: World, episode: Episode, tmp_path: Path) -> None:
    path = tmp_path / "drive.drive"
    driver = Driver(world, episode, "path", path)
    driver.hold(AHEAD, 1.5)
    with pytest.raises(FileFormatError, match="has no end"):
        driver.rollout()
    driver.stop()
    driver.drive.keep(episode)
    content = path.read_bytes()
    lines = content.split(b"\n")
    middle = len(lines) // 2
    path.write_bytes(b"\n".join([*lines[:middle], lines[middle][:-1] + b"x", *lines[middle + 1 :]]))
    with pytest.raises(FileFormatError, match=f"line {middle + 1} is damaged"):
        driver.rollout()
    path.write_bytes(content)
    moved = replace(episode, start_yaw_rad=0.01)
    with pytest.raises(FileFormatError, match="another state at 1 s"):
        replay_drive(world, moved, driver.config, path, "")
    kept = read_journal(path).kept
    assert kept is not None and kept["episode"]["episode_id"] == "e0"


def test_a_drive_that_cannot_go_on_leaves_nothing_to_the_next(
    world: World, episode: Episode, tmp_path: Path
) -> None:
    path = tmp_path / "drive.drive"
    driver = Driver(world, episode, "path", path)
    driver.hold(AHEAD, 1.5)
    content = path.read_bytes()
    with pytest.raises(FileFormatError, match="another state at 1 s"):
        Drive(world, replace(episode, start_yaw_rad=0.5), driver.config, driver.controls, path)
    assert path.read_bytes() == content
    driver.controls.release()
    fresh = Drive(world, episode, driver.config, driver.controls, tmp_path / "next.drive", {})
    assert not fresh.step() and fresh.time_s == 0.0


@pytest.mark.parametrize("axes", [(float("nan"), 0.0, 0.0), (0.0, float("inf"), 0.0)])
def test_sticks_are_numbers(axes: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="valid: numbers"):
        Controls().hold(*axes)


def test_sticks_end_at_one() -> None:
    now: Callable[[], float] = lambda: 0.0  # noqa: E731
    controls = Controls(clock=now)
    controls.hold(9.0, -9.0, 0.5)
    assert controls.axes() == (1.0, -1.0, 0.5)
