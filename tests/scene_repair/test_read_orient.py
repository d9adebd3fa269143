"""Up and unit from the shape of buildings alone, whatever way a file is turned."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.scenes import scans
from vlnpe.apartments import ApartmentConfig, build_scene
from vlnpe.formats.core.errors import SceneError, UnknownNameError
from vlnpe.pipeline.cli import main
from vlnpe.scene_repair.config import UNIT_M, RepairConfig
from vlnpe.scene_repair.orient.transform import orient
from vlnpe.scene_repair.repair import repair_scene
from vlnpe.scene_repair.scan.dispatch import read_scan
from vlnpe.scene_repair.scan.record import Scan, ScanMaterial, ScanObject
from vlnpe.scene_repair.scan.soup import Part, merge_parts

pytestmark = pytest.mark.chain

GREY = ScanMaterial("grey", (0.5, 0.5, 0.5))


def as_scan(vertices: np.ndarray, faces: np.ndarray) -> Scan:
    part = Part("", "", vertices, faces, np.zeros((len(faces), 3, 2), np.float32), GREY)
    return merge_parts([part], [])


@cache
def apartment(seed: int) -> Scan:
    """A generated home, z up, in metres, without names."""
    corners = build_scene(np.random.default_rng(seed), ApartmentConfig()).shape.corners
    return as_scan(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def turned(scan: Scan, rotation: np.ndarray, factor: float) -> Scan:
    return replace(scan, vertices=factor * scan.vertices @ rotation.T, up=None, unit=None)


def rotation(yaw: float, tilt: float, towards: float, axis: int) -> np.ndarray:
    """About z, then tilted, then z brought to another axis."""
    matrix = trimesh.transformations.rotation_matrix
    lean = np.asarray(matrix(tilt, (np.cos(towards), np.sin(towards), 0)))[:3, :3]
    return np.roll(np.eye(3), axis, axis=0) @ lean @ np.asarray(matrix(yaw, (0, 0, 1)))[:3, :3]


def check(scan: Scan, turn: np.ndarray, unit: str, within_deg: float = 0.5) -> None:
    way = orient(turned(scan, turn, 1.0 / UNIT_M[unit]), RepairConfig())
    to_world = way.source_to_world[:3, :3]
    up = to_world[2] / np.linalg.norm(to_world[2])
    assert np.rad2deg(np.arccos(np.clip(up @ turn[:, 2], -1, 1))) < within_deg, way.evidence
    assert way.evidence["unit"] == unit, way.evidence
    assert np.cbrt(np.linalg.det(to_world)) == pytest.approx(UNIT_M[unit])
    assert "units of height" in way.evidence["up_reason"]
    assert "rooms are" in way.evidence["unit_reason"]


angles = st.floats(0, 2 * np.pi)


@settings(max_examples=20, deadline=None, derandomize=True)
@given(
    yaw=angles,
    tilt_deg=st.floats(0, 20),
    towards=angles,
    axis=st.integers(0, 2),
    unit=st.sampled_from(sorted(UNIT_M)),
)
def test_homes_are_set_upright_in_metres(
    yaw: float, tilt_deg: float, towards: float, axis: int, unit: str
) -> None:
    check(apartment(0), rotation(yaw, np.deg2rad(tilt_deg), towards, axis), unit)


@pytest.mark.parametrize("name", ["small_house.glb", "quest_living_room.glb", "room_scan1.ply"])
def test_real_scans_are_set_upright_in_metres(name: str, shared_scenes: Path) -> None:
    scan = replace(read_scan(shared_scenes / name), objects=())
    if name.endswith(".glb"):
        scan = replace(scan, vertices=scan.vertices @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]))
    rng = np.random.default_rng(0)
    for axis, unit in enumerate(("m", "ft", "mm")):
        yaw, tilt, towards = rng.uniform(0, (6.28, 0.34, 6.28))
        # The laser scan is not level itself.
        check(scan, rotation(yaw, tilt, towards, axis), unit, 1.0)


def named(scan: Scan, up: str, unit: str) -> Scan:
    return replace(scan, up=(up, "the file says so"), unit=(unit, "the file says so"))


def test_declared_axis_and_unit_are_kept_if_the_geometry_agrees() -> None:
    to_y_up = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    way = orient(named(turned(apartment(0), to_y_up, 1.0), "y", "m"), RepairConfig())
    assert way.evidence["up"] == "y"
    assert way.evidence["up_reason"] == way.evidence["unit_reason"] == "the file says so"


def test_z_up_geometry_in_a_y_up_format_is_noticed() -> None:
    way = orient(named(apartment(0), "y", "m"), RepairConfig())
    assert way.evidence["up"] == "z"
    assert "the file says so, but z looks" in way.evidence["up_reason"]
    # Habitat turns such scenes so that z is up; its frame is the same for both.
    assert np.allclose(way.habitat_to_world[:3, :3], [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-3)
    assert orient(named(apartment(0), "y", "m"), RepairConfig(up="y")).evidence["up"] == "y"


def test_a_doubtful_unit_is_reported() -> None:
    scan = replace(apartment(0), vertices=apartment(0).vertices * 39.37)
    way = orient(named(scan, "z", "m"), RepairConfig())
    assert way.evidence["unit"] == "m"
    assert "set --unit in if" in way.evidence["unit_reason"]


def test_any_scale_is_a_number_of_metres() -> None:
    """A room modelled at 7:1, which no named unit fits."""
    scan = turned(apartment(0), np.eye(3), 7.0)
    way = orient(scan, RepairConfig(unit=str(1 / 7)))
    assert way.evidence["extent_m"] == pytest.approx(
        orient(apartment(0), RepairConfig(unit="m")).evidence["extent_m"], abs=1e-3
    )
    assert RepairConfig(unit="0.0254").unit == "0.0254"
    for bad in ("0", "-1", "nan", "inf", "1e999", "metre", "1 m"):
        with pytest.raises(UnknownNameError, match="a number of metres"):
            RepairConfig(unit=bad)


def test_the_doubt_about_a_unit_is_a_sentence() -> None:
    scan = replace(apartment(0), vertices=apartment(0).vertices / 0.3048)
    evidence = orient(named(scan, "z", "m"), RepairConfig()).evidence
    (doubt,) = evidence["doubts"]
    assert doubt.startswith("in m rooms are 8.46 m high")
    assert "; in ft the sizes would be more usual (in ft rooms are 2.58 m high" in doubt


def test_named_floors_determine_up() -> None:
    """A room with nothing in it has no other sign of which end is up."""
    room = scans.joined(
        [
            scans.sheet((0, 0), (6, 5), step=1.0),
            *scans.walls((0, 0), (6, 5)),
            scans.sheet((0, 0), (6, 5), z=2.6, step=1.0, facing_up=False),
        ]
    )
    for flip in (1.0, -1.0):
        vertices = room.vertices * (1, flip, flip)
        scan = as_scan(vertices, room.faces)
        low = np.abs(scan.vertices[scan.faces][..., 2]).max(axis=1) < 0.01
        scan = replace(
            scan,
            objects=(ScanObject("Floor_1", "floor"),),
            face_object=np.where(low, 0, -1).astype(np.int32),
        )
        assert orient(scan, RepairConfig()).evidence["up"] == ("z" if flip > 0 else "-z")


def test_where_the_floor_slopes_the_walls_decide() -> None:
    slope = np.deg2rad(2.5)
    floor = scans.sheet((0, 0), (6, 5), step=0.5)
    floor.vertices[:, 2] = np.tan(slope) * floor.vertices[:, 0]
    room = scans.joined([floor, *scans.walls((0, 0), (6, 5))])
    scan = named(as_scan(room.vertices, room.faces), "z", "m")
    assert not orient(scan, RepairConfig()).evidence["levelled"]


def corner_of_a_room() -> trimesh.Trimesh:
    """What a phone sees in a corner: two walls to 1.7 m, 1.6 × 1.7 m of floor, a chest, a shelf."""
    return scans.joined(
        [
            scans.sheet((0, 0), (1.6, 1.7)),
            scans.box((-0.1, 0, 0), (0, 1.7, 1.7)),
            scans.box((0, 1.7, 0), (1.6, 1.8, 1.7)),
            scans.box((0.0, 1.1, 0), (1.0, 1.7, 0.9)),
            scans.box((0.0, 0.0, 1.2), (0.3, 1.0, 1.24)),
        ]
    )


@pytest.mark.parametrize("up", ["z", "-y", "x", "-z"])
def test_an_implausible_result_asks_for_up(up: str, tmp_path: Path) -> None:
    """A partial scan without an up axis of its own, and every way it could be taken."""
    corner_of_a_room().export(tmp_path / "corner.ply")
    out = tmp_path / up
    out.mkdir()
    try:
        repair_scene(tmp_path / "corner.ply", out, RepairConfig(up=up, unit="m", picture_px=64))
    except SceneError as error:
        assert "--up" in str(error)
    else:
        doubts = json.loads((out / "repair.json").read_text())["doubts"]
        assert any("--up" in doubt for doubt in doubts)


def test_doubts_are_printed(
    tmp_path: Path, inline: None, capsys: pytest.CaptureFixture[str]
) -> None:
    corner_of_a_room().export(tmp_path / "corner.ply")
    main(["repair", str(tmp_path / "corner.ply"), "--out", str(tmp_path / "out"), "--json"])
    printed = capsys.readouterr()
    assert "--up" in printed.err + printed.out.splitlines()[0]
    assert any("--up" in doubt for doubt in json.loads(printed.out.splitlines()[-1])["doubts"])
