"""Storeys, steps, ramps and sunken areas are distinguished from furniture, roofs and holes."""

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.support.scenes import buildings, scans
from tests.support.scenes.repairs import repaired
from vlnpe.formats.core.geometry import triangle_normals
from vlnpe.formats.scene.bundle import Floor, SceneBundle
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.grid.columns import sample_columns
from vlnpe.scene_repair.verify.exported import Surface
from vlnpe.scene_repair.verify.scene import _balls_lost

pytestmark = pytest.mark.chain

QUICK = RepairConfig(picture_px=200)


# Building, floor heights of its levels, and floor area of each.
BUILDINGS = {
    "two storeys": (buildings.two_storeys(), (0.0, 2.8), (20.0, 17.5)),
    "no roof": (buildings.two_storeys(roof=False), (0.0, 2.8), (20.0, 17.5)),
    "split level": (buildings.split_level(0.4), (0.0,), (28.0,)),
    "ramp": (buildings.ramp(), (0.125,), (27.0,)),
    "sunken": (buildings.sunken(0.3), (0.0,), (30.0,)),
    "slightly sunken": (buildings.sunken(0.15), (0.0,), (30.0,)),
    "mezzanine": (buildings.mezzanine(), (0.0, 2.5), (24.0, 8.0)),
    "furniture": (buildings.furnished(), (0.0,), (30.0,)),
    "gable roof": (buildings.under_a_roof(30), (0.0,), (48.0,)),
    "flat gable roof": (buildings.under_a_roof(14), (0.0,), (48.0,)),
    "shed roof": (buildings.under_a_roof(10, shed=True), (0.0,), (48.0,)),
    "ceiling in the floor's plane": (buildings.in_one_plane(), (0.0, 2.8), (20.0, 17.5)),
    "ceiling just under the floor": (buildings.in_one_plane(0.01), (0.0, 2.8), (20.0, 17.5)),
    "ceiling 2 mm above the floor": (buildings.in_one_plane(-0.002), (0.0, 2.8), (20.0, 17.5)),
    "ceiling 5 mm above the floor": (buildings.in_one_plane(-0.005), (0.0, 2.8), (20.0, 17.5)),
    "ceiling 1 mm under the floor": (buildings.in_one_plane(0.001, 3.4), (0.0, 3.4), (20.0, 17.5)),
    "three storeys, ceilings in the floors' planes": (
        buildings.tower_in_one_plane(),
        (0.0, 2.8, 5.6),
        (20.0, 17.5, 17.5),
    ),
    "lift shaft": (buildings.lift_shaft(), (0.0,), (27.44,)),
}


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], SceneBundle]:
    """Return what repairs a building of the table once."""

    @cache
    def build(name: str) -> SceneBundle:
        return repaired(BUILDINGS[name][0], tmp_path_factory.mktemp("building"))

    return build


@pytest.mark.parametrize("name", BUILDINGS)
def test_levels_and_their_floor(name: str, building: Callable[[str], SceneBundle]) -> None:
    _, heights, areas = BUILDINGS[name]
    bundle = building(name)
    assert bundle.level_floor_z_m == pytest.approx(heights, abs=0.01)
    levels = json.loads((bundle.root / "repair.json").read_text())["levels"]
    for level, area in zip(levels, areas, strict=True):
        assert level["floor_area_before_m2"] == pytest.approx(area, rel=0.01)
        # Nothing is missing in these buildings, so nothing may be added.
        assert level["patched_area_m2"] < 0.01
        assert level["bumps"] == []


@pytest.mark.parametrize("name", [n for n in BUILDINGS if n.startswith("ceiling")])
def test_the_upper_floor_is_seen_from_above_and_not_the_ceiling_in_its_plane(
    name: str, building: Callable[[str], SceneBundle]
) -> None:
    bundle = building(name)
    visual, upper = bundle.visual(), bundle.floor(1)
    corners = visual.vertices[visual.faces].astype(np.float64)
    columns = sample_columns(
        visual.vertices.astype(np.float64), visual.faces.astype(np.int64), upper.grid
    )
    normal_z = triangle_normals(corners)[:, 2]
    floor_z = upper.height_m.ravel()[columns.cell]
    here = upper.covered.ravel()[columns.cell] & (np.abs(columns.z - floor_z) < 0.05)
    top = np.full(upper.grid.rows * upper.grid.columns, -np.inf)
    ceiling = top.copy()
    up = normal_z[columns.face] > 0
    np.maximum.at(top, columns.cell[here & up], columns.z[here & up])
    np.maximum.at(ceiling, columns.cell[here & ~up], columns.z[here & ~up])
    seen = np.isfinite(top)
    assert seen.sum() * upper.grid.cell_m**2 > 17.0
    assert (top[seen] - ceiling[seen]).min() > 0.004


@pytest.mark.parametrize(
    ("name", "heights"),
    [("split level", (0.0, 0.4)), ("sunken", (-0.3, 0.0)), ("slightly sunken", (-0.15, 0.0))],
)
def test_steps_stay_sharp(
    name: str, heights: tuple[float, float], building: Callable[[str], SceneBundle]
) -> None:
    floor = building(name).floor(0)
    apart = np.abs(floor.height_m[floor.covered][:, None] - np.array(heights)).min(axis=1)
    assert apart.max() < 0.002


def test_a_turned_stairwell_stays_open_under_a_ceiling_in_its_plane(tmp_path: Path) -> None:
    bundle = repaired(buildings.in_one_plane(0.001, 3.4, 33.0), tmp_path)
    assert bundle.level_floor_z_m == pytest.approx((0.0, 3.4), abs=0.01)
    turn = np.deg2rad(33.0)
    x, y = 1.5, 2.25  # the middle of the stairwell, unturned
    middle = (x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn))
    upper = bundle.floor(1)
    assert not upper.covered[tuple(upper.grid.cell_of(np.array(middle)))]
    assert float(upper.covered.sum()) * upper.grid.cell_m**2 == pytest.approx(18.5, abs=1.5)


def test_a_ball_that_rolls_off_a_step_has_not_fallen_through() -> None:
    """Where a step's edge crosses a cell of the floor, as in a building that is turned."""
    grid = GridSpec((0.0, 0.0), 0.05, 20, 20)
    height = np.zeros(grid.shape, np.float32)
    height[:, :10] = 0.09
    height[:, 10] = 0.06  # the cell that the edge crosses, at x 0.51
    high = [[(0, 0, 0.09), (0.51, 0, 0.09), (0.51, 1, 0.09)]]
    high += [[(0, 0, 0.09), (0.51, 1, 0.09), (0, 1, 0.09)]]
    low = [[(0.51, 0, 0), (1, 0, 0), (1, 1, 0)], [(0.51, 0, 0), (1, 1, 0), (0.51, 1, 0)]]
    triangles = np.array(high + low, np.float32)
    start = np.array([[0.525, 0.1 * k + 0.025, 0.06] for k in range(1, 9)])
    floor = Floor(grid, height, np.ones(grid.shape, bool))
    whole = Surface(triangles, np.zeros(4, dtype=bool))
    assert len(_balls_lost(whole, start, floor)) == 0
    without = Surface(triangles[:2], np.zeros(2, dtype=bool))
    assert len(_balls_lost(without, start, floor)) == len(start)


def test_hole_in_a_ramp_is_filled_in_its_slope(tmp_path: Path) -> None:
    hole = scans.disc(4.5, 1.5, 0.6)
    bundle = repaired(buildings.ramp(without=hole), tmp_path)
    floor = bundle.floor(0)
    i, j = np.indices(floor.grid.shape)
    xy = floor.grid.center_of(np.stack([i, j], axis=-1))
    inside = hole(xy.reshape(-1, 2)).reshape(floor.grid.shape)
    assert floor.covered[inside].all()
    assert floor.height_m[inside] == pytest.approx((xy[inside][:, 0] - 3.0) / 12, abs=0.003)


def test_hole_in_a_sunken_area_is_filled_at_its_depth(tmp_path: Path) -> None:
    hole = scans.rectangle((2.0, 2.0), (3.0, 3.0))
    bundle = repaired(buildings.sunken(0.3, hole), tmp_path)
    floor = bundle.floor(0)
    i, j = np.indices(floor.grid.shape)
    xy = floor.grid.center_of(np.stack([i, j], axis=-1))
    inside = hole(xy.reshape(-1, 2)).reshape(floor.grid.shape)
    assert floor.covered[inside].all()
    assert floor.height_m[inside] == pytest.approx(-0.3, abs=0.005)
