"""The frame table's columns agree with the rollout they were taken from."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.support.paths import integrate_motion
from tests.support.rollouts import make_frames, make_rollout
from vlnpe.formats.core.frames import quat_to_matrix, quat_to_yaw, wrap_angle, yaw_to_quat
from vlnpe.formats.core.rollout import REST_EVENT, Action, ActionSpan, Event
from vlnpe.formats.rendered.discrete_steps import discrete_steps, planar_poses
from vlnpe.formats.rendered.table import build_frame_table, planar_motion

RATES = [1, 2, 4, 5, 10, 20, 25, 50]


@pytest.mark.parametrize("rate", RATES)
def test_integrating_the_actions_gives_the_trajectory(rate: int) -> None:
    rollout = make_rollout(6.0)
    table = build_frame_table(rollout, make_frames(rollout, rate), rate)
    state, action = table.columns["observation.state"], table.columns["action"]
    walked = integrate_motion(action, np.zeros(3))
    np.testing.assert_allclose(walked[:, :2], state[:, :2], atol=1e-5)
    np.testing.assert_allclose(
        wrap_angle(walked[:, 2] - quat_to_yaw(state[:, 3:7])), 0.0, atol=1e-5
    )
    assert np.all(action[-1] == 0)


@settings(max_examples=60, deadline=None)
@given(
    poses=arrays(np.float64, (7, 3), elements=st.floats(-50, 50)),
    turns=arrays(np.float64, (7,), elements=st.floats(-3.1, 3.1)),
)
def test_motion_and_its_integral_are_inverse(poses: np.ndarray, turns: np.ndarray) -> None:
    yaw = np.cumsum(turns)
    motion = planar_motion(poses, yaw_to_quat(yaw))
    back = integrate_motion(motion, np.array([*poses[0, :2], yaw[0]]))
    np.testing.assert_allclose(back[:, :2], poses[:, :2], atol=1e-9)
    np.testing.assert_allclose(wrap_angle(back[:, 2] - yaw), 0.0, atol=1e-9)


@pytest.mark.parametrize("number", range(4))
def test_the_start_frame_is_on_the_floor_and_looks_along_x(number: int) -> None:
    rollout = make_rollout(2.0, number)
    state = build_frame_table(rollout, make_frames(rollout), 4).columns["observation.state"]
    np.testing.assert_allclose(state[0, :2], 0.0, atol=1e-7)
    height = rollout.position_world_m[0, 2] - rollout.floor_z_m[0]
    assert state[0, 2] == pytest.approx(height, abs=1e-6)
    assert quat_to_yaw(state[0, 3:7]) == pytest.approx(0.0, abs=1e-6)


def test_poses_differ_from_the_world_by_one_rigid_turn_about_gravity() -> None:
    rollout = make_rollout(4.0)
    frames = make_frames(rollout)
    table = build_frame_table(rollout, frames, 4)
    state, camera = table.columns["observation.state"], table.columns["observation.camera_pose"]
    yaw = quat_to_yaw(rollout.quat_wxyz[0])
    turn = quat_to_matrix(yaw_to_quat(yaw))
    origin = np.array([*rollout.position_world_m[0, :2], rollout.floor_z_m[0]])
    for ours, position, quat in (
        (state[:, :7], rollout.position_world_m[frames["sample_index"]], rollout.quat_wxyz),
        (camera, frames["camera_position_world_m"], frames["camera_quat_wxyz"]),
    ):
        quat = quat if len(quat) == len(ours) else quat[frames["sample_index"]]
        np.testing.assert_allclose(ours[:, :3] @ turn.T + origin, position, atol=1e-5)
        np.testing.assert_allclose(
            turn @ quat_to_matrix(ours[:, 3:]), quat_to_matrix(quat), atol=1e-5
        )
        assert np.all(np.sum(ours[1:, 3:] * ours[:-1, 3:], axis=1) > 0)  # no sign jumps


def test_velocities_joints_and_commands_are_the_samples() -> None:
    rollout = make_rollout(3.0)
    table = build_frame_table(rollout, make_frames(rollout, 10), 10)
    at = rollout.frame_samples(10)
    columns = table.columns
    joints = rollout.joint_position_rad.shape[1]
    np.testing.assert_array_equal(
        columns["observation.joints"][:, :joints], rollout.joint_position_rad[at].astype("f4")
    )
    np.testing.assert_array_equal(columns["observation.imu"], rollout.imu[at].astype("f4"))
    np.testing.assert_array_equal(columns["observation.foot_contact"], rollout.foot_contact[at])
    force = rollout.foot_force_n[at].astype(np.float32)
    np.testing.assert_array_equal(columns["observation.foot_force"], force)
    np.testing.assert_array_equal(columns["action.velocity"], rollout.command[at].astype("f4"))
    np.testing.assert_array_equal(
        columns["observation.state"][:, 7:10], rollout.linear_velocity_base_m_s[at].astype("f4")
    )
    assert columns["observation.progress"][0] == 0 and columns["observation.progress"][-1] == 1
    for key, values in columns.items():
        assert values.shape == (len(at), len(table.column_names[key])), key
        assert np.all(np.isfinite(values)), key


def test_executed_actions_are_read_from_the_spans() -> None:
    rollout = make_rollout(3.0, discrete=True)
    table = build_frame_table(rollout, make_frames(rollout), 4)
    expected = [span.action for span in rollout.actions]
    assert table.columns["action.discrete"][:, 0].tolist() == expected
    assert expected[-1] == Action.STOP
    assert not table.discrete_derived


def test_a_path_rollout_has_the_experts_labels_flagged() -> None:
    left = (Action.LEFT, *[Action.FORWARD] * 10, Action.STOP, Action.STOP)
    rollout = dataclasses.replace(make_rollout(3.0), labels=left)
    table = build_frame_table(rollout, make_frames(rollout), 4)
    assert table.discrete_derived
    assert table.columns["action.discrete"][:, 0].tolist() == [2, *[1] * 11, 0]


def test_without_labels_it_has_what_the_robot_did_next() -> None:
    rollout = make_rollout(3.0)
    table = build_frame_table(rollout, make_frames(rollout), 4)
    steps = discrete_steps(planar_poses(table.columns["observation.state"]))
    for frame, action in enumerate(table.columns["action.discrete"][:, 0]):
        assert action == steps.action[steps.frame >= frame][0]


def test_stop_is_one_frame_at_rest() -> None:
    """STOP was commanded at 2.2 s, the robot rested at 2.6 s, and was recorded until 3 s."""
    rollout = make_rollout(3.0, discrete=True)
    spans = (*rollout.actions[:8], ActionSpan(Action.STOP, 220, 301))
    rest = (*rollout.events, Event(2.6, REST_EVENT))
    rollout = dataclasses.replace(rollout, actions=spans, events=rest)
    assert rollout.frame_samples(4)[-1] == 275 and rollout.frame_samples(10)[-1] == 260
    table = build_frame_table(rollout, make_frames(rollout), 4)
    actions = table.columns["action.discrete"][:, 0].tolist()
    assert actions == [*(s.action for s in spans[:8]), *[spans[7].action] * 3, Action.STOP]


@pytest.mark.parametrize("rate", [1, 5, 10])
def test_discrete_actions_exist_at_their_own_rate_only(rate: int) -> None:
    rollout = make_rollout(3.0, discrete=True)
    table = build_frame_table(rollout, make_frames(rollout, rate), rate)
    assert "action.discrete" not in table.columns and "action.discrete" not in table.column_names
    assert not table.discrete_derived


def test_one_frame_is_a_stop() -> None:
    rollout = make_rollout(0.1)
    table = build_frame_table(rollout, make_frames(rollout), 4)
    assert len(table) == 1
    assert table.columns["observation.progress"].tolist() == [[1.0]]
    assert table.columns["action.discrete"].tolist() == [[Action.STOP]]


def test_frames_of_another_rate_or_rollout_are_refused() -> None:
    rollout = make_rollout(3.0)
    with pytest.raises(ValueError, match="at 5 frames/s"):
        build_frame_table(rollout, make_frames(rollout, 4), 5)
    with pytest.raises(ValueError, match="rendered frames are not"):
        build_frame_table(make_rollout(1.0), make_frames(rollout, 4), 4)
    frames = make_frames(rollout)
    del frames["camera_quat_wxyz"]
    with pytest.raises(ValueError, match="camera_quat_wxyz"):
        build_frame_table(rollout, frames, 4)


def test_a_flipped_quaternion_changes_nothing() -> None:
    rollout = make_rollout(3.0)
    frames = make_frames(rollout)
    signs = np.where(np.arange(len(rollout.time_s)) % 2, 1.0, -1.0)[:, None]
    flipped = dataclasses.replace(rollout, quat_wxyz=rollout.quat_wxyz * signs)
    one = build_frame_table(rollout, frames, 4).columns["observation.state"]
    two = build_frame_table(flipped, frames, 4).columns["observation.state"]
    np.testing.assert_array_equal(one, two)
