"""Distances between paths, and the index of similar ones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vlnpe.trajectory_sampler.config import MEASURES
from vlnpe.trajectory_sampler.similarity import PathIndex, path_gap, stations


@pytest.mark.parametrize("measure", MEASURES)
def test_gap_tells_the_way_back_from_the_way_there(measure):
    path = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]])
    assert path_gap(path, path, measure) == pytest.approx(0.0)
    assert path_gap(path, path[::-1], measure) > 4.0
    assert path_gap(path, path + np.array([0.0, 0.7, 0.0]), measure) == pytest.approx(0.7)


def test_another_goal_is_another_path_by_frechet():
    path = np.array([[0.0, 0.0], [10.0, 0.0]])
    longer = np.array([[0.0, 0.0], [12.0, 0.0]])
    assert path_gap(path, longer) == pytest.approx(2.0)
    assert path_gap(path, longer, "dtw") < 0.3
    # A detour on the way counts, too: the dog's leash must reach across it.
    round_the_table = np.array([[0.0, 0.0], [5.0, 3.0], [10.0, 0.0]])
    assert path_gap(path, round_the_table) == pytest.approx(3.0, abs=0.2)


lines = arrays(
    np.float64, st.tuples(st.integers(2, 4), st.just(2)), elements=st.floats(-4, 4, width=16)
)


@settings(max_examples=60, deadline=None)
@given(st.lists(lines, min_size=1, max_size=12), st.sampled_from(MEASURES), st.floats(0.3, 4))
def test_the_index_finds_what_comparing_all_finds(paths, measure, reach_m):
    index = PathIndex(reach_m, measure)
    for path in paths[1:]:
        index.add(stations(path))
    expected = {
        k: gap
        for k, other in enumerate(paths[1:])
        if (gap := path_gap(paths[0], other, measure)) < reach_m
    }
    assert index.near(stations(paths[0])) == pytest.approx(expected)
