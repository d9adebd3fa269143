"""Doorways stay open and thin things stay solid, wherever they lie between the voxels."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from trimesh.transformations import rotation_matrix

from tests.support.scenes import scans
from tests.support.scenes.bodies import inside_boxes, level_geoms, touched_on_the_way
from vlnpe.apartments import ApartmentConfig, build_scene
from vlnpe.formats.scene.bundle import SceneBundle, save_bundle
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.scene_repair.collide.level_collision import LevelCollision, build_collision, level_floor
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.floor.repair_level import RepairedFloor
from vlnpe.scene_repair.grid.world_mesh import WorldMesh
from vlnpe.wayfinding.distance import distance_field

pytestmark = pytest.mark.chain

CONFIG = RepairConfig()
SHIFT = st.floats(0.0, 0.05, allow_nan=False)
TURN = st.floats(0.0, 90.0, allow_nan=False)


def placed(
    parts: list[trimesh.Trimesh], dx: float, dy: float, degrees: float
) -> tuple[trimesh.Trimesh, NDArray[np.float64]]:
    """The parts as one mesh, turned and shifted, and the (4, 4) that did it."""
    move = np.asarray(rotation_matrix(np.deg2rad(degrees), (0, 0, 1)))
    move[:2, 3] = dx, dy
    mesh = scans.joined(parts)
    mesh.apply_transform(move)
    return mesh, move


def collision_of(
    mesh: trimesh.Trimesh, move: NDArray[np.float64], size: tuple[float, float]
) -> LevelCollision:
    """Collision over a flat floor of the given size, which the mesh has, too."""
    count = len(mesh.faces)
    world = WorldMesh(
        np.asarray(mesh.vertices, dtype=np.float64),
        np.asarray(mesh.faces, dtype=np.int64),
        np.zeros((count, 3, 2), np.float32),
        np.zeros(count, np.int32),
        np.full(count, -1, np.int32),
    )
    coarse = GridSpec.covering(mesh.bounds[0, :2] - 0.6, mesh.bounds[1, :2] + 0.6, CONFIG.cell_m)
    fine = GridSpec(coarse.origin_xy_m, coarse.cell_m / 2, coarse.rows * 2, coarse.columns * 2)
    xy = fine.center_of(np.moveaxis(np.indices(fine.shape), 0, -1)) - move[:2, 3]
    local = xy @ move[:2, :2]
    inside = np.all((local > 0) & (local < size), axis=-1)
    height = np.where(inside, 0.0, np.nan)
    none = np.empty(0, np.int64)
    floor = RepairedFloor(world, (), (), fine, height, 0.0, inside, none, [], [], 0.0, [])
    return build_collision(world, level_floor(floor, coarse), CONFIG)


def bundle_of(collision: LevelCollision, folder: Path) -> SceneBundle:
    bundle = SceneBundle(folder, "made", {}, np.eye(4), np.eye(4), (), (), (), (0.0,))
    empty = scans.empty_visual()
    save_bundle(bundle, empty, [(collision.floor, collision.obstacles, collision.freemap)])
    return bundle


def at(move: NDArray[np.float64], *points: tuple[float, ...]) -> NDArray[np.float64]:
    padded = np.array([[*p, 0.0][:3] for p in points])
    return padded @ move[:3, :3].T + move[:3, 3]


@settings(max_examples=12, deadline=None)
@given(SHIFT, SHIFT, TURN)
def test_door_of_75_cm_lets_a_body_of_50_cm_pass(dx: float, dy: float, degrees: float) -> None:
    mesh, move = placed(scans.two_rooms(0.75), dx, dy, degrees)
    collision = collision_of(mesh, move, (8.0, 4.0))
    start, end = at(move, (3.0, 2.0), (5.1, 2.0))[:, :2]
    field = distance_field(collision.freemap, start, radius_m=0.25)
    assert field.at(end)[()] == pytest.approx(2.1, abs=0.3)
    with tempfile.TemporaryDirectory() as folder:
        spec = level_geoms(bundle_of(collision, Path(folder)))
    assert touched_on_the_way(spec, start, end, (0.5, 0.5, 1.7)) == []
    # The jambs are where they are: a body wider than the door does not pass.
    assert touched_on_the_way(spec, start, end, (0.5, 0.78, 1.7))


@settings(max_examples=12, deadline=None)
@given(SHIFT, SHIFT, TURN)
def test_gap_of_45_cm_is_not_for_a_body_of_50_cm(dx: float, dy: float, degrees: float) -> None:
    mesh, move = placed(scans.two_rooms(0.45), dx, dy, degrees)
    freemap = collision_of(mesh, move, (8.0, 4.0)).freemap
    start, end = at(move, (1.0, 2.0), (7.0, 2.0))[:, :2]
    assert np.isinf(distance_field(freemap, start, radius_m=0.25).at(end))


@settings(max_examples=30, deadline=None)
@given(SHIFT, SHIFT, TURN, st.floats(0.015, 0.03), TURN)
def test_thin_legs_are_never_lost(
    dx: float, dy: float, degrees: float, side: float, twist: float
) -> None:
    """A free leg of 2 cm: solid from 5 cm over the floor up, and seen by the planner."""
    leg = scans.box((-side / 2, -side / 2, 0.0), (side / 2, side / 2, 0.7))
    leg.apply_transform(rotation_matrix(np.deg2rad(twist), (0, 0, 1)))
    leg.apply_translation((1.0, 1.2, 0.0))
    parts = [scans.sheet((0, 0), (2.5, 2.5), step=0.5), *scans.walls((0, 0), (2.5, 2.5)), leg]
    mesh, move = placed(parts, dx, dy, degrees)
    collision = collision_of(mesh, move, (2.5, 2.5))
    center = at(move, (1.0, 1.2))[0]
    axis: Any = np.column_stack([np.tile(center[:2], (60, 1)), np.linspace(0.05, 0.69, 60)])
    assert inside_boxes(collision.obstacles, axis, 0.013).all()
    assert not collision.freemap.traversable[tuple(collision.freemap.grid.cell_of(center[:2]))]
    # Nothing else grew: a body beside it passes.
    beside = axis + np.array([0.09, 0.0, 0.0])
    assert not inside_boxes(collision.obstacles, beside, 0.0).any()


@settings(max_examples=8, deadline=None)
@given(SHIFT, SHIFT, TURN)
def test_low_bodies_pass_under_tables_that_high_ones_bump_into(
    dx: float, dy: float, degrees: float
) -> None:
    parts = [scans.sheet((0, 0), (4, 4), step=0.5), *scans.walls((0, 0), (4, 4))]
    parts += scans.table(1.5, 1.5)
    mesh, move = placed(parts, dx, dy, degrees)
    collision = collision_of(mesh, move, (4.0, 4.0))
    start, end = at(move, (0.6, 2.0), (3.4, 2.0))[:, :2]
    with tempfile.TemporaryDirectory() as folder:
        spec = level_geoms(bundle_of(collision, Path(folder)))
    assert touched_on_the_way(spec, start, end, (0.6, 0.4, 0.55)) == []
    assert touched_on_the_way(spec, start, end, (0.6, 0.4, 0.75))
    # Between the leg and the wall there is room, over the leg there is none.
    leg = at(move, (1.5, 1.58), (2.5, 1.58))[:, :2]
    assert touched_on_the_way(spec, leg[0], leg[1], (0.1, 0.1, 0.3))


def chair() -> list[trimesh.Trimesh]:
    """A chair of thin frames: legs of 2 cm, a seat, two posts and two slats."""
    legs = [
        scans.box((x, y, 0.0), (x + 0.02, y + 0.02, 0.45)) for x in (0.0, 0.4) for y in (0.0, 0.4)
    ]
    posts = [scans.box((0.0, y, 0.45), (0.02, y + 0.02, 0.9)) for y in (0.0, 0.4)]
    slats = [scans.box((0.0, 0.02, z), (0.015, 0.4, z + 0.04)) for z in (0.6, 0.82)]
    return [scans.box((0.0, 0.0, 0.45), (0.42, 0.42, 0.47)), *legs, *posts, *slats]


@settings(max_examples=8, deadline=None)
@given(SHIFT, SHIFT, TURN)
def test_every_bar_of_a_chair_is_solid(dx: float, dy: float, degrees: float) -> None:
    bars = chair()
    for bar in bars:
        bar.apply_translation((1.1, 1.1, 0.0))
    parts = [scans.sheet((0, 0), (3, 3), step=0.5), *scans.walls((0, 0), (3, 3)), *bars]
    mesh, move = placed(parts, dx, dy, degrees)
    obstacles = collision_of(mesh, move, (3.0, 3.0)).obstacles
    for bar in bars:
        low, high = bar.bounds
        steps = np.linspace(0.02, 0.98, 40)[:, None]
        axis = int(np.argmax(high - low))
        line = np.tile((low + high) / 2, (40, 1))
        line[:, axis] = (low + steps * (high - low))[:, axis]
        line = line[line[:, 2] > 0.05] @ move[:3, :3].T + move[:3, 3]
        assert inside_boxes(obstacles, line, 0.013).all()


@pytest.mark.parametrize(("seed", "degrees"), [(2, 0.0), (5, 31.0)])
def test_every_doorway_of_a_furnished_home_is_passable(
    seed: int, degrees: float, tmp_path: Path
) -> None:
    """All rooms of a home, with furniture and door frames, are joined by doors of 75 cm."""
    config = ApartmentConfig(door_width_m=(0.75, 0.75))
    home = build_scene(np.random.default_rng(seed), config)
    corners = home.shape.corners.reshape(-1, 3)
    shape = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
    mesh, move = placed([shape], 0.017, 0.041, degrees)
    size = tuple(home.plan.bounds()[1])
    collision = collision_of(mesh, move, (size[0], size[1]))
    spec = level_geoms(bundle_of(collision, tmp_path))
    doors = [o for o in home.plan.openings if o.kind == "door" and o.room < o.other_room]
    assert len(doors) >= len(home.plan.rooms) - 1
    for door in doors:
        middle = np.empty(2)
        middle[1 - door.axis] = (door.start_m + door.end_m) / 2
        middle[door.axis] = home.plan.rooms[door.room].wall_at(door.axis, door.sign)
        middle[door.axis] += door.sign * home.plan.wall_m / 2
        reach = np.eye(2)[door.axis] * (home.plan.wall_m / 2 + 0.3)
        ends = at(move, tuple(middle - reach), tuple(middle + reach))[:, :2]
        field = distance_field(collision.freemap, ends[0], radius_m=0.25)
        assert float(field.at(ends[1])) == pytest.approx(2 * np.linalg.norm(reach), abs=0.12), door
        assert touched_on_the_way(spec, ends[0], ends[1], (0.3, 0.5, 1.7)) == [], door
