"""Labels from several places at once, and Matterport's `.house` files."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from tests.support.scenes import scans
from tests.support.scenes.repairs import repaired
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.scene_repair.labels.attach import label_scan
from vlnpe.scene_repair.labels.categories import category_of_name
from vlnpe.scene_repair.labels.files import LabelBox
from vlnpe.scene_repair.labels.matterport import read_house
from vlnpe.scene_repair.labels.semantics import copies, not_floor
from vlnpe.scene_repair.scan.dispatch import read_scan
from vlnpe.scene_repair.scan.record import ScanMaterial
from vlnpe.scene_repair.scan.soup import Part, merge_parts

ZEROS = "0 0 0 0 0"
HOUSE = f"""ASCII 1.1
H home - 0 0 0 0 0 5 5 1 0 1 {ZEROS} -0.1 -0.1 0 5.1 4.1 2.6 {ZEROS}
L 0 1 a 2 2 0 -0.1 -0.1 0 5.1 4.1 2.6 {ZEROS}
R 0 0 0 0 k 2 2 0 0 0 0 5 4 2.6 2.6 0 0 0 0
C 0 11 dining#table 5 table {ZEROS}
C 1 1 wall 1 wall {ZEROS}
C 2 2 floor#lamp 28 lighting {ZEROS}
C 3 3 remove 0 void {ZEROS}
C 4 4 kitchen#cabinet 7 cabinet {ZEROS}
O 0 0 0 1.5 1.5 0.4 1 0 0 0 1 0 0.55 0.55 0.4 0 0 0 0 0 0 0 0
O 1 0 1 2.5 2 1.3 1 0 0 0 1 0 2.6 2.1 1.3 0 0 0 0 0 0 0 0
O 2 0 2 4 3 0.8 0.8 0.6 0 -0.6 0.8 0 0.2 0.1 0.8 0 0 0 0 0 0 0 0
O 3 0 3 4 1 0.8 1 0 0 0 1 0 0.2 0.2 0.8 0 0 0 0 0 0 0 0
O 4 0 -1 4 1 0.8 1 0 0 0 1 0 0.2 0.2 0.8 0 0 0 0 0 0 0 0
E 0 0 7 1.0 1 1 0 0 0 0 1 1 1 {ZEROS}
"""


def write_matterport(folder: Path, turn: np.ndarray) -> Path:
    """A textured room in pieces, as Matterport3D's GLB files are: several pictures, unlit."""
    parts = scans.room(more=scans.table(1.0, 1.0))
    scene = trimesh.Scene()
    for k, part in enumerate(parts):
        picture = Image.new("RGB", (16, 16), (20 * k, 100, 50))
        uv = part.vertices[:, :2] / 5
        mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
        mesh.visual = TextureVisuals(uv=uv, material=PBRMaterial(baseColorTexture=picture))
        mesh.apply_transform(turn)
        scene.add_geometry(mesh, node_name=f"chunk{k:03d}", geom_name=f"chunk{k:03d}")
    path = folder / "home.glb"

    def unlit(tree: dict) -> None:
        tree["extensionsUsed"] = ["KHR_materials_unlit"]
        for material in tree["materials"]:
            material["extensions"] = {"KHR_materials_unlit": {}}

    scene.export(str(path), tree_postprocessor=unlit)
    return path


@pytest.mark.chain
@pytest.mark.parametrize(("up", "turn"), [("z", np.eye(4)), ("y", scans.TO_Y_UP)])
def test_a_house_file_labels_the_room_and_determines_up(
    up: str, turn: np.ndarray, tmp_path: Path
) -> None:
    source = write_matterport(tmp_path, turn)
    (tmp_path / "home.house").write_text(HOUSE)
    assert len({id(m.image) for m in read_scan(source).materials}) > 5
    bundle = repaired(source, tmp_path)
    assert bundle.source["up"] == up
    assert "home.house" in bundle.source["up_reason"]
    named = {o.name: o for o in bundle.objects}
    assert named["Object_0"].category == "dining table"
    assert named["Object_0"].lower_m == pytest.approx((0.95, 0.95, 0.0), abs=1e-6)
    assert named["Object_0"].upper_m == pytest.approx((2.05, 2.05, 0.8), abs=1e-6)
    assert named["Room_0"].category == "room:kitchen"
    # Turned about the vertical: half sides 0.2 and 0.1 along (0.8, 0.6) and (−0.6, 0.8).
    assert named["Object_2"].upper_m[0] - 4 == pytest.approx(0.8 * 0.2 + 0.6 * 0.1)
    # A wall's box around the whole room says nothing, nor does what was removed.
    assert not {"Object_1", "Object_3", "Object_4"} & set(named)
    visual = bundle.visual()
    centers = visual.vertices[visual.faces].mean(axis=1)
    table = visual.face_label == bundle.labels.index("dining table")
    assert table.sum() > 12
    assert centers[table].max(axis=0) == pytest.approx((2.0, 2.0, 0.75), abs=0.35)


def test_house_file_of_another_building_is_left_out(tmp_path: Path) -> None:
    source = write_matterport(tmp_path, np.eye(4))
    moved = HOUSE.replace("-0.1 -0.1 0 5.1 4.1 2.6", "90 90 0 95 94 2.6")
    (tmp_path / "home.house").write_text(moved)
    scan, boxes = label_scan(source, read_scan(source))
    assert not boxes
    assert any("not used" in w for w in scan.warnings)


def test_duplicate_labels_are_taken_once(tmp_path: Path) -> None:
    source = write_matterport(tmp_path, np.eye(4))
    (tmp_path / "home.house").write_text(HOUSE)
    label = {"name": "Mine", "category": "dining table", "lower": [1, 1, 0], "upper": [2, 2, 0.75]}
    (tmp_path / "home.labels.json").write_text(json.dumps({"frame": "source", "objects": [label]}))
    _, boxes = label_scan(source, read_scan(source))
    assert [b.name for b in boxes if b.category == "dining table"] == ["Mine"]
    assert {"room:kitchen", "floor lamp"} <= {b.category for b in boxes}


def test_nodes_already_named_are_not_doubled(tmp_path: Path) -> None:
    table = scans.joined(scans.table(1.0, 1.0))
    parts = {
        "Floor_1": scans.sheet((0, 0), (5, 4), step=1.0),
        "DiningTable_1": table,
        "Walls_1": scans.joined(scans.walls((0, 0), (5, 4))),
    }
    source = scans.write_named_glb(parts, tmp_path / "home.glb")
    (tmp_path / "home.house").write_text(HOUSE)
    scan, boxes = label_scan(source, read_scan(source))
    assert "dining table" in {o.category for o in scan.objects}
    assert "dining table" not in {b.category for b in boxes}


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "does not begin"),
        ("ASCII 1.1\n", "neither rooms nor objects"),
        ("ASCII 1.1\nO 0 0 0 1 1\n", "line 2 is damaged"),
        ("ASCII 1.1\nO 0 0 0 a b c 1 0 0 0 1 0 1 1 1\n", "line 2 is damaged"),
        ("ASCII 1.1\nR 0 0 0 0 k 2 2 0 nan 0 0 5 4 2.6 2.6\n", "out of range"),
        ("ASCII 1.1\nC 0 1 table\n", "line 2 is damaged"),
    ],
)
def test_damaged_house_files_are_named(text: str, what: str, tmp_path: Path) -> None:
    path = tmp_path / "home.house"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=what) as caught:
        read_house(path)
    assert caught.value.path == path


@pytest.mark.parametrize(
    ("name", "category"),
    [
        ("KitchenTable_1", "kitchen table"),
        ("SofaC_1", "sofa"),
        ("Bed_3", "bed"),
        ("TVCabinet_1", "tv cabinet"),
        ("FloorB_1", "floor"),
        ("RoomWindow_9", "window"),
        ("geometry_0", ""),
        ("mesh12.obj", ""),
        ("dining-chair.003", "dining chair"),
        ("model_856a914fb4f34268d85458eea8f6c5f4_0", ""),
        ("Instance", ""),
        ("chestOfDrawers_0012", "chest of drawers"),
        ("decade", "decade"),
        ("facade_3", "facade"),
        ("elevator_portal_2", "elevator"),
        ("nursesstation_1", "reception desk"),
    ],
)
def test_category_from_name(name: str, category: str) -> None:
    assert category_of_name(name) == category


def test_a_floor_lamp_is_no_floor() -> None:
    part = scans.sheet((0, 0), (2, 2))
    look = ScanMaterial("grey", (0.5, 0.5, 0.5))
    uv = np.zeros((len(part.faces), 3, 2), np.float32)
    for category, blocked in (("floor lamp", True), ("tile floor", False), ("bath mat", False)):
        scan = merge_parts([Part("x", category, part.vertices, part.faces, uv, look)], [])
        assert not_floor(scan).all() == blocked


def test_pictures_on_both_sides_of_a_wall_are_two():
    half, axes = np.array([0.4, 0.01, 0.25]), np.eye(3)
    pictures = [
        LabelBox("left", "picture", np.array([0.0, 0.0, 1.5]), axes, half),
        LabelBox("right", "picture", np.array([0.1, 0.13, 1.5]), axes, 0.9 * half),
    ]
    assert not copies(pictures).any()
    table = LabelBox("table", "table", np.array([0.0, 0.0, 0.4]), axes, np.array([0.6, 0.4, 0.3]))
    top = LabelBox("top", "table", np.array([0.0, 0.0, 0.72]), axes, np.array([0.6, 0.4, 0.01]))
    assert copies([table, top]).tolist() == [False, True]
