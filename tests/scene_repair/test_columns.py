"""Vertical samples come sorted, in cells with few and with many surfaces above each other."""

import numpy as np
import pytest

from vlnpe.formats.scene.grid import GridSpec
from vlnpe.scene_repair.grid.columns import INSERTED, sample_columns


@pytest.mark.parametrize("count", [5, INSERTED + 30])
def test_hits_of_a_cell_are_sorted_and_equal_ones_keep_their_order(count: int) -> None:
    rng = np.random.default_rng(0)
    # Few different heights, so that many are equal.
    height = rng.integers(0, 4, count) / 4
    corner = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]])
    vertices = np.concatenate([np.c_[corner, np.full(3, z)] for z in height])
    faces = np.arange(3 * count).reshape(count, 3)
    columns = sample_columns(vertices, faces, GridSpec((0.0, 0.0), 0.5, 2, 2))
    for cell in range(4):
        hits = slice(columns.start[cell], columns.start[cell + 1])
        expected = np.argsort(height, kind="stable")
        assert columns.face[hits].tolist() == expected.tolist()
        assert columns.z[hits].tolist() == height[expected].tolist()
