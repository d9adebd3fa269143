"""Gaussian splats in USD, written by OpenUSD's own schema and by the layout of 3DGRUT's code."""

import gzip
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdVol, Vt

from tests.support.scenes.splats import assert_same, random_cloud
from vlnpe.formats.core.errors import FileFormatError, MissingExtraError
from vlnpe.formats.core.frames import quat_to_matrix
from vlnpe.formats.splats.kind import is_splats
from vlnpe.formats.splats.record import GaussianCloud
from vlnpe.scene_repair.splats import usd
from vlnpe.scene_repair.splats.usd import read_usd_splats

TURN = quat_to_matrix(np.array([np.cos(0.4), 0, np.sin(0.4), 0]))


def pose(shift: tuple[float, float, float] = (1.0, 2.0, 3.0)) -> np.ndarray:
    """Return (4, 4) for column vectors."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = 2 * TURN, shift
    return matrix


def write_field(path: Path, cloud: GaussianCloud, *, half: bool = False) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    field = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/World/gaussians")
    prim = field.GetPrim()
    UsdGeom.Xformable(prim).AddTransformOp().Set(Gf.Matrix4d(*pose().T.ravel()))
    end = "h" if half else ""
    vec, quat = (Vt.Vec3hArray, Vt.QuathArray) if half else (Vt.Vec3fArray, Vt.QuatfArray)
    one = Gf.Quath if half else Gf.Quatf
    dtype = np.float16 if half else np.float32
    number = Vt.HalfArray if half else Vt.FloatArray

    def put(name: str, value: Any) -> None:
        prim.GetAttribute(name + end).Set(value)

    put("positions", vec.FromNumpy(cloud.position.astype(dtype)))
    put("scales", vec.FromNumpy(cloud.scale.astype(dtype)))
    put("orientations", quat([one(*map(float, q)) for q in cloud.quat_wxyz]))
    put("opacities", number.FromNumpy(cloud.opacity.astype(dtype)))
    flat = np.ascontiguousarray(cloud.harmonics.reshape(-1, 3)).astype(dtype)
    put("radiance:sphericalHarmonicsCoefficients", vec.FromNumpy(flat))
    prim.GetAttribute("radiance:sphericalHarmonicsDegree").Set(cloud.degree)
    stage.Save()
    return stage


def nurec_bytes(cloud: GaussianCloud, **config: str) -> bytes:
    msgpack = pytest.importorskip("msgpack")
    rest = np.zeros((len(cloud), 45), dtype=np.float16)
    used = cloud.harmonics[:, 1:].reshape(len(cloud), -1)
    rest[:, : used.shape[1]] = used
    arrays = {
        "positions": cloud.position,
        "rotations": cloud.quat_wxyz,
        "scales": np.log(cloud.scale),
        "densities": np.log(cloud.opacity / (1 - cloud.opacity))[:, None],
        "features_albedo": cloud.harmonics[:, 0],
        "features_specular": rest,
    }
    state: dict[str, Any] = {"._extra_state": {"obj_track_ids": {"gaussians": []}}}
    for name, array in arrays.items():
        state[f".gaussians_nodes.gaussians.{name}"] = array.astype(np.float16).tobytes()
        state[f".gaussians_nodes.gaussians.{name}.shape"] = list(array.shape)
    degree = np.array([cloud.degree], np.int64).tobytes()
    state[".gaussians_nodes.gaussians.n_active_features"] = degree
    layer = {"density_activation": "sigmoid", "scale_activation": "exp", **config}
    data = {"nre_data": {"config": {"layers": {"gaussians": layer}}, "state_dict": state}}
    return gzip.compress(msgpack.packb(data))


def write_nurec(
    path: Path, cloud: GaussianCloud, matrix: np.ndarray, payload: bytes | None = None
) -> None:
    """Write a package as 3DGRUT does; `matrix` is written row by row."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    volume = UsdVol.Volume.Define(stage, "/World/gauss")
    volume.AddTransformOp().Set(Gf.Matrix4d(*matrix.ravel()))
    prim = volume.GetPrim()
    prim.CreateAttribute("omni:nurec:isNuRecVolume", Sdf.ValueTypeNames.Bool).Set(True)
    field = stage.DefinePrim("/World/gauss/density_field", "OmniNuRecFieldAsset")
    field.CreateAttribute("filePath", Sdf.ValueTypeNames.Asset).Set("./room.nurec")
    gauss = path.with_name("gauss.usda")
    stage.GetRootLayer().Export(str(gauss))
    top = Usd.Stage.CreateInMemory()
    top.OverridePrim("/World/gauss").GetReferences().AddReference("./gauss.usda", "/World/gauss")
    top.GetRootLayer().Export(str(path.with_name("default.usda")))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as package:
        package.write(path.with_name("default.usda"), "default.usda")
        package.writestr("room.nurec", nurec_bytes(cloud) if payload is None else payload)
        package.write(gauss, "gauss.usda")


@pytest.mark.parametrize("half", [False, True])
def test_particle_fields_of_openusd(half: bool, tmp_path: Path) -> None:
    cloud = random_cloud(np.random.default_rng(0), 40, 2)
    path = tmp_path / "field.usdc"
    stage = write_field(path, cloud, half=half)
    assert is_splats(path)
    read = read_usd_splats(path)
    assert_same(read, cloud.transformed(pose()), 0.02 if half else 1e-4)
    assert read.up is None and read.unit is None
    UsdGeom.Mesh.Define(stage, "/World/wall")
    stage.Save()
    assert "1 meshes beside the splats" in read_usd_splats(path).warnings[0]


def test_nurec_volumes_of_3dgrut(tmp_path: Path) -> None:
    cloud = random_cloud(np.random.default_rng(1), 50, 1)
    path = tmp_path / "room.usdz"
    # A matrix for column vectors, as its exporter writes it, and one as USD has it.
    for matrix in (pose(), pose().T):
        write_nurec(path, cloud, matrix)
        assert is_splats(path)
        read = read_usd_splats(path)
        assert read.degree == 1
        assert_same(read, cloud.transformed(pose()), 0.02)


def test_damaged_splats_in_usd_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cloud = random_cloud(np.random.default_rng(2), 20)
    path = tmp_path / "room.usdz"
    whole = nurec_bytes(cloud)
    for payload in (b"", whole[: len(whole) // 2], gzip.compress(b"\x80")):
        write_nurec(path, cloud, pose(), payload)
        with pytest.raises(FileFormatError, match="damaged NuRec volume"):
            read_usd_splats(path)
    write_nurec(path, cloud, pose(), nurec_bytes(cloud, scale_activation="softplus"))
    with pytest.raises(FileFormatError, match="scale_activation 'softplus'; valid: exp"):
        read_usd_splats(path)
    write_nurec(path, cloud, np.diag([1.0, 1, 2, 1]))
    with pytest.raises(FileFormatError, match="scaled unevenly"):
        read_usd_splats(path)
    empty = tmp_path / "empty.usda"
    Usd.Stage.CreateNew(str(empty)).Save()
    assert not is_splats(empty)
    with pytest.raises(FileFormatError, match="no Gaussian splats"):
        read_usd_splats(empty)
    monkeypatch.setattr(usd, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match="EXTRA=evaluate"):
        usd._unpacked(path, whole)
