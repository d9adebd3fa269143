"""VLN-CE's bodyless agent: a cylinder that is placed, never driven, and seen only by others."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.collectors.test_replay import make_episode, with_box
from vlnpe.collectors.controllers import valid_controllers
from vlnpe.collectors.replay.replay import ReplayConfig, replay_episode
from vlnpe.collectors.robots import RobotHandles, get_robot
from vlnpe.formats.core.errors import InputError
from vlnpe.formats.core.rollout import EndReason, Rollout
from vlnpe.formats.mcap.rollout import read_rollout, write_rollout
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.pipeline.inputs.crews import chosen_robots, crews
from vlnpe.rendering.camera.rollout_frames import RolloutFrames
from vlnpe.rendering.camera.views import make_view
from vlnpe.rendering.embree import SceneRenderer

pytestmark = pytest.mark.chain

FLASH = ReplayConfig(robot="vlnce", controller="flash")


@pytest.fixture(scope="module")
def rollout(two_rooms: SceneBundle) -> Rollout:
    return replay_episode(two_rooms, make_episode(two_rooms, yaw=0.3), FLASH)


def test_it_is_a_cylinder_with_a_camera():
    robot = get_robot("vlnce")
    model = robot.build_model()
    data = mujoco.MjData(model)
    handles = RobotHandles.find(robot, model)
    handles.spawn(data)
    mujoco.mj_forward(model, data)
    assert data.cam_xpos[handles.camera, 2] == pytest.approx(1.25, abs=0.002)
    assert -data.cam_xmat[handles.camera].reshape(3, 3)[2, 2] == pytest.approx(0.0, abs=1e-12)
    # Things thrown at it from the side hit at 0.1 m, up to 1.5 m.
    collision = np.array([0, 0, 0, 1, 0, 0], dtype=np.uint8)
    hit = np.zeros(1, dtype=np.int32)
    for height, expected in ((0.2, 0.9), (0.8, 0.9), (1.49, 0.9), (1.51, -1.0)):
        for angle in np.linspace(0, 2 * np.pi, 12, endpoint=False):
            out = np.array([np.cos(angle), np.sin(angle), 0.0])
            origin = out + np.array([0, 0, height])
            distance = mujoco.mj_ray(model, data, origin, -out, collision, 1, -1, hit)
            assert distance == pytest.approx(expected, abs=1e-6)


def test_it_flashes_to_the_goal(rollout: Rollout):
    assert rollout.end_reason is EndReason.SUCCESS
    assert rollout.robot == "vlnce"
    # It stands upright on the floor all the time, and every jump is a step of 0.25 m or a turn.
    height = rollout.position_world_m[:, 2] - rollout.floor_z_m
    np.testing.assert_allclose(height, 0.753, atol=1e-3)
    np.testing.assert_allclose(rollout.quat_wxyz[:, 1:3], 0.0, atol=1e-12)
    steps = np.linalg.norm(np.diff(rollout.position_world_m, axis=0), axis=1)
    assert set(np.round(steps, 6)) == {0.0, 0.25}


def test_a_rollout_without_joints_survives_its_file(rollout: Rollout, tmp_path: Path):
    write_rollout(tmp_path / "r.mcap", rollout)
    again = read_rollout(tmp_path / "r.mcap")
    assert again.joint_names == ()
    assert again.joint_position_rad.shape == (len(again.time_s), 0)
    np.testing.assert_array_equal(again.position_world_m, rollout.position_world_m)


def test_a_target_inside_furniture_is_flagged(tmp_path: Path):
    # The map knows nothing of this box, which stands in the doorway.
    bundle = with_box(tmp_path, (4.0, 2.0, 0.6), (0.1, 0.5, 0.1))
    events = replay_episode(bundle, make_episode(bundle), FLASH).events
    assert {event.kind for event in events} == {"collision_target"}


def test_it_is_seen_from_behind_and_not_by_itself(two_rooms: SceneBundle, rollout: Rollout):
    renderer = SceneRenderer(two_rooms)
    samples = np.array([0, 250])
    for kind, seen in (("ego", False), ("chase", True)):
        view = make_view(kind, "vlnce", width_px=96, height_px=96)
        plan = RolloutFrames.plan(renderer, rollout, view, samples)
        for n, (rgb, _) in enumerate(plan.render(renderer)):
            position, quat = plan.path.position_world_m[n], plan.path.quat_wxyz[n]
            empty, _ = renderer.render(view.camera, position, quat)
            assert (np.abs(rgb.astype(int) - empty).max() > 60) == seen


@pytest.mark.parametrize("controller", ["path", "speed"])
def test_controllers_that_drive_are_refused(two_rooms: SceneBundle, controller: str):
    with pytest.raises(InputError, match=r"vlnce has no joints to drive; valid for it: flash"):
        replay_episode(
            two_rooms, make_episode(two_rooms), ReplayConfig(robot="vlnce", controller=controller)
        )
    with pytest.raises(InputError, match="valid for it: flash"):
        crews([get_robot("vlnce")], controller)


def test_by_itself_it_flashes_while_the_others_follow_the_path():
    robots = chosen_robots("aliengo,vlnce")
    aliengo, vlnce = robots
    assert crews(robots, "auto") == [(aliengo, "path"), (vlnce, "flash")]
    assert crews(robots, "speed,flash") == [
        (aliengo, "speed"),
        (aliengo, "flash"),
        (vlnce, "flash"),
    ]


def test_all_means_every_robot_with_a_body():
    names = [robot.name for robot in chosen_robots("all")]
    assert "jetbot" in names
    assert "vlnce" not in names
    assert [robot.name for robot in chosen_robots("all,vlnce")] == [*names, "vlnce"]


def test_only_the_bodyless_agent_cannot_be_driven():
    assert valid_controllers(get_robot("vlnce")) == ["flash"]
    assert valid_controllers(get_robot("jetbot")) == ["path", "speed", "flash"]
