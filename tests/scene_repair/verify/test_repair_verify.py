"""Verification finds a floor that does not carry, whichever file of the scene is at fault."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from pxr import Usd, UsdGeom, Vt

from tests.support.scenes import scans
from tests.support.scenes.repairs import repaired
from vlnpe.collectors.physics.level_model import build_level_model
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.scene.bundle import SceneBundle, load_bundle
from vlnpe.pipeline.commands.look import Verify, run_verify
from vlnpe.scene_repair.collide.level_collision import LevelCollision
from vlnpe.scene_repair.verify.probe_balls import drop_balls
from vlnpe.scene_repair.verify.scene import probe_level, verify_scene

pytestmark = pytest.mark.chain

HOLE = (3.5, 1.0, 0.4)
Arrays = dict[str, NDArray]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> SceneBundle:
    """A room with a filled hole, a rug of 2 cm, and a part of the floor 8 cm lower."""
    folder = tmp_path_factory.mktemp("sound")
    lower = scans.rectangle((0.0, 2.5), (1.5, 4.0))
    parts = scans.room(
        without=scans.either(scans.disc(*HOLE), lower),
        more=[
            scans.sheet((0.0, 2.5), (1.5, 4.0), z=-0.08),
            scans.box((0.0, 2.49, -0.08), (1.5, 2.5, 0.0)),
            scans.box((1.5, 2.49, -0.08), (1.51, 4.0, 0.0)),
            scans.box((3.5, 2.5, 0.0), (4.5, 3.5, 0.02)),
        ],
    )
    return repaired(parts, folder)


@pytest.fixture
def copied(sound: SceneBundle, tmp_path: Path) -> SceneBundle:
    shutil.copytree(sound.root, tmp_path / "scene")
    return load_bundle(tmp_path / "scene")


def rewrite(path: Path, change: Callable[[Arrays], None]) -> None:
    with np.load(path) as data:
        arrays = dict(data)
    change(arrays)
    np.savez(path, **arrays)


def patch_faces(bundle: SceneBundle) -> NDArray[np.int64]:
    """Faces that the repair added in the hole, the largest last."""
    visual = bundle.visual()
    patch = [k for k, m in enumerate(bundle.materials) if m.name.startswith("floor_patch")]
    faces = np.flatnonzero(np.isin(visual.face_material, patch))
    center = visual.vertices[visual.faces[faces]].mean(axis=1)
    faces = faces[np.hypot(center[:, 0] - HOLE[0], center[:, 1] - HOLE[1]) < HOLE[2] + 0.1]
    a, b, c = (visual.vertices[visual.faces[faces, k]] for k in range(3))
    return faces[np.argsort(np.linalg.norm(np.cross(b - a, c - a), axis=1))]


def test_cells_that_lose_their_floor_keep_their_headroom(sound: SceneBundle) -> None:
    """Or low robots could not be planned for in any scene that has such a cell."""
    visual, free = sound.visual(), sound.freemap(0)
    level = LevelCollision(sound.floor(0), sound.obstacles(0), free)
    corners = visual.vertices[visual.faces]
    cut = np.hypot(*(corners.mean(axis=1)[:, :2] - (2.5, 1.0)).T) < 0.3
    open_floor = replace(visual, faces=visual.faces[~cut])
    rest, record = probe_level(open_floor, level)
    assert record["walkable_cells_lost"] > 0
    assert rest.freemap.traversable.sum() < free.traversable.sum()
    assert np.array_equal(rest.freemap.headroom_m, free.headroom_m)


def without(faces: NDArray[np.int64]) -> Callable[[Arrays], None]:
    def change(arrays: Arrays) -> None:
        for key in ("faces", "corner_uv", "face_material", "face_label", "face_object"):
            arrays[key] = np.delete(arrays[key], faces, axis=0)

    return change


def near_hole(xy: list[float]) -> bool:
    return bool(np.hypot(xy[0] - HOLE[0], xy[1] - HOLE[1]) < HOLE[2] + 0.1)


def test_sound_scene(sound: SceneBundle) -> None:
    record = json.loads((sound.root / "repair.json").read_text())
    proof = record["verification"]
    assert proof["sound"] and proof["problems"] == []
    level = proof["levels"][0]
    for kind, names in (
        ("rays", {"visual.npz", "scene.usdc", "scene.usdc collision"}),
        ("balls", {"visual.npz", "scene.usdc collision"}),
    ):
        assert set(level[kind]) == names
        assert all(r["fell_through"] == 0 and r["dropped"] > 200 for r in level[kind].values())
    assert level["floor_area_m2"] == pytest.approx(20.0, rel=0.03)
    assert proof == verify_scene(sound)


def test_steps_of_the_scan_are_listed(sound: SceneBundle) -> None:
    level = verify_scene(sound)["levels"][0]
    steps = level["steps_over_15_mm"]
    assert level["steps_by_repair"] == 0 and level["steps_in_scan"] == len(steps) > 0
    rug = [s for s in steps if s["height_m"] == pytest.approx(0.02, abs=1e-3)]
    edges = np.array([(s["lower_xy_m"], s["upper_xy_m"]) for s in rug]).reshape(-1, 2)
    assert edges.min(axis=0) == pytest.approx((3.5, 2.5), abs=0.05)
    assert edges.max(axis=0) == pytest.approx((4.5, 3.5), abs=0.05)


def test_missing_patch_triangle_is_found(copied: SceneBundle) -> None:
    """The smallest leak: one triangle less in the written mesh."""
    rewrite(copied.root / "visual.npz", without(patch_faces(copied)[-1:]))
    proof = verify_scene(copied)
    assert not proof["sound"]
    rays = proof["levels"][0]["rays"]
    assert rays["visual.npz"]["fell_through"] > 0
    assert near_hole(rays["visual.npz"]["where_xy_m"][0])
    assert rays["scene.usdc"]["fell_through"] == 0
    assert any("rays fall through the floor in visual.npz" in p for p in proof["problems"])


def test_missing_patch_is_found_by_balls_and_holes(copied: SceneBundle) -> None:
    rewrite(copied.root / "visual.npz", without(patch_faces(copied)))
    level = verify_scene(copied)["levels"][0]
    balls = level["balls"]["visual.npz"]
    assert balls["fell_through"] > 0
    assert all(near_hole(xy) for xy in balls["where_xy_m"])
    assert len(level["holes_still_open"]) == 1
    assert level["holes_still_open"][0]["open_area_m2"] == pytest.approx(np.pi * 0.16, rel=0.2)


@pytest.mark.parametrize(
    ("path", "surface"),
    [
        ("/World/Unnamed/floor/floor_patch_0", "scene.usdc"),
        ("/World/Collision/Floor_0", "scene.usdc collision"),
    ],
)
def test_missing_usd_face_is_found(copied: SceneBundle, path: str, surface: str) -> None:
    stage = Usd.Stage.Open(str(copied.root / "scene.usdc"))
    mesh = UsdGeom.Mesh.Get(stage, path)
    counts = np.asarray(mesh.GetFaceVertexCountsAttr().Get())
    index = np.asarray(mesh.GetFaceVertexIndicesAttr().Get()).reshape(len(counts), -1).copy()
    corners = np.asarray(mesh.GetPointsAttr().Get())[index]
    distance = np.abs(corners.mean(axis=1)[:, :2] - HOLE[:2]).max(axis=1)
    # Faces are moved away, not taken out: so the arrays still agree.
    index[distance < 0.2] = index[np.argmax(distance)]
    mesh.GetFaceVertexIndicesAttr().Set(Vt.IntArray.FromNumpy(index.ravel().copy()))
    low, high = mesh.GetExtentAttr().Get()
    mesh.GetExtentAttr().Set([low, high])
    stage.GetRootLayer().Save()
    del stage
    proof = verify_scene(copied)
    fallen = {name: r["fell_through"] for name, r in proof["levels"][0]["rays"].items()}
    assert fallen.pop(surface) > 0
    assert not any(fallen.values())


def test_step_that_the_repair_made_is_found(copied: SceneBundle) -> None:
    faces = patch_faces(copied)

    def lift(arrays: Arrays) -> None:
        corners = arrays["vertices"][arrays["faces"][faces]] + np.array([0, 0, 0.025], np.float32)
        first = len(arrays["vertices"])
        arrays["vertices"] = np.concatenate([arrays["vertices"], corners.reshape(-1, 3)])
        arrays["faces"][faces] = first + np.arange(3 * len(faces)).reshape(-1, 3)

    rewrite(copied.root / "visual.npz", lift)
    proof = verify_scene(copied)
    step = next(s for s in proof["levels"][0]["steps_over_15_mm"] if s["origin"] == "repair")
    assert step["height_m"] == pytest.approx(0.025, abs=2e-3)
    assert near_hole(np.mean([step["lower_xy_m"], step["upper_xy_m"]], axis=0).tolist())
    assert any("over 15 mm that the scan does not have" in p for p in proof["problems"])


def test_an_unlisted_gap_is_found(copied: SceneBundle) -> None:
    rewrite(copied.root / "visual.npz", without(patch_faces(copied)))

    def uncover(arrays: Arrays) -> None:
        floor = copied.floor(0)
        xy = floor.grid.center_of(np.moveaxis(np.indices(floor.grid.shape), 0, -1))
        arrays["covered"] &= np.hypot(xy[..., 0] - HOLE[0], xy[..., 1] - HOLE[1]) > HOLE[2] + 0.03

    rewrite(copied.root / "levels" / "0" / "floor.npz", uncover)
    path = copied.root / "repair.json"
    record = json.loads(path.read_text())
    hole = next(
        h
        for h in record["levels"][0]["holes"]
        if near_hole(np.mean(h["polygons_xy_m"][0], axis=0).tolist())
    )
    hole["action"], hole["reason"] = "left", ""
    path.write_text(json.dumps(record))
    problems = verify_scene(copied)["problems"]
    assert any("left without a reason" in p for p in problems)
    assert not any("not listed" in p for p in problems), problems
    record["levels"][0]["holes"].remove(hole)
    path.write_text(json.dumps(record))
    unlisted = verify_scene(copied)["levels"][0]["holes_unlisted"]
    assert len(unlisted) == 1 and near_hole(unlisted[0]["xy_m"])
    assert unlisted[0]["area_m2"] == pytest.approx(np.pi * 0.16, rel=0.2)


def test_every_storey_is_verified_and_drawn(tmp_path: Path) -> None:
    """Two floors joined by a stairwell, which stays open; each has a hole that is filled."""
    well = scans.rectangle((3.0, 1.0), (4.5, 2.0))
    parts = [
        scans.sheet((0, 0), (5, 4), without=scans.disc(*HOLE)),
        *scans.walls((0, 0), (5, 4), height=5.6),
        scans.sheet((0, 0), (5, 4), z=2.6, facing_up=False, without=well),
        scans.sheet((0, 0), (5, 4), z=2.8, without=scans.either(well, scans.disc(1.5, 3.0, 0.3))),
        scans.box((2.98, 0.98, 2.6), (4.52, 1.0, 2.8)),
        scans.box((2.98, 2.0, 2.6), (4.52, 2.02, 2.8)),
        scans.box((2.98, 1.0, 2.6), (3.0, 2.0, 2.8)),
        scans.box((4.5, 1.0, 2.6), (4.52, 2.0, 2.8)),
        scans.box((1.0, 1.0, 2.8), (1.6, 1.6, 3.2)),
    ]
    bundle, out = repaired(parts, tmp_path, picture_px=300), tmp_path / "bundle"
    assert bundle.level_floor_z_m == pytest.approx((0.0, 2.8), abs=1e-3)
    proof = verify_scene(bundle)
    assert proof["problems"] == []
    assert [level["floor_area_m2"] > 15 for level in proof["levels"]] == [True, True]
    stage = Usd.Stage.Open(str(out / "scene.usdc"))
    assert [bool(stage.GetPrimAtPath(f"/World/Collision/Floor_{k}")) for k in range(3)] == [
        True,
        True,
        False,
    ]
    # The stairwell is open in both maps, and a crate upstairs is no obstacle downstairs.
    assert not bundle.floor(1).covered[tuple(bundle.floor(1).grid.cell_of((3.7, 1.5)))]
    crate = bundle.obstacles(1).center_m[:, :2] - (1.3, 1.3)
    assert (np.abs(crate) < 0.35).all(axis=1).any()
    free = bundle.freemap(0)
    assert free.traversable[tuple(free.grid.cell_of((1.3, 1.3)))]
    with Image.open(out / "after.png") as picture:
        assert picture.height > 1.5 * picture.width
    # Taking the patch upstairs away is found upstairs.
    visual = bundle.visual()
    patch = [k for k, m in enumerate(bundle.materials) if m.name == "floor_patch_1"]
    rewrite(out / "visual.npz", without(np.flatnonzero(np.isin(visual.face_material, patch))))
    problems = verify_scene(bundle)["problems"]
    assert problems and all(p.startswith("level 1: ") for p in problems)


def test_compiled_physics_has_the_verified_floor(sound: SceneBundle) -> None:
    """Rays and a robot meet MuJoCo's floor where the triangles are: the sunken part, too."""
    model = build_level_model(sound, 0, get_robot("jetbot"))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    freemap = sound.freemap(0)
    index = np.argwhere(freemap.free(0.1))[::7]
    robot = model.body("robot/" + get_robot("jetbot").root_body).id
    geom = np.zeros(1, dtype=np.int32)
    off = []
    for (x, y), (row, column) in zip(freemap.grid.center_of(index), index, strict=True):
        start = np.array([x, y, 0.5])
        down = np.array([0.0, 0.0, -1.0])
        reach = mujoco.mj_ray(model, data, start, down, None, 1, robot, geom, None)
        if model.geom(geom[0]).name == "floor":
            off.append(0.5 - reach - float(freemap.floor_z_m[row, column]))
    assert len(off) > 0.9 * len(index)
    assert np.abs(off).max() < 0.01


@pytest.mark.parametrize("name", ["scene.usdc", "repair.json", "visual.npz"])
def test_missing_file_is_named(name: str, copied: SceneBundle) -> None:
    (copied.root / name).unlink()
    with pytest.raises(FileFormatError, match=name):
        verify_scene(copied)


@pytest.mark.parametrize("text", ["{", "[]", '{"levels": []}', '{"levels": [{"holes": [{}]}]}'])
def test_damaged_record_is_named(text: str, copied: SceneBundle) -> None:
    (copied.root / "repair.json").write_text(text)
    with pytest.raises(FileFormatError, match=r"repair\.json"):
        verify_scene(copied)


def test_command_shows_it(copied: SceneBundle, capsys: pytest.CaptureFixture[str]) -> None:
    # A copy has no record of its files beside it; otherwise it is sound.
    assert run_verify(Verify(copied.root)) == 1
    shown = capsys.readouterr().out
    assert "no record of its files" in shown
    assert "outputs checked: 2, bad: 1" in shown
    rewrite(copied.root / "visual.npz", without(patch_faces(copied)[-1:]))
    assert run_verify(Verify(copied.root)) == 1
    assert "rays fall through the floor in visual.npz, the first at x " in capsys.readouterr().out


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("width", "falls"), [(0.016, False), (0.024, True)])
def test_balls_fall_through_what_is_wider_than_they(
    width: float, falls: bool, turned: bool
) -> None:
    """A slit lets a ball of 2 cm pass if it is wider than the ball, whichever way faces look."""
    left, right = scans.sheet((0, 0), (0.5, 1), step=0.1), scans.sheet((0.5, 0), (1, 1), step=0.1)
    right.apply_translation((width, 0, 0))
    sheet = scans.joined([left, right])
    triangles = np.asarray(sheet.triangles, dtype=np.float32)
    triangles = triangles[:, ::-1] if turned else triangles
    start = np.array([[0.5 + width / 2, 0.5, 0.0], [0.2, 0.5, 0.0], [0.51 + width, 0.2, 0.0]])
    fell = drop_balls(triangles, start)[:, 2] < -0.05
    assert fell.tolist() == [falls, False, False]
