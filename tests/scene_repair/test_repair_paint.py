"""Floors painted into holes continue what lies around them; near faces are found at once."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from vlnpe.formats.scene.grid import GridSpec
from vlnpe.scene_repair.floor.patch_region import Rectangles
from vlnpe.scene_repair.paint.inpaint import inpaint

TEXEL_M = 0.01


def planks(rows: int = 240, columns: int = 240) -> np.ndarray:
    """Boards of 12 texels with a dark joint between, in light that falls off to the right."""
    i, j = np.indices((rows, columns))
    value = np.where(i % 12 == 0, 0.3, 0.6) * (1.0 - 0.3 * j / columns)
    return np.repeat(value[..., None], 3, axis=2).astype(np.float32)


def test_pattern_and_light_are_continued() -> None:
    truth = planks()
    hole = np.zeros(truth.shape[:2], dtype=bool)
    hole[90:140, 90:150] = True
    painted = inpaint(truth, ~hole, hole, TEXEL_M)
    assert np.array_equal(painted[~hole], truth[~hole])
    assert np.abs(painted - truth)[hole].mean() < 0.02


def test_a_rug_is_not_copied_under_furniture() -> None:
    picture = planks()
    picture[60:100, 60:100] = (0.9, 0.1, 0.1)
    hole = np.zeros(picture.shape[:2], dtype=bool)
    hole[101:170, 61:160] = True
    painted = inpaint(picture, ~hole, hole, TEXEL_M)
    red = painted[..., 0] - painted[..., 1]
    # It may continue for some centimetres, not further.
    assert red[125:170, 61:160].max() < 0.1


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 60))
def test_tiles_find_what_a_full_search_finds(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    lower = rng.uniform(-5, 5, (count, 2))
    upper = lower + rng.uniform(0, 3, (count, 2)) ** 2
    rectangles = Rectangles.around(np.stack([lower, upper], axis=1))
    for _ in range(5):
        low = rng.uniform(-7, 7, 2)
        columns, rows = rng.integers(1, 9, 2).tolist()
        high = low + 0.5 * np.array([columns, rows])
        expected = np.flatnonzero(np.all((upper >= low) & (lower <= high), axis=1))
        assert (
            rectangles.near(GridSpec(tuple(low), 0.5, rows, columns)).tolist() == expected.tolist()
        )
