"""Flights of stairs are measured, and those that a person could not walk up are named."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.support.scenes import buildings, scans
from tests.support.scenes.repairs import repaired
from vlnpe.formats.core.geometry import triangle_normals
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.pipeline.stages.scenes.outputs import facts_of
from vlnpe.scene_repair.grid.columns import sample_columns
from vlnpe.scene_repair.storeys.flights import Flight, measure_flight
from vlnpe.scene_repair.storeys.levels import ScannedFloor
from vlnpe.scene_repair.storeys.staircases import find_staircases
from vlnpe.scene_repair.storeys.surfaces import find_surfaces
from vlnpe.scene_repair.storeys.treads import ScannedTread

GRID = GridSpec((-4.0, -4.0), 0.025, 320, 320)


def tower(
    riser_m: float, going_m: float, width_m: float, *, treads: int = 8, winding_deg: float = 0.0
) -> list[trimesh.Trimesh]:
    """Floors at 0 and at the top, and a flight between; treads run along x unless they wind."""
    parts = [scans.sheet((-3.5, -3.5), (3.5, -0.05), step=0.5)]
    place = np.eye(4)
    for k in range(treads):
        tread = trimesh.creation.box(bounds=[(0, 0, 0), (going_m, width_m, (k + 1) * riser_m)])
        parts.append(tread.apply_transform(place))
        turn = trimesh.transformations.rotation_matrix(np.radians(winding_deg), (0, 0, 1))
        turn[0, 3] = going_m
        place = place @ turn
    top = (treads + 1) * riser_m
    landing = trimesh.creation.box(bounds=[(0, 0, top - 0.05), (1.5, width_m, top)])
    parts.append(landing.apply_transform(place))
    parts.append(scans.sheet((-1.5, 0.0), (-0.0, width_m), step=0.5))
    return parts


def flights_of(parts: list[trimesh.Trimesh], turn_deg: float, noise_m: float = 0.0) -> list[Flight]:
    """Turn a tower about its origin, scan it with noise in height, and find its flights."""
    mesh = scans.joined(parts)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.radians(turn_deg), (0, 0, 1)))
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64)
    columns = sample_columns(vertices, faces, GRID)
    columns.z[:] += np.random.default_rng(3).normal(0.0, noise_m, len(columns.z))
    normal_z = triangle_normals(vertices[faces])[:, 2]
    surfaces = find_surfaces(columns, normal_z, np.zeros(len(faces), dtype=bool), 0.08)
    floors = []
    for height in (0.0, float(vertices[:, 2].max())):
        z = np.full(GRID.rows * GRID.columns, np.nan)
        near = np.abs(surfaces.z_m - height) < 0.03
        z[surfaces.cell[near]] = surfaces.z_m[near]
        floors.append(ScannedFloor(GRID, z.reshape(GRID.shape), height))
    return [f for staircase in find_staircases(surfaces, floors) for f in staircase.flights]


@pytest.mark.parametrize("turn_deg", [0.0, 31.0, 90.0, 200.0])
@pytest.mark.parametrize(
    ("riser_m", "going_m", "width_m"), [(0.15, 0.3, 1.2), (0.18, 0.26, 0.9), (0.1, 0.35, 1.5)]
)
def test_a_straight_flight_is_measured(
    riser_m: float, going_m: float, width_m: float, turn_deg: float
) -> None:
    (flight,) = flights_of(tower(riser_m, going_m, width_m), turn_deg, noise_m=0.003)
    assert flight.problem == ""
    assert flight.risers_m == pytest.approx(np.full(9, riser_m), abs=0.01)
    assert flight.going_m == pytest.approx(going_m, rel=0.03)
    assert flight.width_m == pytest.approx(width_m, abs=0.06)
    turned = np.radians(turn_deg)
    ahead = np.array([np.cos(turned), np.sin(turned)])
    assert flight.direction_world_deg % 360 == pytest.approx(turn_deg % 360, abs=1.5)
    middle = width_m / 2 * np.array([-ahead[1], ahead[0]])
    assert flight.foot_world_m[:2] == pytest.approx(middle, abs=0.05)
    assert flight.head_world_m[:2] == pytest.approx(middle + 8 * going_m * ahead, abs=0.05)


@pytest.mark.parametrize(
    ("parts", "problem"),
    [
        (tower(0.25, 0.26, 1.0), "is steep: risers up to 25 cm"),
        (tower(0.18, 0.15, 1.0), "is steep: risers up to 18 cm, treads 15 cm"),
        (tower(0.17, 0.26, 0.5), "is 0.5"),
        (tower(0.17, 0.3, 0.8, winding_deg=20.0), "winds by"),
    ],
)
def test_what_a_person_could_not_walk_up_straight_is_named(
    parts: list[trimesh.Trimesh], problem: str
) -> None:
    (flight,) = flights_of(parts, 17.0)
    assert flight.problem.startswith(problem)


def test_furniture_and_floors_without_stairs_make_none() -> None:
    parts = [
        scans.sheet((-3.5, -3.5), (3.5, 3.5)),
        scans.sheet((-3.5, -3.5), (3.5, 3.5), z=2.8),
        *[scans.box((0.3 * k, 0.0, 0.0), (0.3 * k + 0.3, 0.4, 0.2 * (k + 1))) for k in range(6)],
    ]
    assert flights_of(parts, 0.0) == []


def test_the_record_of_a_repair_has_the_flights(tmp_path: Path) -> None:
    bundle = repaired(buildings.two_storeys(), tmp_path)
    log = json.loads((bundle.root / "repair.json").read_text())
    (flight,) = log["flights"]
    assert flight["levels"] == [0, 1]
    assert flight["risers_m"] == pytest.approx([0.25] * 10 + [0.3], abs=0.01)
    assert flight["direction_world_deg"] == pytest.approx(-90.0, abs=1.0)
    assert flight["problem"].startswith("is steep: risers up to 30 cm")
    (text,) = facts_of(log)["stairs"]
    assert text.startswith("level 0 to 1: 1 flight, 11 risers up to 30.")


@pytest.mark.filterwarnings("error")
def test_a_tread_of_which_one_sample_was_scanned_does_not_tell_a_direction() -> None:
    x, y = (
        axis.ravel() for axis in np.meshgrid(np.arange(0.02, 0.28, 0.04), np.arange(0, 1, 0.04))
    )
    treads = []
    for k in range(6):
        points = np.column_stack([x + 0.28 * k, y, np.full(len(x), 0.17 * k)])
        points = points[len(x) // 2 :][:1] if k == 3 else points
        treads.append(ScannedTread(points, points, 0.17 * k, np.inf))
    flight = measure_flight(treads, (0, 1), 0.04)
    assert abs(flight.direction_world_deg) < 3.0 and abs(flight.going_m - 0.28) < 0.02
    assert flight.problem in ("", "is irregular: tread 3 is not where the others put it")
