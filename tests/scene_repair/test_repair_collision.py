"""What a robot can touch is an obstacle, what it can walk on is not, and doorways stay open."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.scenes import scans
from tests.support.scenes.bodies import inside_boxes
from tests.support.scenes.repairs import repaired
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.scene_repair.collide.boxes import MAY, MUST, NEVER, cover_with_boxes
from vlnpe.scene_repair.collide.voxels import STEPS, Voxels, voxelise
from vlnpe.wayfinding.distance import distance_field

pytestmark = pytest.mark.chain


@pytest.fixture(scope="module")
def furnished(tmp_path_factory: pytest.TempPathFactory) -> SceneBundle:
    """A room with a table, a rug, a threshold, a hanging lamp, a high shelf and a rotated crate."""
    crate = trimesh.creation.box(extents=(0.5, 0.5, 0.4))
    crate.apply_transform(trimesh.transformations.rotation_matrix(0.5, (0, 0, 1)))
    crate.apply_translation((4.2, 3.2, 0.2))
    more = [
        *scans.table(1.0, 1.0),
        scans.box((2.5, 0.5, 0.0), (4.0, 1.5, 0.02)),
        scans.box((3.0, 2.4, 1.5), (3.2, 2.6, 2.6)),
        scans.box((0.0, 3.7, 2.1), (2.0, 4.0, 2.4)),
        crate,
    ]
    return repaired(scans.room(more=more), tmp_path_factory.mktemp("furnished"))


@pytest.mark.parametrize(
    ("what", "xy", "free"),
    [
        ("open floor", (4.5, 0.5), True),
        ("rug of 2 cm", (3.2, 1.0), True),
        ("under a table of 0.75 m", (1.5, 1.5), False),
        ("thin table leg", (1.07, 1.07), False),
        ("under a lamp at 1.5 m", (3.1, 2.5), False),
        ("under a shelf at 2.1 m", (1.0, 3.85), True),
        ("in a wall", (-0.05, 2.0), False),
        ("outside", (5.4, 2.0), False),
    ],
)
def test_the_freemap_marks_where_to_walk(
    furnished: SceneBundle, what: str, xy: tuple[float, float], free: bool
) -> None:
    freemap = furnished.freemap(0)
    assert freemap.traversable[tuple(freemap.grid.cell_of(xy))] == free, what


def test_boxes_hold_all_surfaces_within_reach(furnished: SceneBundle) -> None:
    visual = furnished.visual()
    mesh = trimesh.Trimesh(visual.vertices, visual.faces, process=False)
    rng = np.random.default_rng(0)
    weights = mesh.area_faces / mesh.area_faces.sum()
    face = rng.choice(len(weights), 60_000, p=weights)
    corner = np.sort(rng.random((len(face), 2)), axis=1)
    bary = np.stack([corner[:, 0], corner[:, 1] - corner[:, 0], 1 - corner[:, 1]], axis=1)
    points = np.einsum("nk,nkd->nd", bary, np.asarray(mesh.triangles)[face])
    reach = (points[:, 2] > 0.04) & (points[:, 2] < 1.95)
    # The outsides of the walls and the top of the shelf are out of reach.
    reach &= np.all((points[:, :2] > -0.001) & (points[:, :2] < (5.001, 4.001)), axis=1)
    held = inside_boxes(furnished.obstacles(0), points[reach], 0.013)
    assert held.mean() > 0.999


def test_boxes_stand_out_by_half_a_voxel_at_most(furnished: SceneBundle) -> None:
    visual = furnished.visual()
    mesh = trimesh.Trimesh(visual.vertices, visual.faces, process=False)
    rng = np.random.default_rng(1)
    points = rng.random((4000, 3)) * (4.98, 3.98, 1.4) + (0.01, 0.01, 0.1)
    bodies = [b for b in mesh.split(only_watertight=True) if b.is_volume]
    inside = np.zeros(len(points), dtype=bool)
    for body in bodies:
        low, high = body.bounds
        near = np.all((points > low - 0.045) & (points < high + 0.045), axis=1)
        inside |= near
    boxed = inside_boxes(furnished.obstacles(0), points)
    # Axis-aligned things: nothing stands out by more than the half voxel (plus the crate's
    # bounding box, which is why only points far from all things are asked).
    assert not boxed[~inside].any()


@pytest.mark.parametrize("offset", [0.0, 0.013, 0.025, 0.037])
@pytest.mark.parametrize("width", [0.75, 0.9])
def test_doorway_stays_passable(width: float, offset: float, tmp_path: Path) -> None:
    parts = scans.two_rooms(width)
    for part in parts:
        part.apply_translation((offset, offset, 0))
    bundle = repaired(parts, tmp_path)
    field = distance_field(bundle.freemap(0), (1.0 + offset, 2.0 + offset), radius_m=0.25)
    assert field.at((7.0 + offset, 2.0 + offset))[()] == pytest.approx(6.0, abs=0.4)
    # The boxes leave as much width as the scan, less a centimetre for rounding.
    across = np.arange(2.0 - width / 2 + 0.005, 2.0 + width / 2 - 0.005, 0.01)
    line: Any = np.column_stack([np.full_like(across, 4.05), across, np.full_like(across, 1.0)])
    line += (offset, offset, 0.0)
    assert not inside_boxes(bundle.obstacles(0), line).any()


def test_narrow_gap_is_not_passable(tmp_path: Path) -> None:
    bundle = repaired(scans.two_rooms(0.4), tmp_path)
    field = distance_field(bundle.freemap(0), (1.0, 2.0), radius_m=0.25)
    assert np.isinf(field.at((7.0, 2.0)))


def test_collision_compiles_and_carries(furnished: SceneBundle) -> None:
    """Balls dropped onto the boxes rest on them; one on the open floor rests on the floor."""
    obstacles, floor = furnished.obstacles(0), furnished.floor(0)
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    for center, half in zip(obstacles.center_m, obstacles.half_m, strict=True):
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=center, size=half)
    places = {"table": (1.5, 1.5), "floor": (4.5, 0.5), "crate": (4.2, 3.2)}
    for name, (x, y) in places.items():
        body = spec.worldbody.add_body(name=name, pos=[x, y, 1.2])
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.03, 0.03, 0.02], mass=0.1)
    model = spec.compile()
    data = mujoco.MjData(model)
    for _ in range(1000):
        mujoco.mj_step(model, data)
    heights = {name: float(data.body(name).xpos[2]) - 0.02 for name in places}
    assert heights["table"] == pytest.approx(0.75, abs=0.01)
    assert heights["crate"] == pytest.approx(0.40, abs=0.01)
    assert heights["floor"] == pytest.approx(0.0, abs=0.01)
    assert np.abs(floor.height_m[floor.covered]).max() < 0.021


def test_few_boxes(furnished: SceneBundle) -> None:
    assert len(furnished.obstacles(0).center_m) < 200


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.6), st.floats(0.0, 0.6))
def test_boxes_cover_what_they_must_and_nothing_else(seed: int, must: float, may: float) -> None:
    rng = np.random.default_rng(seed)
    shape = (6, 7, 5)
    pick = rng.random(shape)
    state = np.full(shape, NEVER)
    state[pick < must + may * (1 - must)] = MAY
    state[pick < must] = MUST
    lower = np.zeros((*shape, 3), dtype=np.uint8)
    upper = np.where(state[..., None] == MUST, STEPS, 0).astype(np.uint8) * np.ones(
        3, dtype=np.uint8
    )
    grid = GridSpec((0.0, 0.0), 1.0, shape[0], shape[1])
    owner = np.where(pick < must / 2, 3, -1).astype(np.int32)
    boxes = cover_with_boxes(Voxels(grid, 0.0, lower, upper, owner), state, 0.5)
    i, j, k = np.indices(shape).reshape(3, -1)
    centers: Any = np.stack([j + 0.5, i + 0.5, k + 0.5], axis=1)
    covered = inside_boxes(boxes, centers).reshape(shape)
    assert covered[state == MUST].all()
    assert not covered[state == NEVER].any()
    assert set(boxes.box_object.tolist()) <= {-1, 3}


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_voxels_hold_every_surface_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices = rng.random((12, 3)) * 2.0
    faces = rng.permutation(12).reshape(4, 3)
    grid = GridSpec((0.0, 0.0), 0.1, 20, 20)
    low, high = np.zeros(grid.shape), np.full(grid.shape, 2.0)
    voxels = voxelise(
        vertices,
        faces,
        np.arange(4, dtype=np.int32),
        grid,
        z0_m=0.0,
        layers=20,
        cut_below_m=low,
        cut_above_m=high,
    )
    corner = np.sort(rng.random((500, 2)), axis=1)
    bary = np.stack([corner[:, 0], corner[:, 1] - corner[:, 0], 1 - corner[:, 1]], axis=1)
    points = np.einsum("nk,fkd->fnd", bary, vertices[faces]).reshape(-1, 3)
    index = np.minimum((points / 0.1).astype(int), 19)
    at = (index[:, 1], index[:, 0], index[:, 2])
    assert voxels.occupied[at].all()
    assert (voxels.owner[at] >= 0).all()
    assert (voxels.owner >= 0).sum() == voxels.occupied.sum()
    within = points / 0.1 - index
    assert (within >= voxels.lower[at] / STEPS - 1e-6).all()
    assert (within <= voxels.upper[at] / STEPS + 1e-6).all()
