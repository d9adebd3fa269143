"""Reading malicious and damaged USD."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pxr import Sdf, UsdGeom

from tests.support.scenes.damage import USDA
from tests.support.scenes.usd_stages import (
    SQUARE,
    bind,
    home,
    new_stage,
    preview,
    read_here,
    save,
    square,
)
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.scene_repair.scan import dispatch as read_scan_module
from vlnpe.scene_repair.scan import sandbox as reader_child
from vlnpe.scene_repair.scan.dispatch import read_scan
from vlnpe.scene_repair.scan.readings import LookRef
from vlnpe.scene_repair.usd import package as usd_package


@pytest.mark.parametrize("way", ["reference", "payload", "sublayer"])
@pytest.mark.parametrize(
    "target", ["../outside.usda", "ABSOLUTE", "http://x.test/a.usda", "link.usda"]
)
def test_layers_outside_the_folder_are_refused(way: str, target: str, tmp_path: Path) -> None:
    outside = new_stage(tmp_path / "outside.usda")
    square(outside, "/Root/secret")
    save(outside)
    folder = tmp_path / "scan"
    folder.mkdir()
    (folder / "link.usda").symlink_to(tmp_path / "outside.usda")
    target = str(tmp_path / "outside.usda") if target == "ABSOLUTE" else target
    path = folder / "scene.usda"
    arc = {
        "reference": f'def Xform "a" (references = @{target}@) {{}}',
        "payload": f'def Xform "a" (payload = @{target}@) {{}}',
        "sublayer": "",
    }[way]
    head = f"(subLayers = [@{target}@])" if way == "sublayer" else ""
    path.write_text(f"#usda 1.0\n{head}\n{arc}\n")
    with pytest.raises(FileFormatError, match="leads out of the scan's folder") as caught:
        read_here(path)
    assert caught.value.path.name == "scene.usda"
    assert target in str(caught.value)


def test_hidden_ways_out_of_the_folder_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.usda"
    path.write_text(
        '#usda 1.0\n(expressionVariables = {string X = "/etc/a.usda"})\n'
        'def Xform "a" (references = @`"${X}"`@) {}\n'
    )
    with pytest.raises(FileFormatError, match="expression"):
        read_here(path)
    path.write_text(
        '#usda 1.0\ndef Xform "a" (prepend variantSets = "v"\nvariants = {string v = "one"})\n{\n'
        'variantSet "v" = {\n"one" (references = @../a.usda@) {\n}\n}\n}\n'
    )
    with pytest.raises(FileFormatError, match="leads out of the scan's folder"):
        read_here(path)
    path.write_text(
        '#usda 1.0\ndef Mesh "a" (clips = {dictionary default = {\n'
        "asset[] assetPaths = [@/etc/a.usda@]}}) {}\n"
    )
    with pytest.raises(FileFormatError, match="value clips"):
        read_here(path)


def test_a_missing_layer_is_reported_and_the_rest_is_read(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "scene.usda")
    square(stage, "/Root/floor")
    stage.DefinePrim("/Root/bed").GetReferences().AddReference("./bed.usda")
    save(stage)
    scan = read_here(tmp_path / "scene.usda")
    assert len(scan.faces) == 2
    assert any("'./bed.usda' is missing" in w for w in scan.warnings)


@pytest.mark.parametrize("where", ["../secret.png", "/etc/hostname", "http://x.test/a.png"])
def test_pictures_outside_the_folder_are_left_out(where: str, tmp_path: Path) -> None:
    Image.new("RGB", (4, 4), (255, 0, 0)).save(tmp_path / "secret.png")
    (tmp_path / "scan").mkdir()
    stage = new_stage(tmp_path / "scan" / "scene.usda")
    mesh = square(stage, "/Root/floor")
    bind(mesh.GetPrim(), preview(stage, "/Root/Looks/A", file=where))
    save(stage)
    scan = read_here(tmp_path / "scan" / "scene.usda")
    assert all(m.image is None for m in scan.materials)
    assert any("leads out of the scan's folder" in w for w in scan.warnings)


@pytest.mark.parametrize(
    "text",
    [
        '(defaultPrim = "R")\ndef Xform "R" (references = @./{}.usda@) {{}}\n',
        "(subLayers = [@./{}.usda@])\n",
    ],
    ids=["references", "sublayers"],
)
def test_circles_are_refused(text: str, tmp_path: Path) -> None:
    for name, target in (("scene", "b"), ("b", "scene")):
        (tmp_path / f"{name}.usda").write_text("#usda 1.0\n" + text.format(target))
    with pytest.raises(FileFormatError, match="circular") as caught:
        read_here(tmp_path / "scene.usda")
    assert "0x" not in str(caught.value)


def test_packed_package_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.usdz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as package:
        package.writestr("scene.usda", "#usda 1.0\n" + " " * 10_000_000)
    with pytest.raises(FileFormatError, match="compressed"):
        read_here(path)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("../scene.usda", "#usda 1.0\n"),
        ("scene.usda", '#usda 1.0\ndef Xform "a" (references = @../../a.usda@) {}\n'),
        ("scene.usda", '#usda 1.0\ndef Xform "a" (references = @/etc/a.usda@) {}\n'),
        ("scene.txt", "hello"),
    ],
)
def test_package_that_climbs_out_is_refused(name: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.usdz"
    with zipfile.ZipFile(path, "w") as package:
        package.writestr(name, text)
    with pytest.raises(FileFormatError, match=r"scene\.usdz"):
        read_here(path)


def test_package_with_contradictory_sizes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.usdz"
    with zipfile.ZipFile(path, "w") as package:
        package.writestr("scene.usda", "#usda 1.0\n")
    raw = bytearray(path.read_bytes())
    at = raw.rindex(b"PK\x01\x02")
    for offset in (20, 24):
        raw[at + offset : at + offset + 4] = (3_000_000_000).to_bytes(4, "little")
    path.write_bytes(bytes(raw))
    with pytest.raises(FileFormatError, match="bytes in total"):
        read_here(path)


def test_instancing_bomb_ends_in_an_error(tmp_path: Path) -> None:
    """Each level instances the one below ten times: ten to the ninth squares from a small file."""
    stage = new_stage(tmp_path / "scene.usda")
    square(stage, "/Root/L0/square")
    for k in range(1, 10):
        one = UsdGeom.PointInstancer.Define(stage, f"/Root/L{k}")
        one.CreatePrototypesRel().AddTarget(f"/Root/L{k - 1}")
        one.CreateProtoIndicesAttr([0] * 10)
        one.CreatePositionsAttr([(0, 0, n) for n in range(10)])
    save(stage)
    with pytest.raises(FileFormatError, match=r"more than|not read within|needs more"):
        reader_child.read_in_child("usd", tmp_path / "scene.usda", seconds=4)


@pytest.mark.chain
@pytest.mark.parametrize(
    "raw", [b"", b"#usda 1.0\ndef Mesh {", b"PXR-USDC" + b"\xff" * 200, b"hello"]
)
@pytest.mark.parametrize("suffix", ["usd", "usda", "usdc", "usdz"])
def test_damaged_files_are_named(suffix: str, raw: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"scene.{suffix}"
    path.write_bytes(raw)
    with pytest.raises(FileFormatError, match=rf"scene\.{suffix}"):
        read_scan(path)


def test_inconsistent_faces_are_dropped(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "scene.usda")
    square(stage, "/Root/floor")
    bad = square(stage, "/Root/bad")
    bad.GetFaceVertexCountsAttr().Set([3, 3])
    bad.GetFaceVertexIndicesAttr().Set([0, 1, 2, 0, 1, 99])
    lying = square(stage, "/Root/lying")
    lying.GetFaceVertexCountsAttr().Set([2_000_000_000])
    negative = square(stage, "/Root/negative")
    negative.GetFaceVertexCountsAttr().Set([-4, 8])
    nan = square(stage, "/Root/nan", [(np.nan, 0, 0), *SQUARE[1:]])
    assert nan
    save(stage)
    scan = read_here(tmp_path / "scene.usda")
    assert len(scan.faces) == 2 + 1 + 0
    text = " ".join(scan.warnings)
    for part in ("out of range", "/Root/lying", "/Root/negative", "invalid coordinates"):
        assert part in text


def test_hanging_and_greedy_readers_are_ended(tmp_path: Path) -> None:
    path = home(tmp_path)
    with pytest.raises(FileFormatError, match=r"scene\.usda: not read within 0 s"):
        reader_child.read_in_child("usd", path, seconds=0.05)
    with pytest.raises(FileFormatError, match=r"scene\.usda: (needs more than|its reader failed)"):
        reader_child.read_in_child("usd", path, memory_bytes=200 << 20)


def assert_read_or_named(path: Path) -> None:
    """Assert that a damaged file is read as finite vertices, or named in an error of one line."""
    try:
        scan = read_scan(path)
    except FileFormatError as error:
        assert error.path == path
        assert "\n" not in str(error)
    else:
        assert np.isfinite(scan.vertices).all()


def test_layer_that_crashed_the_library_is_read_or_refused(tmp_path: Path) -> None:
    """Found by fuzzing: these two bytes changed had USD abort its process, in one order of tables.

    USD does not write its tables in the same order every time.
    """
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(USDA.decode())
    path = tmp_path / "scene.usdc"
    layer.Export(str(path))
    raw = bytearray(path.read_bytes())
    raw[88], raw[462] = 1, 0
    path.write_bytes(bytes(raw))
    assert_read_or_named(path)


def test_mutated_binary_layers_end_in_typed_errors(tmp_path: Path) -> None:
    """Bytes all over a binary layer, in one child process each: some of them crash it."""
    stage = new_stage(tmp_path / "sound.usdc")
    square(stage, "/Root/floor")
    save(stage)
    raw = (tmp_path / "sound.usdc").read_bytes()
    rng = np.random.default_rng(0)
    for k in range(2):
        data = bytearray(raw)
        for at in rng.integers(8, len(raw), 12):
            data[at] = int(rng.integers(0, 256))
        path = tmp_path / f"scene{k}.usdc"
        path.write_bytes(bytes(data))
        assert_read_or_named(path)


def test_enormous_picture_files_leave_the_colour(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Image.new("RGB", (8, 8), (255, 0, 0)).save(tmp_path / "paint.png")
    with zipfile.ZipFile(tmp_path / "scene.usdz", "w") as package:
        package.write(tmp_path / "paint.png", "paint.png")
    looks = [
        LookRef("a", (1.0, 0.0, 0.0), str(tmp_path / "paint.png")),
        LookRef("b", (1.0, 0.0, 0.0), str(tmp_path / "scene.usdz"), "paint.png"),
    ]
    folder, warnings = tmp_path.resolve(), []
    found = read_scan_module._materials(folder, looks, warnings)
    assert all(m.image is not None for m in found)
    monkeypatch.setattr(read_scan_module, "MAX_BYTES", 10)
    monkeypatch.setattr(usd_package, "MAX_MEMBER_BYTES", 10)
    found = read_scan_module._materials(folder, looks, warnings)
    assert all(m.image is None for m in found)
    assert len(warnings) == 2
