"""Readers of scans, splats and what lies beside them."""

import gzip
import io
import itertools
import json
import struct
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import zstandard

from tests.support.scenes import damage

from .target import Target, saved


def _scan(suffix: str, folder: Path) -> Target:
    from vlnpe.scene_repair.scan.mesh import read_mesh

    (folder / "a.png").write_bytes(damage.picture_bytes(4, 4))
    (folder / "a.mtl").write_text("newmtl a\nKd 1 0 0\nmap_Kd a.png\n")
    seeds = [d for n, d in damage.sound_files().items() if n.endswith(suffix)]
    return Target(seeds, saved(folder / f"a.{suffix}", read_mesh))


def _gltf(folder: Path) -> Target:
    from tests.security.scans.test_glb import POINTS, tree
    from vlnpe.scene_repair.scan.mesh import read_mesh

    (folder / "points.bin").write_bytes(POINTS)
    (folder / "a.png").write_bytes(damage.picture_bytes(4, 4))
    look = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    textured = tree(materials=[look], textures=[{"source": 0}], images=[{"uri": "a.png"}])
    textured["meshes"][0]["primitives"][0]["material"] = 0
    seeds = [json.dumps(value).encode() for value in (tree(), textured)]
    return Target(seeds, saved(folder / "a.gltf", read_mesh))


def _mtl(folder: Path) -> Target:
    from vlnpe.scene_repair.scan.mesh import read_mesh

    obj = folder / "a.obj"
    obj.write_text("mtllib a.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    (folder / "a.png").write_bytes(damage.picture_bytes(4, 4))
    seeds = [b"newmtl a\nKd 1 0 0\nKa 0 0 0\nNs 10\nmap_Kd a.png\n"]
    return Target(seeds, saved(folder / "a.mtl", lambda _: read_mesh(obj)))


def _pcd(folder: Path) -> Target:
    from vlnpe.scene_repair.scan.headers import check_pcd

    return Target([damage.sound_files()["pcd"]], saved(folder / "a.pcd", check_pcd))


def _usd(suffix: str, folder: Path) -> Target:
    from pxr import Usd

    from vlnpe.scene_repair.usd import read_stage

    plain = folder / "seed.usda"
    plain.write_bytes(damage.USDA)
    if suffix == "usdc":
        stages: Any = Usd
        stages.Stage.Open(str(plain)).Export(str(folder / "seed.usdc"))
        seed = (folder / "seed.usdc").read_bytes()
    elif suffix == "usdz":
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w") as archive:
            archive.writestr("a.usda", damage.USDA)
        seed = stream.getvalue()
    else:
        seed = damage.USDA
    numbers = iter(range(10**9))

    def read(data: bytes) -> object:
        # USD keeps opened layers by name.
        path = folder / f"{next(numbers)}.{suffix}"
        path.write_bytes(data)
        try:
            return read_stage.read(path)
        finally:
            path.unlink()

    return Target([seed], read)


def _splats(suffix: str, folder: Path) -> Target:
    from tests.formats.splats.test_read import gltf_bytes, spz_bytes
    from tests.support.scenes.splats import random_cloud
    from vlnpe.formats.splats.ply import write_ply_splats
    from vlnpe.formats.splats.read import read_splats

    cloud = random_cloud(np.random.default_rng(0), 4, 1)
    read = saved(folder / f"a.{suffix}", read_splats)
    if suffix == "ply":
        write_ply_splats(folder / "seed.ply", cloud)
        return Target([(folder / "seed.ply").read_bytes()], read)
    if suffix == "splat":
        row = struct.pack("<6f8B", 0, 1, 2, 0.1, 0.1, 0.1, *range(100, 108))
        return Target([4 * row], read)
    if suffix == "glb":
        return Target([gltf_bytes(cloud)], read)
    # Up to version 3 the whole file is compressed: what is inside is changed.
    plain = [gzip.decompress(spz_bytes(cloud, version)) for version in (2, 3)]

    def pack(data: bytes) -> object:
        return read(data if data[4:5] == b"\4" else gzip.compress(data, 1))

    return Target([*plain, _spz_4(plain[1], len(cloud))], pack)


def _spz_4(plain: bytes, count: int) -> bytes:
    """Return a file of version 3 and degree 1 in the layout of version 4."""
    ends = np.cumsum([16, *(n * count for n in (9, 1, 3, 3, 4, 9))])
    parts = [plain[a:b] for a, b in itertools.pairwise(ends)]
    packed = [zstandard.compress(part) for part in parts]
    head = plain[:4] + struct.pack("<I", 4) + plain[8:15] + struct.pack("<BI", len(parts), 32)
    table = [struct.pack("<QQ", len(p), len(q)) for p, q in zip(packed, parts, strict=True)]
    return b"".join([head.ljust(32, b"\0"), *table, *packed])


def _labels(folder: Path) -> Target:
    from tests.scene_repair.scan.test_side_files import ANCHOR
    from vlnpe.scene_repair.labels.files import read_labels

    own = {
        "frame": "source",
        "objects": [{"name": "a", "category": "bed", "lower": [0, 0, 0], "upper": [1, 1, 1]}],
    }
    seeds = [json.dumps(value).encode() for value in (own, [ANCHOR])]
    return Target(seeds, saved(folder / "a.labels.json", lambda _: read_labels(folder / "a.glb")))


def _house(folder: Path) -> Target:
    from tests.security.scans.test_house import THING, house
    from vlnpe.scene_repair.labels.matterport import read_house

    room = "R 0 0 0 0 a 0 0 0 0 0 0 2 2 2\n"
    seeds = [house(THING.format(number=0), room).encode()]
    return Target(seeds, saved(folder / "a.house", read_house))


SCANS: dict[str, Callable[[Path], Target]] = {
    "glb": partial(_scan, "glb"),
    "gltf": _gltf,
    "obj": partial(_scan, "obj"),
    "mtl": _mtl,
    "ply": partial(_scan, "ply"),
    "stl": partial(_scan, "stl"),
    "off": partial(_scan, "off"),
    "pcd": _pcd,
    "usda": partial(_usd, "usda"),
    "usdc": partial(_usd, "usdc"),
    "usdz": partial(_usd, "usdz"),
    "labels": _labels,
    "house": _house,
    "splats-ply": partial(_splats, "ply"),
    "splats-splat": partial(_splats, "splat"),
    "splats-spz": partial(_splats, "spz"),
    "splats-glb": partial(_splats, "glb"),
}
