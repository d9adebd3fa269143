"""USD and USDZ: other files under these names, false types, packages, recursion.

Layers and pictures outside the folder, cycles and instancing bombs are in
tests/scene_repair/scan/test_bad_usd.py.
"""

import zipfile
from pathlib import Path

import pytest

from tests.security.hostile import not_files, put, refusal
from tests.security.scans import cases as scans
from tests.support.scenes.damage import USDA
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.scene_repair.usd import read_stage
from vlnpe.scene_repair.usd.layers import check_layers
from vlnpe.scene_repair.usd.package import check_package, read_member

pytestmark = pytest.mark.chain


@pytest.mark.parametrize("suffix", [".usd", ".usda", ".usdc", ".usdz"])
@not_files
def test_only_regular_files_are_read(kind: str, suffix: str, tmp_path: Path) -> None:
    scans.check_places(suffix, kind, tmp_path)


def read(folder: Path, text: str) -> None:
    (folder / "a.usda").write_text(text)
    read_stage.read(folder / "a.usda")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        # Found by fuzzing: a value of an unknown type comes as one opaque object.
        ("color3f[] primvars:displayColor", "x[] primvars:displayColor"),
        ("point3f[] points", "string[] points"),
        ("point3f[] points", "x[] points"),
        ("int[] faceVertexIndices", "token[] faceVertexIndices"),
        ("int[] faceVertexCounts = [4, 3]", "int[] faceVertexCounts = [4000000000, 3]"),
        ("int[] faceVertexCounts = [4, 3]", "int[] faceVertexCounts = [-4, 3]"),
        ("double3 xformOp:translate = (0, 0, 1)", "string xformOp:translate = 'x'"),
        ("double3 xformOp:translate = (0, 0, 1)", "double3 xformOp:translate = (nan, inf, 0)"),
        ("int[] protoIndices = [0, 0]", "int[] protoIndices = [7, -1]"),
        ("point3f[] positions", "string[] positions"),
        ('upAxis = "Z"', 'upAxis = "W"'),
        ("metersPerUnit = 1", "metersPerUnit = nan"),
        ("metersPerUnit = 1", "metersPerUnit = -1"),
        ("texCoord2f[] primvars:st", "string[] primvars:st"),
        ("color3f inputs:diffuseColor = (0.2, 0.4, 0.6)", "string inputs:diffuseColor = 'x'"),
        ("(2, 0, 0)", "(nan, inf, 1e300)"),
    ],
)
def test_false_values_are_named_or_harmless(old: str, new: str, tmp_path: Path) -> None:
    text = USDA.decode()
    assert old in text
    try:
        read(tmp_path, text.replace(old, new, 1))
    except Exception:
        refusal(lambda: read(tmp_path, text.replace(old, new, 1)))


@pytest.mark.parametrize("depth", [300, 3000])
def test_deep_prims_are_named_or_read(depth: int, tmp_path: Path) -> None:
    text = "#usda 1.0\n" + 'def Xform "a" {' * depth + "}" * depth
    try:
        read(tmp_path, text)
    except Exception:
        refusal(lambda: read(tmp_path, text))


REFERENCES = ["b.usda", "b.usd", "b.usdz"]


@not_files
@pytest.mark.parametrize("name", REFERENCES)
def test_references_must_be_files(name: str, kind: str, tmp_path: Path) -> None:
    put(kind, tmp_path / name)
    (tmp_path / "a.usda").write_text(f'#usda 1.0\ndef "a" (references = @./{name}@) {{}}\n')
    try:
        assert check_layers(tmp_path / "a.usda")
    except FileFormatError:
        refusal(lambda: check_layers(tmp_path / "a.usda"))


def package(
    folder: Path, *members: tuple[str, bytes], compression: int = zipfile.ZIP_STORED
) -> Path:
    path = folder / "a.usdz"
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, data in members:
            archive.writestr(name, data)
    return path


@pytest.mark.parametrize("name", ["../a.usda", "/a.usda", "a/../../b.usda", "a\\b.usda"])
def test_members_outside_the_package_are_refused(name: str, tmp_path: Path) -> None:
    assert "leads out of" in refusal(lambda: check_package(package(tmp_path, (name, USDA)))).reason


def test_packages_that_grow_are_refused(tmp_path: Path) -> None:
    bomb = package(tmp_path, ("a.usda", bytes(1 << 20)), compression=zipfile.ZIP_DEFLATED)
    assert "compressed" in refusal(lambda: check_package(bomb)).reason


@pytest.mark.parametrize("cut", [0, 4, 30, 100])
def test_cut_packages_are_refused(cut: int, tmp_path: Path) -> None:
    path = package(tmp_path, ("a.usda", USDA))
    path.write_bytes(path.read_bytes()[:cut])
    refusal(lambda: check_package(path))
    refusal(lambda: read_member(path, "a.usda"))


def test_encrypted_and_missing_members_are_refused(tmp_path: Path) -> None:
    path = package(tmp_path, ("a.usda", USDA))
    data = bytearray(path.read_bytes())
    data[6] |= 1
    data[data.rindex(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(data)
    refusal(lambda: check_package(path))
    refusal(lambda: read_member(path, "b.usda"))
