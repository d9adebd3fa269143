"""Reading enormous, damaged and hostile images of a scan."""

import base64
import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.support.scenes.damage import picture_bytes
from tests.support.scenes.small_glb import glb, picture_tree
from vlnpe.scene_repair.scan import images
from vlnpe.scene_repair.scan.mesh import read_mesh

pytestmark = pytest.mark.chain
SIGNATURE = b"\x89PNG\r\n\x1a\n"


def big_png(width: int, height: int, color: int = 2) -> bytes:
    """A PNG of huge size in few bytes."""
    channels = {0: 1, 2: 3, 6: 4}[color]
    row = b"\0" + bytes([10, 200, 30, 255][:channels]) * width
    packer = zlib.compressobj(1)
    packed = b"".join([*(packer.compress(row) for _ in range(height)), packer.flush()])

    def chunk(kind: bytes, body: bytes) -> bytes:
        crc = zlib.crc32(kind + body)
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", crc)

    head = struct.pack(">IIBBBBB", width, height, 8, color, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize("name", ["a.eps", "a.png"])
def test_pictures_for_outside_programs_are_not_read(name: str, tmp_path: Path) -> None:
    Image.new("RGB", (4, 4), (255, 0, 0)).save(tmp_path / name, "EPS")
    (tmp_path / "scan.glb").write_bytes(glb(*picture_tree(name)))
    (tmp_path / "scan.mtl").write_text(f"newmtl paint\nKd 0.2 0.4 0.6\nmap_Kd {name}\n")
    (tmp_path / "scan.obj").write_text(
        "mtllib scan.mtl\nv 0 0 0\nv 4 0 0\nv 4 0 3\nvt 0 0\nusemtl paint\nf 1/1 2/1 3/1\n"
    )
    for file in ("scan.glb", "scan.obj"):
        scan = read_mesh(tmp_path / file)
        assert all(m.image is None for m in scan.materials), file
        assert any("picture" in w for w in scan.warnings), (file, scan.warnings)


def test_images_of_one_place_are_opened_once_and_within_the_budget(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    png = base64.b64encode(picture_bytes(40, 40)).decode()
    tree, data = picture_tree(f"data:image/png;base64,{png}")
    tree["images"] *= 5
    tree["textures"] = [{"source": k} for k in range(5)]
    tree["materials"] = [
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": k}}} for k in range(5)
    ]
    one = tree["meshes"][0]["primitives"][0]
    tree["meshes"][0]["primitives"] = [{**one, "material": k} for k in range(5)]
    path = tmp_path / "scan.glb"
    path.write_bytes(glb(tree, data))
    monkeypatch.setattr(images.PixelBudget.__init__, "__defaults__", (2000,))
    scan = read_mesh(path)
    assert len({id(m.image) for m in scan.materials}) == 1
    assert not scan.warnings
    monkeypatch.setattr(images.PixelBudget.__init__, "__defaults__", (1000,))
    scan = read_mesh(path)
    assert all(m.image is None for m in scan.materials)
    assert any("pixels in total" in w for w in scan.warnings)


@pytest.mark.parametrize("suffix", ["glb", "obj"])
def test_enormous_picture_is_scaled_down(suffix: str, tmp_path: Path) -> None:
    (tmp_path / "wide.png").write_bytes(big_png(30_000, 2_200))
    (tmp_path / "scan.glb").write_bytes(glb(*picture_tree("wide.png")))
    (tmp_path / "scan.mtl").write_text("newmtl paint\nmap_Kd wide.png\n")
    (tmp_path / "scan.obj").write_text(
        "mtllib scan.mtl\nv 0 0 0\nv 4 0 0\nv 4 0 3\nvt 0 0\nusemtl paint\nf 1/1 2/1 3/1\n"
    )
    scan = read_mesh(tmp_path / f"scan.{suffix}")
    image = scan.materials[0].image
    assert image is not None
    assert 3000 < image.width <= 4096
    assert np.asarray(image)[5, 5].tolist() == [10, 200, 30]
    assert any("30000 × 2200 pixels scaled down" in w for w in scan.warnings)


@pytest.mark.parametrize("mode", ["RGB", "L", "RGBA", "P", "I;16"])
def test_large_pictures_of_every_kind_keep_their_colours(
    mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(images, "MAX_PIXELS", 1000)
    monkeypatch.setattr(images, "MAX_SIDE", 17)
    smooth = np.linspace((20, 60, 100), (220, 160, 120), 51).astype(np.uint8)[None].repeat(39, 0)
    image = Image.fromarray(smooth)
    if mode == "I;16":
        image = Image.fromarray(smooth[..., 0].astype(np.uint16) * 257)
    elif mode == "P":
        image = image.quantize(200)
    else:
        image = image.convert(mode)
    stream = io.BytesIO()
    image.save(stream, "PNG")
    small = images.open_image(stream.getvalue(), "a", [], images.PixelBudget())
    assert small is not None and small.size == (17, 13)
    truth = smooth[:1, :, :1] if mode == "I;16" else np.asarray(image.convert("RGB"))[:1]
    assert np.abs(np.asarray(small)[6].astype(int) - truth[0, 1::3]).max() <= 8


@pytest.mark.parametrize(
    "data",
    [
        SIGNATURE + struct.pack(">I4sIIBBBBB", 13, b"IHDR", 2**30, 1, 8, 2, 0, 0, 0) + bytes(9),
        big_png(9000, 8000)[:5000],
        b"\x89PNG\r\n\x1a\n"
        + struct.pack(">I4sIIBBBBB", 13, b"IHDR", 2**31 - 1, 2**31 - 1, 8, 2, 0, 0, 0),
        picture_bytes(64, 64, "JPEG")[:-500],
    ],
)
def test_decompression_bombs_and_truncated_images_are_left_out(data: bytes) -> None:
    warnings: list[str] = []
    image = images.open_image(data, "a", warnings, images.PixelBudget())
    found = images.decode_all({} if image is None else {"a": image}, warnings)
    assert found.get("a") is None
    assert warnings


def test_many_pictures_are_scaled_down_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(images, "MAX_TOTAL_PIXELS", 10_000)
    warnings: list[str] = []
    made = images.decode_all({str(k): Image.new("RGB", (100, 50)) for k in range(8)}, warnings)
    sizes = [i.width * i.height for i in made.values() if i is not None]
    assert len(sizes) == 8
    assert 8_000 < sum(sizes) <= 10_000
    assert "scaled down to 50 %" in warnings[0]
