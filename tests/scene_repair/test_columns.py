"""Vertical samples come sorted, with few and with many surfaces in a cell; fast morphology."""

import numpy as np
import pytest
from scipy import ndimage

from vlnpe.formats.scene.grid import GridSpec
from vlnpe.scene_repair.grid import morphology
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


@pytest.mark.parametrize("seed", range(5))
def test_fast_morphology_is_scipys(seed: int) -> None:
    """Rectangles of even sides lie askew, and nothing is true outside the map."""
    rng = np.random.default_rng(seed)
    mask = rng.random(rng.integers(5, 60, 2)) < rng.choice([0.1, 0.3, 0.6, 0.9])
    size = tuple(rng.integers(1, 14, 2).tolist())
    for name in ("closing", "opening", "dilation", "erosion"):
        truth = getattr(ndimage, f"binary_{name}")(mask, np.ones(size))
        fast = {"dilation": "dilated", "erosion": "eroded"}.get(name, name)
        assert np.array_equal(getattr(morphology, fast)(mask, size), truth), (name, size)
    solid = rng.random(rng.integers(1, 12, 3)) < 0.1
    truth = ndimage.binary_dilation(solid, np.ones((3, 3, 3)), iterations=2)
    assert np.array_equal(morphology.grow_box(solid, 2), truth)
