"""Doubts and refusals about foreign models: printed where something is odd, silent where not."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.scene_repair.test_foreign_models import area, repaired, sky
from tests.support.scenes import buildings, scans
from tests.support.scenes.foreign import FAR, Parts, box, room, shell, write, write_usd
from vlnpe.formats.core.errors import SceneError
from vlnpe.scene_repair import repair
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.orient.transform import orient
from vlnpe.scene_repair.scan.dispatch import read_scan

pytestmark = pytest.mark.chain
EDITOR = "Khronos glTF Blender I/O v4.2"


def nave(height: float, gallery: bool = False) -> list[trimesh.Trimesh]:
    """A hall of 30 × 14 m with high windows, a ceiling and, if told so, a gallery."""
    windows = [box((x, -0.1, 0.5 * height), (x + 1, 0.1, 0.8 * height)) for x in range(2, 28, 5)]
    parts = [
        scans.sheet((0, 0), (30, 14), step=2.0),
        *scans.walls((0, 0), (30, 14), height),
        scans.sheet((0, 0), (30, 14), z=height, step=2.0, facing_up=False),
        *windows,
    ]
    return [*parts, box((0, 0, 3.9), (5, 14, 4.2))] if gallery else parts


def doubts_of(parts: list[trimesh.Trimesh], path: Path, **options: Any) -> list[str]:
    source = write(parts, path, y_up=True, generator=EDITOR)
    return orient(read_scan(source), RepairConfig(**options)).evidence["doubts"]


@pytest.mark.parametrize(("height", "gallery"), [(9.0, False), (13.9, True)])
def test_a_high_hall_raises_no_doubt(height: float, gallery: bool, tmp_path: Path) -> None:
    source = write(nave(height, gallery), tmp_path / "a.glb", y_up=True, generator=EDITOR)
    _, record = repaired(source)
    assert record["doubts"] == []


def test_a_house_in_feet_is_no_hall(tmp_path: Path) -> None:
    house = [*scans.two_rooms(0.9), box((0, -1, 0), (8, 0, 1))]
    parts = [part.apply_scale(1 / 0.3048) for part in house]
    doubts = doubts_of(parts, tmp_path / "a.glb")
    assert any("--unit ft" in line for line in doubts)


def test_a_model_without_a_floor_has_rooms_as_high_as_its_walls(tmp_path: Path) -> None:
    """Furniture, though level, is neither floor nor ceiling: RoomPlan leaves both out."""
    boxes = [
        box((0.1, 0.8, 0), (1, 2.8, 0.8)),
        box((2.5, 1.5, 0), (3.5, 2.1, 0.45)),
        box((5.4, 0.8, 0), (5.95, 2.4, 1.9)),
        box((1.8, 4.4, 0), (3.2, 5.2, 0.74)),
    ]
    parts = [*scans.walls((0, 0), (6, 7), 2.5, 0.02), *boxes]
    _, record = repaired(write(parts, tmp_path / "a.glb", y_up=True), floor_m=0.0)
    assert record["source"]["room_height_m"] == pytest.approx(2.5, abs=0.05)
    assert record["doubts"] == []


@pytest.mark.parametrize("generator", ["Open Asset Import Library (assimp", EDITOR])
@pytest.mark.parametrize("up", ["y", "x", "-x"])
def test_a_users_up_that_lays_a_building_on_its_side_is_obeyed_and_doubted(
    up: str, generator: str, tmp_path: Path
) -> None:
    source = write(shell(), tmp_path / "a.glb", generator=generator)
    evidence = orient(read_scan(source), RepairConfig(up=up)).evidence
    assert evidence["up"] == up
    assert any("on its side" in line and "--up z" in line for line in evidence["doubts"])
    assert orient(read_scan(source), RepairConfig(up="z")).evidence["doubts"] == []


def racks() -> list[trimesh.Trimesh]:
    """A store room with shelves of 9 × 1.2 m, high enough to stand between."""
    shelves = [box((1.5, y, z), (10.5, y + 1.2, z + 0.1)) for y in (2, 5) for z in (2.0, 4.0)]
    posts = [box((x, y, 0), (x + 0.1, y + 0.1, 6)) for x in (1.5, 10.4) for y in (2, 3.1, 5, 6.1)]
    return [*shelves, *posts, *scans.room(size=(12.0, 8.0), ceiling=False),
            *scans.walls((0, 0), (12, 8), 6.5),
            scans.sheet((0, 0), (12, 8), z=6.5, step=1.0, facing_up=False)]  # fmt: skip


def test_shelves_are_no_storeys(tmp_path: Path) -> None:
    bundle, record = repaired(write(racks(), tmp_path / "a.glb", y_up=True))
    assert bundle.level_floor_z_m == pytest.approx((0.0,), abs=0.01)
    assert any("shelves (4)" in line for line in record["doubts"])


HALL = [box((-30, -20, -0.2), (30, 20, 0)), *scans.walls((-30, -20), (30, 20), 6.0)]
HALL.append(box((-30, -20, 6), (30, 20, 6.2)))
LARGE: dict[str, tuple[Parts, str]] = {
    "a ground that is too wide for the cells": ({"Ground": sky(170.0, "ground")}, "--exclude Grou"),
    "a sky with hills": (
        {"Sky dome": sky(240.0, "sphere"), "Hills": sky(200.0, "hills")},
        "--exclude 'Sky dome' Hills",
    ),
    "a road of a kilometre": ({"Road": box((-600, 30, -0.2), (600, 34, -0.1))}, "--exclude Road"),
    "a house far off": ({"Neighbour": box((900, 0, 0), (1100, 10, 5))}, "--exclude Neighbour"),
}


@pytest.mark.parametrize("name", LARGE)
def test_what_makes_a_scene_too_large_is_named(name: str, tmp_path: Path) -> None:
    parts, advice = LARGE[name]
    hall = {"hall": scans.joined(HALL)}
    source = write({**hall, **parts}, tmp_path / "a.glb", y_up=True, generator=EDITOR)
    with pytest.raises(SceneError) as caught:
        repaired(source)
    assert advice in str(caught.value)


def test_a_hilly_ground_is_named_before_it_takes_all_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(repair, "MAX_VOXELS", 2_000_000)
    ground = scans.sheet((-15, -15), (15, 15), z=-0.12, step=1.0)
    points = np.array(ground.vertices)
    points[:, 2] += 0.15 * np.maximum(np.abs(points[:, :2]).max(axis=1) - 6, 0)
    terrain = {"Terrain": trimesh.Trimesh(points, ground.faces, process=False)}
    with pytest.raises(SceneError, match=r"voxels; .*--exclude Terrain"):
        repaired(write({**room(), **terrain}, tmp_path / "a.glb", y_up=True, generator=EDITOR))


def turned(parts: list[trimesh.Trimesh], axis: str, factor: float = 1.0) -> list[trimesh.Trimesh]:
    """Return copies with z brought to an axis, in other units."""
    turn = {"z": np.eye(3), "y": scans.TO_Y_UP[:3, :3], "x": np.roll(np.eye(3), 1, axis=0)}[axis]
    matrix = np.eye(4)
    matrix[:3, :3] = factor * turn
    return [part.copy().apply_transform(matrix) for part in parts]


def fbx(parts: list[trimesh.Trimesh], path: Path) -> Path:
    """Metres in centimetres: a root node scales by 100, as converters of FBX leave it."""
    scene = trimesh.Scene()
    for k, part in enumerate(parts):
        scene.add_geometry(part, node_name=f"n{k}", transform=100 * scans.TO_Y_UP)
    scene.export(str(path))
    return path


FURNISHED = list(room().values())
HABITS: dict[str, tuple[Callable[[Path], Path], dict[str, Any], tuple[str, str], str]] = {
    "SketchUp: inches, y up": (
        lambda d: write(turned(FURNISHED, "y", 39.37), d / "a.obj"), {}, ("y", "in"), ""),
    "Revit: feet, z up, far away": (
        lambda d: write(turned(FURNISHED, "z", 1 / 0.3048), d / "a.obj", shift=FAR),
        {}, ("z", "ft"), ""),
    "CAD: millimetres, x up": (
        lambda d: write(turned(FURNISHED, "x", 1000.0), d / "a.stl"), {}, ("x", "mm"), ""),
    "a camera's frame: upside down": (
        lambda d: write(turned(turned(FURNISHED, "y"), "z", -1.0), d / "a.ply"),
        {}, ("-y", "m"), ""),
    "FBX: centimetres in a root node": (
        lambda d: fbx(FURNISHED, d / "a.glb"), {}, ("y", "m"), "--unit cm"),
    "Omniverse: centimetres, z up": (
        lambda d: usd(turned(FURNISHED, "z", 100.0), d, 0.01), {}, ("z", "cm"), ""),
    "USD that promises centimetres for metres": (
        lambda d: usd(turned(buildings.tower_in_one_plane(), "z", 100.0), d, 1.0),
        {}, ("z", "m"), "--unit cm"),
    "a doll's house at 1:7": (
        lambda d: write(turned(FURNISHED, "z", 7.0), d / "a.obj"),
        {"unit": str(1 / 7)}, ("z", str(1 / 7)), ""),
    "IfcConvert: z up in a glTF": (
        lambda d: write(FURNISHED, d / "a.glb", generator="IfcOpenShell 0.8"),
        {}, ("z", "m"), "--up y"),
    "an editor's glTF": (
        lambda d: write(FURNISHED, d / "a.glb", y_up=True, generator=EDITOR),
        {}, ("y", "m"), ""),
}  # fmt: skip


def usd(parts: list[trimesh.Trimesh], folder: Path, unit_m: float) -> Path:
    named = {f"n{k}": part for k, part in enumerate(parts)}
    write_usd(named, folder / "a.usda", np.zeros(3), unit_m)
    return folder / "a.usda"


@pytest.mark.parametrize("name", HABITS)
def test_habits_of_exporters(name: str, tmp_path: Path) -> None:
    builder, options, (up, unit), doubt = HABITS[name]
    evidence = orient(read_scan(builder(tmp_path)), RepairConfig(**options)).evidence
    assert (evidence["up"], evidence["unit"]) == (up, unit), evidence
    lines = evidence["doubts"]
    assert any(doubt in line for line in lines) if doubt else lines == [], lines


def test_groups_of_an_obj_file_are_parts(tmp_path: Path) -> None:
    """As Rhino and Revit write them; objects, where there are any, count more."""
    lines, first = [], 1
    for name, part in room().items():
        lines += [f"g {name}", *(f"v {x} {y} {z}" for x, y, z in part.vertices)]
        lines += [f"f {a} {b} {c}" for a, b, c in part.faces + first]
        first += len(part.vertices)
    (tmp_path / "a.obj").write_text("\n".join(lines))
    scan = read_scan(tmp_path / "a.obj")
    assert set(scan.parts) == set(room())
    assert "1 objects named as floor" in orient(scan, RepairConfig()).evidence["up_reason"]
    (tmp_path / "a.obj").write_text("\n".join(["o all", *lines]))
    assert read_scan(tmp_path / "a.obj").parts == ("all",)


@pytest.mark.parametrize("below_m", [0.2, 0.5])
def test_a_suspended_ceiling_does_not_turn_a_building(below_m: float, tmp_path: Path) -> None:
    desks = [box((x, 1, 0.7), (x + 1.6, 1.8, 0.74)) for x in (1, 4, 7)]
    slabs = [box((0, 0, -0.3), (12, 9, 0)), box((0, 0, 3), (12, 9, 3.3))]
    tiles = box((0, 0, 3 - below_m), (12, 9, 3.02 - below_m))
    source = write([*shell(), *desks, *slabs, tiles], tmp_path / "a.obj")
    evidence = orient(read_scan(source), RepairConfig()).evidence
    assert evidence["up"] == "z"


def test_a_floor_is_laid_far_from_the_origin(tmp_path: Path) -> None:
    source = write(shell(), tmp_path / "a.obj", shift=FAR)
    _, record = repaired(source, floor_m=FAR[2], up="z", unit="m")
    assert area(record) == pytest.approx(12 * 9, rel=0.03)
