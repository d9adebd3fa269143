"""Geometry from Gaussian splats: a room with a table, floaters, and a background outside."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial import KDTree
from trimesh.visual import ColorVisuals

from tests.conftest import SHARED_SCENES
from tests.support.scenes import scans
from tests.support.scenes.splats import random_cloud
from vlnpe.formats.core.errors import FileFormatError, InputError
from vlnpe.formats.core.frames import HABITAT_TO_WORLD, matrix_to_quat
from vlnpe.formats.splats.harmonics import C0
from vlnpe.formats.splats.ply import write_ply_splats
from vlnpe.formats.splats.record import GaussianCloud
from vlnpe.formats.splats.store import load_splats
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.labels.files import read_labels
from vlnpe.scene_repair.repair import repair_scene
from vlnpe.scene_repair.scan.dispatch import read_scan
from vlnpe.scene_repair.splats import fuse
from vlnpe.scene_repair.splats.read import read_splat_scan
from vlnpe.scene_repair.splats.repair import repair_splats
from vlnpe.scene_repair.splats.solid import find_solid

pytestmark = pytest.mark.chain

ROOM_M = np.array([4.4, 3.4, 2.5])
TABLE = ((1.4, 1.2), (2.6, 2.0), 0.72)
SPACING_M = 0.05
FLOATERS, BACKGROUND = 150, 400


def sheet(
    corner: tuple[float, ...], u: tuple[float, ...], v: tuple[float, ...], rgb: tuple[float, ...]
) -> GaussianCloud:
    """Return flat Gaussians on the rectangle of `corner` and the sides `u` and `v` [m]."""
    lengths = np.linalg.norm(u), np.linalg.norm(v)
    a, b = np.meshgrid(*(np.arange(0.5, max(n / SPACING_M, 1)) * SPACING_M for n in lengths))
    e1, e2 = np.array(u) / lengths[0], np.array(v) / lengths[1]
    points = np.array(corner) + a.reshape(-1, 1) * e1 + b.reshape(-1, 1) * e2
    quat = matrix_to_quat(np.stack([e1, e2, np.cross(e1, e2)], axis=1))
    count = len(points)
    return GaussianCloud(
        position=points.astype(np.float32),
        scale=np.tile(np.array([0.7 * SPACING_M, 0.7 * SPACING_M, 0.003], np.float32), (count, 1)),
        quat_wxyz=np.tile(quat, (count, 1)).astype(np.float32),
        opacity=np.full(count, 0.93, np.float32),
        harmonics=np.tile((np.array(rgb) - 0.5) / C0, (count, 1, 1)).astype(np.float32),
    )


def joined(*clouds: GaussianCloud) -> GaussianCloud:
    names = ("position", "scale", "quat_wxyz", "opacity", "harmonics")
    arrays = {name: np.concatenate([getattr(c, name) for c in clouds]) for name in names}
    return replace(clouds[0], **arrays)


def room_cloud(
    without: Sequence[str] = (), turn_deg: float = 0.0, *, background: int = BACKGROUND
) -> GaussianCloud:
    """Return a room with a table whose floor is bare beneath it, z up [m], or a part of it."""
    x, y, z = ROOM_M
    grey, brown = (0.7, 0.7, 0.7), (0.5, 0.3, 0.1)
    (x0, y0), (x1, y1), top = TABLE
    floor = sheet((0, 0, 0), (x, 0, 0), (0, y, 0), (0.2, 0.6, 0.2))
    p = floor.position
    floor = floor.take(~((p[:, 0] > x0) & (p[:, 0] < x1) & (p[:, 1] > y0) & (p[:, 1] < y1)))
    shell = {
        "ceiling": sheet((0, 0, z), (x, 0, 0), (0, y, 0), grey),
        "west": sheet((0, 0, 0), (0, y, 0), (0, 0, z), grey),
        "east": sheet((x, 0, 0), (0, y, 0), (0, 0, z), grey),
        "south": sheet((0, 0, 0), (x, 0, 0), (0, 0, z), grey),
        "north": sheet((0, y, 0), (x, 0, 0), (0, 0, z), grey),
    }
    surfaces = joined(
        floor,
        *(part for name, part in shell.items() if name not in without),
        sheet((x0, y0, top), (x1 - x0, 0, 0), (0, y1 - y0, 0), brown),
        *(sheet((k, y0, 0), (0, y1 - y0, 0), (0, 0, top), brown) for k in (x0, x1)),
        *(sheet((x0, k, 0), (x1 - x0, 0, 0), (0, 0, top), brown) for k in (y0, y1)),
    )
    rng = np.random.default_rng(0)
    scatter = rng.normal(0, 0.003, surfaces.position.shape)
    surfaces = replace(surfaces, position=(surfaces.position + scatter).astype(np.float32))
    stray = random_cloud(rng, FLOATERS, sizes=(0.01, 0.06))
    stray.position[:] = rng.uniform(0.3, ROOM_M - 0.3, (FLOATERS, 3))
    stray.opacity[:] = rng.uniform(0.1, 0.4, FLOATERS)
    outside = random_cloud(rng, background, spread=30.0, sizes=(0.5, 3.0))
    outside.position[:] += 20 * np.sign(outside.position)
    cloud = joined(surfaces, stray, outside)
    turn = trimesh.transformations.rotation_matrix(np.deg2rad(turn_deg), (0, 0, 1))
    return cloud.transformed(turn) if turn_deg else cloud


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the fusion coarse and short."""
    monkeypatch.setattr(fuse, "VOXELS", 700_000)
    monkeypatch.setattr(fuse, "VOXEL_M", 0.04)
    monkeypatch.setattr(fuse, "STATIONS", 14)
    monkeypatch.setattr(fuse, "SIDE_PX", 72)


def test_floaters_and_background_are_left_out() -> None:
    cloud = room_cloud()
    solid = find_solid(cloud)
    kind = np.r_[np.zeros(len(cloud) - FLOATERS - BACKGROUND), np.ones(FLOATERS), [2] * BACKGROUND]
    assert solid.keep[kind == 0].mean() > 0.99
    assert solid.keep[kind == 1].mean() < 0.5  # those near a surface are harmless
    assert not solid.keep[kind == 2].any()
    assert np.allclose(solid.upper - solid.lower, ROOM_M, atol=0.4)


def test_cameras_stand_in_the_room_and_not_in_the_table() -> None:
    solid = find_solid(room_cloud())
    places = fuse.stations(solid, 1.0)
    assert len(places) > 10
    assert ((places > 0.1) & (places < ROOM_M - 0.1)).all()
    (x0, y0), (x1, y1), top = TABLE
    in_table = (places[:, :2] > (x0, y0)).all(1) & (places[:, :2] < (x1, y1)).all(1)
    assert not (in_table & (places[:, 2] < top)).any()


@pytest.mark.usefixtures("quick")
def test_a_room_of_splats_becomes_a_sound_scene(tmp_path: Path) -> None:
    cloud = room_cloud()
    source = tmp_path / "lab.ply"
    write_ply_splats(source, cloud.transformed(np.linalg.inv(HABITAT_TO_WORLD)))
    (tmp_path / "out").mkdir()
    bundle = repair_splats(source, tmp_path / "out")
    record = json.loads((tmp_path / "out" / "repair.json").read_text())
    assert record["source"]["up"] == "y"
    assert record["source"]["unit"] == "m"
    assert any("floaters" in text for text in record["warnings"])
    assert record["verification"]["sound"], record["verification"]["problems"]
    assert bundle.level_floor_z_m == pytest.approx((0.0,), abs=0.012)
    mesh = bundle.visual()
    corners = mesh.vertices[mesh.faces]
    height = corners[..., 2].max(1)
    (x0, y0), (x1, y1), top = TABLE
    middle = corners.mean(1)
    over = (middle[:, :2] > (x0 + 0.1, y0 + 0.1)).all(1)
    over &= (middle[:, :2] < (x1 - 0.1, y1 - 0.1)).all(1)
    on_top = over & (np.abs(height - top) < 0.1)
    assert np.median(height[on_top]) == pytest.approx(top, abs=0.02)
    wall = np.abs(middle[:, 0] - ROOM_M[0]) < 0.1
    assert np.median(middle[wall, 0]) == pytest.approx(ROOM_M[0], abs=0.02)
    free = bundle.freemap(0)
    rows, columns = np.nonzero(free.traversable)
    xy = free.grid.center_of(np.stack([rows, columns], -1))
    in_table = (xy > (x0 + 0.05, y0 + 0.05)).all(1) & (xy < (x1 - 0.05, y1 - 0.05)).all(1)
    assert not in_table.any()
    open_m2 = len(rows) * free.grid.cell_m**2
    assert open_m2 > 0.85 * (ROOM_M[0] * ROOM_M[1] - (x1 - x0) * (y1 - y0))
    # The splats lie in the bundle, in the world, for rendering.
    stored = load_splats(bundle.root)
    near, _ = KDTree(stored.position).query(cloud.position)
    assert near.max() < 0.03


PARTS = [
    (("ceiling", "east", "north"), 0.0),
    (("ceiling", "east", "north"), 35.0),
    (("ceiling", "east"), 0.0),
    (("east", "north"), 35.0),
    (("ceiling", "south", "north"), 0.0),
]


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(("without", "turn_deg"), PARTS)
def test_a_part_of_a_room_is_looked_at_from_outside_its_table(
    without: tuple[str, ...], turn_deg: float
) -> None:
    solid = find_solid(room_cloud(without, turn_deg))
    factor = fuse.VOXEL_M / (np.prod(solid.upper - solid.lower) / fuse.VOXELS) ** (1 / 3)
    places = fuse.stations(solid, float(factor)) / factor
    turn = trimesh.transformations.rotation_matrix(np.deg2rad(-turn_deg), (0, 0, 1))
    back = np.asarray(turn)[:3, :3]
    places = places @ back.T
    over = places[places[:, 2] > TABLE[2]]
    assert len(over) >= 4
    assert ((over > -0.1) & (over < ROOM_M + 0.1)).all()


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(("without", "turn_deg"), PARTS[:1])
def test_a_part_of_a_room_is_repaired(
    without: tuple[str, ...], turn_deg: float, tmp_path: Path
) -> None:
    source = tmp_path / "part.ply"
    write_ply_splats(source, room_cloud(without, turn_deg))
    (tmp_path / "out").mkdir()
    bundle = repair_splats(source, tmp_path / "out", RepairConfig(up="z", unit="m"))
    assert bundle.level_floor_z_m == pytest.approx((0.0,), abs=0.02)
    free = bundle.freemap(0)
    assert free.traversable.sum() * free.grid.cell_m**2 > 0.75 * ROOM_M[0] * ROOM_M[1]


def test_a_given_surface_takes_the_place_of_the_fused_one(tmp_path: Path) -> None:
    source = tmp_path / "lab.ply"
    write_ply_splats(source, room_cloud())
    mesh = scans.write_glb(scans.room(), tmp_path / "room.glb")
    scan = read_splat_scan(source, print, mesh)
    assert np.array_equal(scan.faces, read_scan(mesh).faces)
    assert scan.companion is not None
    assert "their surface is given" in scan.warnings[0]
    with pytest.raises(InputError, match="--collision"):
        repair_scene(mesh, tmp_path, RepairConfig(collision=str(mesh)))


def write_occupancy(folder: Path, *, mirrored: bool = False) -> Path:
    """Write the map of `room_cloud`, 2 cm a pixel: rows along +y, columns along −x."""
    scale, lower = 0.02, np.array([-0.5, -0.4])
    columns, rows = np.ceil((ROOM_M[:2] + 1.0) / scale).astype(int)
    x, y = lower[0] + (np.arange(columns) + 0.5) * scale, lower[1] + (np.arange(rows) + 0.5) * scale
    in_room = ((x > 0.02) & (x < ROOM_M[0] - 0.02)) & ((y > 0.02) & (y < ROOM_M[1] - 0.02))[:, None]
    (x0, y0), (x1, y1), _ = TABLE
    table = ((x > x0) & (x < x1)) & ((y > y0) & (y < y1))[:, None]
    values = np.where(table, 0, np.where(in_room, 255, 127)).astype(np.uint8)
    Image.fromarray(values if mirrored else values[:, ::-1]).save(folder / "occupancy.png")
    meta = {"scale": scale, "min": [*lower.tolist(), 0.0]}
    (folder / "occupancy.json").write_text(json.dumps(meta))
    return folder / "occupancy.png"


def test_an_occupancy_map_is_a_surface(tmp_path: Path) -> None:
    source = tmp_path / "lab.ply"
    write_ply_splats(source, room_cloud())
    given = write_occupancy(tmp_path)
    scan = read_splat_scan(source, print, given)
    middle = scan.vertices[scan.faces].mean(1)
    level = np.ptp(scan.vertices[scan.faces][..., 2], axis=1) < 1e-9
    assert np.abs(middle[level, 2]).max() < 1e-9
    (x0, y0), (x1, y1), _ = TABLE
    assert not ((middle[level, :2] > (x0, y0)) & (middle[level, :2] < (x1, y1))).all(1).any()
    corners = scan.vertices[scan.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normal[level, 2] > 0).all()
    # Walls face the room: away from the table's middle at the table, toward the middle elsewhere.
    west = ~level & (np.abs(middle[:, 0] - 0.02) < 0.03)
    assert west.any() and (normal[west, 0] > 0).all()
    table_west = ~level & (np.abs(middle[:, 0] - x0) < 0.03) & (middle[:, 1] > y0)
    assert table_west.any() and (normal[table_west & (middle[:, 1] < y1), 0] < 0).all()
    assert scan.up is not None and scan.up[0] == "z"
    with pytest.raises(FileFormatError, match="not as documented"):
        read_splat_scan(source, print, write_occupancy(tmp_path, mirrored=True))
    write_occupancy(tmp_path)
    (tmp_path / "occupancy.json").write_text('{"scale": 0}')
    with pytest.raises(FileFormatError, match="scale"):
        read_splat_scan(source, print, given)
    (tmp_path / "occupancy.json").unlink()
    with pytest.raises(FileFormatError, match="missing"):
        read_splat_scan(source, print, given)


def test_a_captured_object_is_refused_as_a_room() -> None:
    path = SHARED_SCENES / "splats" / "guitar.compressed.ply"
    if not path.is_file():
        pytest.skip(f"no {path}")
    with pytest.raises(FileFormatError, match=r"an object, not a room|no surface"):
        read_splat_scan(path, print)


def test_a_part_of_a_room_is_not_called_an_object_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fuse, "stations", lambda *_: np.zeros((0, 3)))
    write_ply_splats(tmp_path / "part.ply", room_cloud())
    with pytest.raises(FileFormatError, match=r"a part of one that is open .* --collision"):
        read_splat_scan(tmp_path / "part.ply", lambda _: None)


def test_meshes_with_vertex_colours_stay_meshes(tmp_path: Path) -> None:
    mesh = trimesh.util.concatenate(scans.room())
    assert isinstance(mesh, trimesh.Trimesh)
    colors = np.random.default_rng(0).integers(0, 255, (len(mesh.vertices), 4))
    mesh.visual = ColorVisuals(mesh, vertex_colors=colors)
    mesh.export(str(tmp_path / "a.ply"))
    assert read_scan(tmp_path / "a.ply").companion is None


def test_damaged_splats_are_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "a.spz").write_bytes(b"nothing")
    with pytest.raises(FileFormatError, match="SPZ"):
        repair_splats(tmp_path / "a.spz", tmp_path, RepairConfig())


def corners(lower: tuple[float, ...], upper: tuple[float, ...], turn_deg: float) -> list[dict]:
    """Return the corners of a box turned about its upright axis, as InteriorGS lists them."""
    ends = np.array([lower, upper])
    box = np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i, j, k in np.ndindex(2, 2, 2)])
    c, s = np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg))
    middle = box.mean(0)
    turned = (box - middle) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + middle
    return [dict(zip("xyz", map(float, p), strict=True)) for p in turned]


def test_labels_of_interior_gs(tmp_path: Path) -> None:
    source = tmp_path / "3dgs_compressed.ply"
    (tmp_path / "labels.json").write_text(
        json.dumps(
            [
                {
                    "ins_id": "7",
                    "label": "sofa",
                    "bounding_box": corners((0, 0, 0), (2, 1, 0.8), 30),
                },
                {
                    "ins_id": "9",
                    "label": "wall lamp",
                    "bounding_box": corners((3, 3, 1), (4, 4, 2), 0),
                },
                {"ins_id": "11", "label": "other"},
            ]
        )
    )
    sofa, lamp = read_labels(source)
    assert (sofa.name, sofa.category) == ("Sofa_7", "sofa")
    assert sorted(sofa.half) == pytest.approx([0.4, 0.5, 1.0], abs=1e-5)
    assert sofa.contains(np.array([[1.0, 0.5, 0.4]]), 0.0).all()
    assert lamp.name == "WallLamp_9"
    (tmp_path / "labels.json").write_text('{"classes": ["cat", "dog"]}')
    assert read_labels(source) == []
    (tmp_path / "labels.json").write_text('[{"label": "sofa", "bounding_box": [1, 2]}]')
    with pytest.raises(FileFormatError, match="InteriorGS"):
        read_labels(source)
