"""The compiled level model: floor, obstacles, robot, cache."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.cart import CartGait, make_cart
from tests.support.scenes.rooms import write_two_rooms
from vlnpe.collectors.controllers import Pose
from vlnpe.collectors.physics import (
    FloorSurface,
    LevelModelConfig,
    build_level_model,
    level_model,
    robot_obstacles,
)
from vlnpe.collectors.physics.model_cache import model_bytes
from vlnpe.collectors.replay.world import World, open_world
from vlnpe.collectors.robots import ROBOTS, RobotSpec
from vlnpe.formats.scene.bundle import Floor, Obstacles, SceneBundle, load_bundle, save_bundle

ROBOT_CASES = [make_cart(), *ROBOTS.values()]


class Limp:
    """A gait that keeps every servo where it spawned."""

    def __init__(self, robot: RobotSpec) -> None:
        self._target = robot.default_joint_rad
        self.memory = ()

    def reset(self, seed: int | None = None) -> None: ...

    def act(self, data: mujoco.MjData, command: object) -> np.ndarray:
        return self._target


def with_floor(root: Path, change) -> SceneBundle:
    """The two rooms with another floor."""
    bundle = write_two_rooms(root)
    floor = bundle.floor(0)
    rows, columns = np.indices(floor.grid.shape)
    xy = floor.grid.center_of(np.stack([rows, columns], -1))
    height, covered = change(xy[..., 0], xy[..., 1], floor.covered)
    floor = Floor(floor.grid, height.astype(np.float32), covered)
    save_bundle(bundle, bundle.visual(), [(floor, bundle.obstacles(0), bundle.freemap(0))])
    return load_bundle(root)


def slope(x: np.ndarray, y: np.ndarray, covered: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return 0.05 * x + 0.02 * y, covered


def rest(world: World, pose: Pose, seconds: float = 1.0) -> None:
    world.spawn(pose)
    for _ in range(round(seconds / 0.02)):
        world.data.ctrl[world.handles.actuators] = world.gait.act(world.data, (0, 0, 0))
        mujoco.mj_step(world.model, world.data, nstep=4)


@pytest.mark.parametrize("robot", ROBOT_CASES, ids=lambda r: r.name)
def test_nothing_but_servos_can_move_the_robot(two_rooms: SceneBundle, robot: RobotSpec) -> None:
    model = build_level_model(two_rooms, 0, robot)
    assert model.neq == 0
    assert model.nmocap == 0
    assert model.ntendon == 0
    assert model.nu == len(robot.joints)
    assert (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT).all()
    driven = {int(j) for j in model.actuator_trnid[:, 0]}
    assert all(model.jnt_type[j] != mujoco.mjtJoint.mjJNT_FREE for j in driven)
    assert model.body_gravcomp.max() == 0.0
    assert model.opt.timestep == 0.005


def test_a_flat_floor_is_a_plane(two_rooms: SceneBundle) -> None:
    model = build_level_model(two_rooms, 0, make_cart())
    assert model.geom("floor").type == mujoco.mjtGeom.mjGEOM_PLANE


@pytest.mark.parametrize("at", [(1.0, 1.0), (3.0, 3.3), (6.5, 2.0)])
def test_a_sloping_floor_carries_the_robot_at_its_height(tmp_path: Path, at) -> None:
    bundle = with_floor(tmp_path, slope)
    world = open_world(bundle, 0, make_cart(), CartGait())
    assert world.model.geom("floor").type == mujoco.mjtGeom.mjGEOM_HFIELD
    rest(world, Pose(at[0], at[1], 0.3), 0.3)
    x, y, z = world.data.qpos[world.handles.root_qpos :][:3]
    assert z == pytest.approx(0.05 * x + 0.02 * y + 0.1, abs=0.006)


def test_rays_meet_the_height_field_where_the_record_says(tmp_path: Path) -> None:
    def bumps(x, y, covered):
        return 0.03 * np.sin(2 * x) * np.cos(3 * y), covered

    bundle = with_floor(tmp_path, bumps)
    model = build_level_model(bundle, 0, make_cart())
    data = mujoco.MjData(model)
    data.qpos[0] = 50.0  # out of the way
    mujoco.mj_forward(model, data)
    surface = FloorSurface(bundle.floor(0))
    for x, y in [(0.4, 0.6), (2.33, 1.91), (5.02, 2.2), (7.5, 3.5)]:
        distance = mujoco.mj_ray(
            model,
            data,
            np.array([x, y, 3.0]),
            np.array([0.0, 0, -1]),
            None,
            1,
            -1,
            np.zeros(1, np.int32),
            None,
        )
        assert 3.0 - distance == pytest.approx(float(surface.height_at((x, y))), abs=2e-3)


def test_the_floor_ends_outside_the_building(tmp_path: Path) -> None:
    def half(x, y, covered):
        return 0.01 * x, covered & (x < 6)

    bundle = with_floor(tmp_path, half)
    surface = FloorSurface(bundle.floor(0))
    assert surface.is_solid(5.0, 2.0)
    assert surface.is_solid(6.2, 2.0)  # the skirt
    assert not surface.is_solid(6.6, 2.0)
    assert not surface.is_solid(-99.0, 2.0)
    world = open_world(bundle, 0, make_cart(), CartGait())
    rest(world, Pose(7.5, 2.0, 0.0))
    assert world.data.qpos[world.handles.root_qpos + 2] < -0.3


@pytest.mark.parametrize("robot", ROBOT_CASES, ids=lambda r: r.name)
def test_a_spawned_robot_stands_on_the_floor(tmp_path: Path, robot: RobotSpec) -> None:
    world = open_world(with_floor(tmp_path, slope), 0, robot, Limp(robot))
    world.spawn(Pose(2.0, 1.5, 0.7))
    feet = world.data.geom_xpos[world.handles.sole_geoms.ravel()]
    low = feet[:, 2] - world.model.geom_rbound[world.handles.sole_geoms.ravel()]
    gap = low - world.surface.height_at(feet[:, :2])
    assert 0.0 < gap.min() < 0.02
    assert not world.in_collision()
    assert world.pose.yaw_rad == pytest.approx(0.7)
    assert np.abs(world.data.qvel).max() == 0.0


@pytest.mark.parametrize("robot", ROBOT_CASES, ids=lambda r: r.name)
def test_a_robot_inside_furniture_is_in_collision(two_rooms: SceneBundle, robot) -> None:
    world = open_world(two_rooms, 0, robot, Limp(robot))
    world.spawn(Pose(7.0, 0.6, 0.0))  # in the sofa
    assert world.in_collision()


def touching_pairs(model: mujoco.MjModel) -> dict[tuple[str, str], bool]:
    """Which named geoms of bodies other than the world may touch each other, by their masks."""
    geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] and model.geom(g).name]
    own, other = model.geom_contype, model.geom_conaffinity
    names = [model.geom(g).name.removeprefix("robot/") for g in geoms]
    return {
        (a, b): bool((own[g] & other[h]) | (own[h] & other[g]))
        for g, a in zip(geoms, names, strict=True)
        for h, b in zip(geoms, names, strict=True)
        if "floor" not in (a, b)
    }


def test_parts_that_spare_each_other_do_so_in_a_scene_as_well(two_rooms: SceneBundle) -> None:
    cart = make_cart()

    def build(robot: RobotSpec) -> mujoco.MjSpec:
        spec = cart.build(robot)
        for geom in spec.geoms:
            geom.conaffinity = 0  # touches the floor, and nothing of its own
        return spec

    robot = replace(cart, build=build)
    alone = touching_pairs(robot.build_model(floor=False))
    assert alone == touching_pairs(build_level_model(two_rooms, 0, robot))
    assert not any(alone.values())
    assert any(touching_pairs(cart.build_model(floor=False)).values())
    world = open_world(two_rooms, 0, robot, Limp(robot))
    world.spawn(Pose(7.0, 0.6, 0.0))  # in the sofa
    assert world.in_collision()


def test_the_cache_gives_the_same_model(two_rooms: SceneBundle, tmp_path: Path) -> None:
    robot = make_cart()
    built = level_model(two_rooms, 0, robot, cache_dir=tmp_path)
    (file,) = tmp_path.glob("*.mjb")
    opened = mujoco.MjModel.from_binary_path(str(file))
    assert model_bytes(opened) == model_bytes(built) == file.read_bytes()
    cached = level_model(two_rooms, 0, robot, cache_dir=tmp_path)
    for name in ("geom_pos", "geom_size", "body_mass", "jnt_range", "geom_contype"):
        assert np.array_equal(getattr(built, name), getattr(cached, name))
    heavier = replace(make_cart(mast_kg=3.0))
    level_model(two_rooms, 0, heavier, cache_dir=tmp_path)
    assert len(list(tmp_path.glob("*.mjb"))) == 2


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "digest"])
def test_a_damaged_cache_is_rebuilt(
    two_rooms: SceneBundle, tmp_path: Path, damage: str, caplog: pytest.LogCaptureFixture
) -> None:
    robot = make_cart()
    built = level_model(two_rooms, 0, robot, cache_dir=tmp_path)
    (path,) = tmp_path.glob("*.mjb")
    good = path.read_bytes()
    bad = bytearray(good)
    bad[len(bad) // 2] ^= 0x10
    damaged = {"cut": good[: len(good) // 3], "flipped": bytes(bad), "empty": b"", "digest": good}
    path.write_bytes(damaged[damage])
    if damage == "digest":
        path.with_name(f"{path.name}.sha256").unlink()
    again = level_model(two_rooms, 0, robot, cache_dir=tmp_path)
    assert model_bytes(again) == model_bytes(built)
    assert path.read_bytes() == good
    assert "damaged" in caplog.text


@pytest.mark.parametrize("change", ["obstacles", "robot", "config", "scene"])
def test_every_setting_that_shapes_the_model_has_its_own_cache(tmp_path: Path, change: str) -> None:
    bundle, robot, config = write_two_rooms(tmp_path / "a"), make_cart(), LevelModelConfig()
    cache = tmp_path / "cache"
    level_model(bundle, 0, robot, config, cache)
    match change:
        case "obstacles":
            boxes = bundle.obstacles(0)
            moved = Obstacles(boxes.center_m + 0.1, boxes.half_m)
            save_bundle(bundle, bundle.visual(), [(bundle.floor(0), moved, bundle.freemap(0))])
        case "robot":  # a sensor more: nothing that shapes its motion
            robot = replace(robot, build=lambda r: with_clock(make_cart().build(r)))
        case "config":
            config = replace(config, friction=0.5)
        case "scene":
            bundle = replace(bundle, scene_id="other")
    changed = level_model(bundle, 0, robot, config, cache)
    assert model_bytes(changed) == model_bytes(build_level_model(bundle, 0, robot, config))
    assert len(list(cache.glob("*.mjb"))) == 2


def with_clock(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    spec.add_sensor(name="clock", type=mujoco.mjtSensor.mjSENS_CLOCK)
    return spec


def test_a_missing_level_says_which_are_there(two_rooms: SceneBundle) -> None:
    with pytest.raises(ValueError, match=r"level 3 .* 0 … 0"):
        build_level_model(two_rooms, 3, make_cart())


def inside(points: np.ndarray, boxes: Obstacles) -> np.ndarray:
    gap = np.abs(points[:, None] - boxes.center_m) - boxes.half_m
    return np.any(np.all(gap < 0, axis=-1), axis=-1)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_merged_boxes_fill_the_same_space(two_rooms: SceneBundle, seed: int) -> None:
    """Random voxels: what is solid stays solid, what is free stays free, below the cut."""
    rng = np.random.default_rng(seed)
    cells = np.unique(rng.integers(0, 6, (60, 3)), axis=0).astype(np.float64)
    boxes = Obstacles(1.0 + 0.1 * (cells + 0.5), np.full(cells.shape, 0.05))
    merged = robot_obstacles(boxes, two_rooms.freemap(0), reach_m=0.5, top_m=1.43)
    assert len(merged.center_m) < len(cells)
    points = rng.uniform((0.95, 0.95, 0.95), (1.65, 1.65, 1.429), (400, 3))
    assert np.array_equal(inside(points, merged), inside(points, boxes))
    assert (merged.center_m + merged.half_m)[:, 2].max() <= 1.43 + 1e-9


def test_boxes_out_of_reach_are_left_out(two_rooms: SceneBundle) -> None:
    center = np.array([[2.0, 2.0, 0.2], [2.0, 2.0, 2.2], [-0.4, 2.0, 0.2], [30.0, 2.0, 0.2]])
    boxes = Obstacles(center, np.full((4, 3), 0.1))
    near = robot_obstacles(boxes, two_rooms.freemap(0), reach_m=0.5, top_m=1.0)
    assert sorted(near.center_m[:, 0].round(3)) == [-0.4, 2.0]


def test_a_smooth_floor_gets_larger_triangles_at_the_same_height(tmp_path: Path) -> None:
    def gentle(x, y, covered):
        return 0.004 * np.sin(1.5 * x) + 0.003 * np.cos(1.2 * y), covered & (x < 6)

    bundle = with_floor(tmp_path, gentle)
    model = build_level_model(bundle, 0, make_cart())
    grid = bundle.floor(0).grid
    assert model.hfield_nrow[0] < 0.5 * grid.rows
    data = mujoco.MjData(model)
    data.qpos[0] = 50.0
    mujoco.mj_forward(model, data)
    surface = FloorSurface(bundle.floor(0))
    down, hit = np.array([0.0, 0, -1]), np.zeros(1, np.int32)
    for x, y in np.random.default_rng(0).uniform((0.1, 0.1), (5.9, 3.9), (200, 2)):
        high = np.array([x, y, 0.05])
        distance = mujoco.mj_ray(model, data, high, down, None, 1, -1, hit, None)
        if hit[0] == model.geom("floor").id:
            assert 0.05 - distance == pytest.approx(float(surface.height_at((x, y))), abs=1.5e-3)
