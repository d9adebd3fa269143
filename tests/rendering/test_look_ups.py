"""Look-ups of the kernels against plain numpy: light in a grid, texels of a packed texture."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from vlnpe.rendering.kernels.cube_grid import AXES, CubeGrid, cell_centers, filled
from vlnpe.rendering.kernels.surface_light import cube_at
from vlnpe.rendering.scene.textures import mip_pyramid, pack_textures

IN_FRONT = 0.75  # of a cell: where the light of a surface is looked up


@njit
def light_at(grid, point, normal):
    """`cube_at`, which is inlined into kernels."""
    return cube_at(grid, point[0], point[1], point[2], normal[0], normal[1], normal[2])


def expected_light(grid: CubeGrid, point, normal) -> float:
    """Return the trilinear value, one corner after the other."""
    cells = np.array(grid.cube.shape[2::-1])
    place = (np.asarray(point) - grid.lower_m) * grid.per_m + IN_FRONT * np.asarray(normal)
    place = np.clip(place, 0.0, cells - 1)
    low = np.minimum(place.astype(int), cells - 2)
    toward = np.maximum(AXES @ normal, 0.0) ** 2
    total = 0.0
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, place - low, 1.0 - (place - low)))
        x, y, z = low + corner
        total += weight * (grid.cube[z, y, x, :6] @ toward)
    return total * float(grid.scale)


@settings(max_examples=40, deadline=None)
@given(
    size_m=st.tuples(*[st.sampled_from([0.1, 0.4, 0.7, 1.5])] * 3),
    seed=st.integers(0, 1000),
)
def test_light_is_trilinear_in_the_smallest_grids_too(size_m, seed):
    rng = np.random.default_rng(seed)
    vertices = np.array([(0.0, 0.0, 0.0), size_m], dtype=np.float32)
    centers, empty = cell_centers(vertices)
    assert min(empty.cube.shape[:3]) >= 2
    grid = filled(empty, rng.random((*centers.shape[:3], 6)), 1.0)
    for _ in range(10):
        point = rng.uniform(-0.2, 1.2, 3) * size_m
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        light = light_at(grid, tuple(point.astype(np.float32)), tuple(normal.astype(np.float32)))
        assert light == pytest.approx(expected_light(grid, point, normal), abs=2e-3)


@pytest.mark.parametrize("shape", [(1, 1), (1, 4), (8, 4), (5, 3)])
def test_a_packed_texture_repeats_its_first_row_and_column_after_the_last(shape):
    """So that the texel after the last one is the next in memory."""
    image = np.random.default_rng(0).integers(0, 256, (*shape, 3), dtype=np.uint8)
    other = np.zeros((2, 2, 3), dtype=np.uint8)
    pack = pack_textures([mip_pyramid(other), mip_pyramid(image)])
    mips = mip_pyramid(image)
    assert pack.levels[1] == len(mips)
    for level, mip in enumerate(mips):
        width, height = pack.size_px[1, level]
        start = pack.offset[1, level]
        block = pack.texels[start : start + (width + 1) * (height + 1)]
        block = block.reshape(height + 1, width + 1)
        assert (block[:-1, :-1] == mip).all()
        assert (block[-1] == block[0]).all() and (block[:, -1] == block[:, 0]).all()
