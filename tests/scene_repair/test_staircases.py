"""Flights and landings make staircases with a sheet each, unless nobody could climb them."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.support.scenes import scans
from tests.support.scenes.repairs import repaired, repaired_hall
from tests.support.scenes.stair_halls import StairHall, stair_hall
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.scene_repair.storeys.levels import ScannedFloor
from vlnpe.scene_repair.storeys.surfaces import Surfaces
from vlnpe.scene_repair.storeys.treads import ways_up
from vlnpe.wayfinding.distance import distance_field

pytestmark = pytest.mark.chain


@pytest.fixture(
    scope="module", params=[["straight"], ["L"], ["U"], ["L", 0.18, 0.26, 0.95]], ids=str
)
def hall(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[StairHall, SceneBundle]:
    return repaired_hall(tmp_path_factory, *request.param)


def test_a_staircase_is_recorded_with_its_middle_line(
    hall: tuple[StairHall, SceneBundle],
) -> None:
    truth, bundle = hall
    (staircase,) = bundle.staircases
    assert staircase.problem == "" and staircase.levels == (0, 1)
    assert staircase.riser_m == pytest.approx(truth.top_m[0], abs=0.005)
    assert staircase.going_m == pytest.approx(np.ptp(truth.treads[0, :, 1]), abs=0.005)
    line = staircase.line_world_m
    assert line[1] == pytest.approx([*truth.foot_m, 0.0], abs=0.04)
    assert line[-2] == pytest.approx([*truth.head_m, truth.rise_m], abs=0.04)
    assert line[0, 2] == pytest.approx(0.0, abs=0.01)
    assert line[-1, 2] == pytest.approx(truth.rise_m, abs=0.01)
    # Every piece of it leads up, or over the landing.
    assert (np.diff(line[:, 2]) > -0.01).all()
    if truth.landing >= 0:
        low, high = truth.treads[truth.landing]
        corners = line[3:-3, :2]
        assert len(corners) and ((corners > low) & (corners < high)).all()
    record = json.loads((bundle.root / "repair.json").read_text())
    assert [s["risers"] for s in record["staircases"]] == [16] and record["doubts"] == []


def test_the_floor_of_a_staircase_is_its_treads_and_aprons(
    hall: tuple[StairHall, SceneBundle],
) -> None:
    truth, bundle = hall
    floor, freemap = bundle.stair_floor(0), bundle.stair_freemap(0)
    assert floor.grid.cell_m <= 0.025 and freemap.grid == floor.grid
    for (low, high), z in zip(truth.treads, truth.top_m, strict=True):
        x, y = np.linspace(low + 0.02, high - 0.02, 20).T
        places = np.stack(np.meshgrid(x, y), axis=-1)
        cells = tuple(np.moveaxis(floor.grid.cell_of(places), -1, 0))
        assert floor.covered[cells].all()
        assert np.abs(floor.height_m[cells] - z).max() < 0.01
    line = bundle.staircases[0].line_world_m
    for k, level in ((0, 0), (-1, 1)):
        row, column = floor.grid.cell_of(line[k, :2])
        other = bundle.freemap(level)
        there = tuple(other.grid.cell_of(line[k, :2]))
        assert freemap.traversable[row, column] and other.traversable[there]
        assert floor.height_m[row, column] == pytest.approx(other.floor_z_m[there], abs=0.005)


def test_one_walks_from_floor_to_floor_over_the_treads_alone(
    hall: tuple[StairHall, SceneBundle],
) -> None:
    _, bundle = hall
    freemap, line = bundle.stair_freemap(0), bundle.staircases[0].line_world_m
    field = distance_field(freemap, line[0, :2], 0.3)
    row, column = freemap.grid.cell_of(line[-1, :2])
    walked = np.linalg.norm(np.diff(line[:, :2], axis=0), axis=1).sum()
    assert 0.75 * walked < field.distance_m[row, column] < 1.02 * walked
    # Neighbouring cells are a step apart at most, also where one flight passes beside another.
    z = np.where(freemap.traversable, freemap.floor_z_m, np.nan)
    for axis in (0, 1):
        assert np.nanmax(np.abs(np.diff(z, axis=axis))) < 0.31


def test_a_rounded_edge_between_floor_and_stairs_is_no_step() -> None:
    # A level strip, 3 cm of its rounded edge, treads, their rounded edge, and a strip above.
    grid = GridSpec((0.0, 0.0), 0.025, 20, 72)
    ends = np.cumsum([20, 1, 10, 10, 10, 1])
    tops = np.array([0.0, 0.02, 0.17, 0.34, 0.51, 0.66, 0.68])
    z = np.tile(tops[np.digitize(np.arange(72), ends)], (20, 1))
    floors = [ScannedFloor(grid, np.where(z == tops[k], z, np.nan), tops[k]) for k in (0, -1)]
    cells = np.arange(z.size)
    same = np.zeros(z.size, dtype=np.int64)
    surfaces = Surfaces(cells, z.ravel(), same.astype(np.int32), np.full(z.size, np.inf), same, 1)
    (treads,) = ways_up(surfaces, *floors)
    assert [t.z_m for t in treads] == pytest.approx([0.0, 0.17, 0.34, 0.51, 0.68])


def test_a_blocked_staircase_has_no_sheet_and_is_named(tmp_path: Path) -> None:
    hall = stair_hall("straight")
    low, high = hall.treads[6]
    cupboard = scans.box((low[0], low[1] + 0.05, 1.15), (high[0], high[1] - 0.05, 2.9))
    bundle = repaired([*hall.parts, cupboard], tmp_path)
    (staircase,) = bundle.staircases
    assert staircase.problem.startswith(("is blocked", "has "))
    assert not (bundle.root / "stairs").exists()
    with pytest.raises(ValueError, match="staircase 0"):
        bundle.stair_floor(0)
    (doubt,) = json.loads((bundle.root / "repair.json").read_text())["doubts"]
    assert doubt.startswith("staircase 0 from level 0 to 1 ") and staircase.problem in doubt
