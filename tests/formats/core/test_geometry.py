"""Geometry of triangles and paths: properties that hold for any input."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose

from vlnpe.formats.core.frames import quat_to_matrix
from vlnpe.formats.core.geometry import (
    arc_length,
    distinct_rows,
    path_length,
    point_along,
    point_along_plan,
    resample,
    space_evenly,
    triangle_areas,
    triangle_cross,
    triangle_normals,
    triangle_normals_and_areas,
)

COORDINATE = st.floats(-50, 50)
TRIANGLES = arrays(
    np.float64, st.tuples(st.integers(1, 6), st.just(3), st.just(3)), elements=COORDINATE
)
PATHS = arrays(np.float64, st.tuples(st.integers(1, 12), st.integers(2, 3)), elements=COORDINATE)
ROTATIONS = (
    arrays(np.float64, 4, elements=st.floats(-1, 1))
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(quat_to_matrix)
)


# Its area's square is below what floating point can tell from zero.
SLIVER = np.array([[[2.83301563e-162, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]])


@settings(deadline=None)
@given(TRIANGLES)
@example(SLIVER)
def test_normals_are_unit_or_zero_and_square_to_the_edges(corners: np.ndarray) -> None:
    normals, areas = triangle_normals_and_areas(corners)
    length = np.linalg.norm(normals, axis=1)
    assert_allclose(length[areas > 0], 1.0)
    assert not normals[areas == 0].any()
    edges = np.roll(corners, -1, axis=1) - corners
    scale = np.linalg.norm(edges, axis=2)
    wide = areas > 1e-3 * scale.max(axis=1) ** 2
    tilt = np.einsum("fkc,fc->fk", edges, normals)
    assert (np.abs(tilt[wide]) <= 1e-9 * scale[wide]).all()
    assert np.array_equal(triangle_normals(corners), normals)
    assert np.array_equal(triangle_areas(corners), areas)


@settings(deadline=None)
@given(TRIANGLES, ROTATIONS, arrays(np.float64, 3, elements=COORDINATE))
def test_crosses_turn_with_the_triangles_and_flip_with_their_winding(
    corners: np.ndarray, rotation: np.ndarray, shift: np.ndarray
) -> None:
    cross = triangle_cross(corners)
    moved = corners @ rotation.T + shift
    assert_allclose(triangle_cross(moved), cross @ rotation.T, atol=1e-8)
    assert_allclose(triangle_cross(corners[:, ::-1]), -cross, atol=1e-9)
    assert_allclose(triangle_cross(corners[:, [1, 2, 0]]), cross, atol=1e-9)


@settings(deadline=None)
@given(TRIANGLES)
def test_areas_follow_heron(corners: np.ndarray) -> None:
    side = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    half = side.sum(axis=1) / 2
    squared = np.maximum(half * np.prod(half[:, None] - side, axis=1), 0.0)
    assert_allclose(triangle_areas(corners) ** 2, squared, rtol=1e-6, atol=1e-9 * half.max() ** 4)


def test_single_precision_stays_single() -> None:
    corners = np.eye(3, dtype=np.float32)[None]
    normals, areas = triangle_normals_and_areas(corners)
    assert (normals.dtype, areas.dtype) == (np.float32, np.float32)
    assert normals[0] == pytest.approx(np.full(3, 3**-0.5))
    assert areas[0] == pytest.approx(3**0.5 / 2)


@settings(deadline=None)
@given(PATHS)
def test_arc_length_rises_from_zero_to_the_whole_length(path: np.ndarray) -> None:
    along = arc_length(path)
    assert along.shape == (len(path),)
    assert along[0] == 0.0
    assert (np.diff(along) >= 0).all()
    assert along[-1] == pytest.approx(path_length(path))


@settings(deadline=None)
@given(PATHS, st.floats(-0.5, 1.5))
def test_point_along_divides_the_length_and_is_clamped(path: np.ndarray, share: float) -> None:
    length = path_length(path)
    point = point_along(path, share * length)
    assert np.array_equal(point_along(path, [-1.0, length + 1.0]), path[[0, -1]])
    k = int(np.searchsorted(arc_length(path), share * length, side="right"))
    before = np.vstack([path[: max(k, 1)], point])
    assert path_length(before) == pytest.approx(np.clip(share, 0, 1) * length, abs=1e-6)


@settings(deadline=None)
@given(PATHS.map(lambda path: path.round(6)), st.floats(0.5, 5.0))
def test_resample_keeps_every_corner_and_the_length(path: np.ndarray, spacing: float) -> None:
    dense = resample(path, spacing)
    assert np.linalg.norm(np.diff(dense, axis=0), axis=1).max() <= spacing * (1 + 1e-6)
    assert path_length(dense) == pytest.approx(path_length(path))
    assert all((np.abs(dense - corner).max(axis=1) < 1e-9).any() for corner in path)


@settings(deadline=None)
@given(PATHS, st.floats(0.5, 5.0))
def test_space_evenly_keeps_the_ends_and_never_lengthens(path: np.ndarray, step: float) -> None:
    dense = space_evenly(path, step)
    assert_allclose(dense[0], path[0], atol=1e-12)
    if path_length(path) > 0:
        assert_allclose(dense[-1], path[-1], atol=1e-12)
    assert np.linalg.norm(np.diff(dense, axis=0), axis=1).max(initial=0.0) <= step * (1 + 1e-6)
    assert path_length(dense) <= path_length(path) + 1e-9


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.9, 1.0])
def test_a_place_in_plan_is_on_the_slope(share: float) -> None:
    path = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [5.0, 0.0, 3.0], [7.0, 0.0, 3.0]])
    point = point_along_plan(path, 7.0 * share)
    assert_allclose(point, [7.0 * share, 0.0, np.clip(7.0 * share - 2.0, 0.0, 3.0)])
    assert np.array_equal(point_along_plan(path[:2], share), point_along(path[:2], share))


@given(
    arrays(np.int64, st.tuples(st.integers(0, 12), st.integers(1, 3)), elements=st.integers(-2, 2))
)
def test_distinct_rows_are_those_of_numpy(rows: np.ndarray):
    _, first, kind = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    found = distinct_rows(rows)
    np.testing.assert_array_equal(found[0], first)
    np.testing.assert_array_equal(found[1], kind.ravel())
