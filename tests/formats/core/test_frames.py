"""Frames: round trips, and the known values of the public data."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose

from vlnpe.formats.core import frames

angles = st.floats(-3.1, 3.1)
vectors = arrays(np.float64, 3, elements=st.floats(-1e3, 1e3))
quaternions = (
    arrays(np.float64, 4, elements=st.floats(-1, 1))
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)


def same_rotation(a, b):
    return min(np.linalg.norm(a - b), np.linalg.norm(a + b)) < 1e-7


@given(vectors)
def test_habitat_positions_round_trip(p):
    assert_allclose(frames.world_to_habitat_position(frames.habitat_to_world_position(p)), p)
    assert_allclose(
        frames.transform_points(frames.HABITAT_TO_WORLD, p), frames.habitat_to_world_position(p)
    )


@pytest.mark.parametrize(
    ("habitat", "world"),
    [
        ([0.0, 1.0, 0.0], [0, 0, 1]),  # up
        ([0.0, 0.0, -1.0], [0, 1, 0]),  # ahead
        # Matterport's camera at (x, y, z), height h above the floor: Habitat (x, z − h, −y).
        ([3.0, 1.7 - 1.5, 2.0], [3.0, -2.0, 1.7 - 1.5]),
    ],
)
def test_known_positions(habitat, world):
    assert_allclose(frames.habitat_to_world_position(habitat), world)


@pytest.mark.parametrize(
    ("rotation_xyzw", "degrees"),
    [
        ([0, 0, 0, 1], 90),  # Habitat's identity looks along −z, which is world +y.
        # R2R-CE val_unseen, episode 1: a turn of 60° about y, to which VLN-PE adds 90°.
        ([0, 0.5, 0, 0.8660254], 150),
    ],
)
def test_known_headings(rotation_xyzw, degrees):
    yaw = frames.habitat_to_world_yaw(rotation_xyzw)
    assert yaw == pytest.approx(np.deg2rad(degrees), abs=1e-6)


@given(angles)
def test_habitat_headings_round_trip(yaw):
    back = frames.habitat_to_world_yaw(frames.world_to_habitat_rotation(yaw))
    assert abs(frames.wrap_angle(back - yaw)) < 1e-9


@given(quaternions)
def test_matrix_round_trip_and_orthonormality(q):
    m = frames.quat_to_matrix(q)
    assert_allclose(m @ m.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(m) == pytest.approx(1.0)
    assert same_rotation(frames.matrix_to_quat(m), q)


def test_w_moves_first():
    assert_allclose(frames.xyzw_to_wxyz([0.1, 0.2, 0.3, 0.9]), [0.9, 0.1, 0.2, 0.3])


@given(quaternions, quaternions)
def test_product_of_quaternions_is_product_of_matrices(a, b):
    product = frames.quat_to_matrix(frames.quat_multiply(a, b))
    assert_allclose(product, frames.quat_to_matrix(a) @ frames.quat_to_matrix(b), atol=1e-12)


@given(angles)
def test_yaw_round_trip(yaw):
    q = frames.yaw_to_quat(yaw)
    assert frames.quat_to_yaw(q) == pytest.approx(yaw, abs=1e-9)
    assert_allclose(frames.quat_to_matrix(q)[:, 0], [np.cos(yaw), np.sin(yaw), 0], atol=1e-12)


@given(st.floats(-100, 100))
def test_wrapped_angles_are_the_same_direction(angle):
    wrapped = float(frames.wrap_angle(angle))
    assert -np.pi <= wrapped < np.pi
    assert np.cos(wrapped) == pytest.approx(np.cos(angle), abs=1e-9)
    assert np.sin(wrapped) == pytest.approx(np.sin(angle), abs=1e-9)


def test_optical_axes():
    forward, left, up = np.eye(3)
    assert_allclose(frames.OPTICAL_IN_BODY @ [0, 0, 1], forward)
    assert_allclose(frames.OPTICAL_IN_BODY @ [1, 0, 0], -left)
    assert_allclose(frames.OPTICAL_IN_BODY @ [0, 1, 0], -up)


@pytest.mark.parametrize("target", [(3.0, 1.0, 0.2), (0.0, 0.0, 5.0), (0.0, 0.0, -5.0)])
def test_a_camera_looks_at_its_target_and_stays_level(target: tuple[float, float, float]) -> None:
    axes = frames.look_at([0.0, 0.0, 1.0], target)
    ahead = np.array(target) - (0, 0, 1)
    assert axes[:, 2] == pytest.approx(ahead / np.linalg.norm(ahead))
    assert axes.T @ axes == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1)
    assert axes[2, 0] == pytest.approx(0)
    assert axes[2, 1] <= 1e-9, "image down is not up"
