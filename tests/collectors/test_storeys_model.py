"""One model holds a staircase and both its levels: bodies rest on every tread, and find no gap."""

import itertools
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from tests.support.cart import make_cart
from tests.support.scenes.repairs import repaired_hall
from tests.support.scenes.stair_halls import StairHall
from tests.support.scenes.storeys import FOOT_X, WIDTH_M, write_two_storeys
from vlnpe.collectors.physics import JoinedFloor, build_storeys_model, storeys_model
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.errors import InputError
from vlnpe.formats.scene.bundle import Obstacles, SceneBundle, load_bundle
from vlnpe.formats.scene.sheet import save_sheet

pytestmark = pytest.mark.chain

BALL_M = 0.03
Built = tuple[StairHall, SceneBundle, mujoco.MjModel]


@pytest.fixture(scope="module", params=["straight", "L", "U"])
def built(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Built:
    hall, bundle = repaired_hall(tmp_path_factory, request.param)
    return hall, bundle, build_storeys_model(bundle, 0, get_robot("h1"))


def rest_of(model: mujoco.MjModel, points_m: ArrayLike) -> NDArray[np.float64]:
    """Drop a ball on each point (N, 3) of a model without its robot; return where they rest."""
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.002
    root = model.body("robot/pelvis").id
    for k in np.flatnonzero(model.body_rootid[model.geom_bodyid] != root):
        kind = mujoco.mjtGeom(int(model.geom_type[k]))
        assert kind in (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_BOX)
        spec.worldbody.add_geom(
            type=kind,
            pos=model.geom_pos[k],
            quat=model.geom_quat[k],
            size=np.maximum(model.geom_size[k], 1e-3),
            contype=1,
            conaffinity=0,
        )
    for x, y, z in np.asarray(points_m):
        ball = spec.worldbody.add_body(pos=[x, y, z + BALL_M + 0.02])
        ball.add_freejoint()
        ball.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[BALL_M, 0, 0],
            contype=0,
            conaffinity=1,
            friction=[1.0, 0.1, 0.1],
            condim=6,
        )
    dropped = spec.compile()
    data = mujoco.MjData(dropped)
    mujoco.mj_step(dropped, data, nstep=300)
    return data.qpos.reshape(-1, 7)[:, :3] - (0.0, 0.0, BALL_M)


def spread(low: NDArray[np.float64], high: NDArray[np.float64], edge_m: float) -> list[list[float]]:
    """Nine points (x, y) of a rectangle, the outer ones so far from its edge."""
    x, y = np.linspace(low + edge_m, high - edge_m, 3).T
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2).tolist()


def test_balls_rest_on_every_tread_at_its_height(built: Built) -> None:
    hall, _, model = built
    points = [
        (x, y, z)
        for (low, high), z in zip(hall.treads, hall.top_m, strict=True)
        for x, y in spread(low, high, 0.06)
    ]
    rest = rest_of(model, points)
    assert np.abs(rest - points).max(axis=0) == pytest.approx(0.0, abs=0.01)


def test_floor_and_stairs_join_without_a_gap(built: Built) -> None:
    hall, _, model = built
    ends = []
    for tread, end_m, z in (
        (hall.treads[0], hall.foot_m, 0.0),
        (hall.treads[-1], hall.head_m, hall.rise_m),
    ):
        away = end_m - tread.mean(axis=0)
        away /= np.linalg.norm(away)
        side = np.array([-away[1], away[0]])
        ends += [
            (*(end_m + u * away + v * side), z)
            for u in np.arange(0.04, 0.9, 0.03)
            for v in (-0.45, 0.0, 0.45)
        ]
    assert np.abs(rest_of(model, ends) - ends).max(axis=0) == pytest.approx(0.0, abs=0.01)


def test_both_floors_carry_and_are_open_where_the_stairs_are(built: Built) -> None:
    hall, _, model = built
    corners = [(x, y, z) for x in (0.1, 6.9) for y in (0.1, 6.9) for z in (0.0, hall.rise_m)]
    assert np.abs(rest_of(model, corners) - corners).max() < 0.01
    # Through the opening one falls on the treads: no part of the upper floor is over them.
    over = [(*treads.mean(axis=0), hall.rise_m) for treads in hall.treads[:4]]
    assert rest_of(model, over)[:, 2].max() < hall.rise_m - 0.5


def test_obstacles_leave_the_treads_free_and_stand_beside_them(built: Built) -> None:
    hall, _, model = built
    boxes = np.flatnonzero(model.geom_bodyid == 0)
    low = model.geom_pos[boxes] - model.geom_size[boxes]
    high = model.geom_pos[boxes] + model.geom_size[boxes]
    for (corner, other), z in zip(hall.treads, hall.top_m, strict=True):
        # Beside the handrail; boxes may stand out by 2.5 cm before walls.
        start, end = corner + np.array([0.08, 0.03]), other - 0.03
        start, end = np.append(start, z), np.append(end, z + 1.6)
        over = ((low < end) & (high > start)).all(axis=1)
        assert not over.any(), (low[over], high[over])
    rail = np.array([hall.treads[3].mean(axis=0)[0] - 0.48, *hall.treads[3].mean(axis=0)[1:], 0.0])
    rail[2] = hall.top_m[3] + 0.88
    assert ((low < rail) & (high > rail)).all(axis=1).any()


def test_a_box_over_treads_leaves_no_sliver_beside_them(tmp_path: Path) -> None:
    bundle = write_two_storeys(tmp_path)
    grid = bundle.stair_floor(1).grid
    # Boxes one before the other end on the borders of cells beside the treads.
    ends = grid.origin_xy_m[1] + grid.cell_m * np.arange(grid.rows)
    ends = ends[np.abs(ends - (2.0 + WIDTH_M / 2)) < 0.12]
    x = FOOT_X + 0.1 + 0.1 * np.arange(len(ends))
    boxes = Obstacles(
        np.column_stack([x, ends - 0.2, np.full_like(x, 0.4)]).astype(np.float64),
        np.tile([0.04, 0.2, 0.025], (len(x), 1)),
    )
    save_sheet(bundle.level_folder(0), bundle.floor(0), boxes, bundle.freemap(0))
    model = build_storeys_model(bundle, 1, get_robot("aliengo"))
    size = model.geom_size[model.geom_bodyid == 0]
    assert len(size) and size.min() > 0.001


def test_the_first_riser_as_a_level_rounds_it_leaves_no_edge_before_it(tmp_path: Path) -> None:
    bundle = write_two_storeys(tmp_path, cell_m=0.025)
    riser = Obstacles(np.array([[FOOT_X - 0.025, 2.0, 0.125]]), np.array([[0.022, 0.4, 0.075]]))
    save_sheet(bundle.level_folder(0), bundle.floor(0), riser, bundle.freemap(0))
    model = build_storeys_model(bundle, 1, get_robot("aliengo"))
    boxes = model.geom_bodyid == 0
    gap = np.abs(model.geom_pos[boxes] - riser.center_m[0]) - model.geom_size[boxes]
    assert np.count_nonzero(boxes) and (gap.max(axis=1) > 0.0).all()


def test_the_joined_floor_chooses_its_sheet_by_height(built: Built) -> None:
    hall, bundle, _ = built
    floor = JoinedFloor.of(bundle, 0)
    middle = hall.treads.mean(axis=1)
    assert floor.height_at(middle, hall.top_m) == pytest.approx(hall.top_m, abs=0.01)
    assert floor.height_at(middle, hall.top_m + 0.4) == pytest.approx(hall.top_m, abs=0.01)
    edges = hall.treads[2, 0] + ((0.5, 0.015), (0.5, -0.015))
    assert floor.height_at(edges, hall.top_m[2]) == pytest.approx(hall.top_m[[2, 1]], abs=0.01)
    assert all(floor.is_solid(x, y, z) for (x, y), z in zip(middle, hall.top_m, strict=True))
    corner = (6.5, 0.5)
    assert floor.height_at(corner, 0.3) == pytest.approx(0.0, abs=0.005)
    assert floor.height_at(corner, hall.rise_m) == pytest.approx(hall.rise_m, abs=0.005)
    assert floor.is_solid(*corner, 0.1) and floor.is_solid(*corner, hall.rise_m)
    # Over the first tread there is no upper floor, and outside the building none at all.
    assert not floor.is_solid(middle[0, 0], middle[0, 1], hall.rise_m)
    assert not floor.is_solid(*corner, hall.rise_m / 2) and not floor.is_solid(9.0, 9.0, 0.0)


def test_models_are_kept_until_the_staircase_changes(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    shared = repaired_hall(tmp_path_factory, "straight")[1].root
    bundle = load_bundle(shutil.copytree(shared, tmp_path / "bundle"))
    cache = tmp_path / "cache"
    cache.mkdir()
    first = storeys_model(bundle, 0, make_cart(), cache_dir=cache)
    again = storeys_model(bundle, 0, make_cart(), cache_dir=cache)
    assert len(list(cache.glob("*.mjb"))) == 1 and first.ngeom == again.ngeom
    treads = bundle.stair_treads(0)
    path = bundle.stair_folder(0) / "treads.npz"
    np.savez(path, **{**vars(treads), "half_m": treads.half_m * (1.0, 0.9, 1.0)})
    storeys_model(bundle, 0, make_cart(), cache_dir=cache)
    assert len(list(cache.glob("*.mjb"))) == 2
    for wrong, folder in itertools.product((1, -1), (cache, None)):
        with pytest.raises(InputError, match=f"staircase {wrong} of .*; valid: 0 … 0"):
            storeys_model(bundle, wrong, make_cart(), cache_dir=folder)
