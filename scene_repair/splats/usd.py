"""Gaussian splats in USD: USD's particle fields, and 3DGRUT's NuRec volumes.

Layouts: OpenUSD's schema `ParticleField3DGaussianSplat` (activated opacities, linear scales), and
3DGRUT's public code (Apache-2.0): a `Volume` prim with `omni:nurec:isNuRecVolume` names a `.nurec`
file, which is gzip over msgpack; `nre_data.state_dict` has arrays as bytes with their shapes,
before activation (logits of opacity, logarithms of scale, quaternions wxyz, harmonics by
coefficient). Neither says which way is up: the stage's axis is what the exporter was set to.

Run as a module it is the child that `read_usd_splats` starts: USD's library may crash or hang.
"""

import json
import sys
import zlib
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ...formats.core.arrays import F32, Array
from ...formats.core.errors import FileFormatError, MissingExtraError
from ...formats.splats.record import (
    MAX_DEGREE,
    MAX_SPLATS,
    GaussianCloud,
    check_count,
    cleaned,
    joined,
)
from ...formats.untrusted.files import read_input
from ...formats.untrusted.limits import limits
from ..scan.readings import ANSWER
from ..scan.sandbox import answer, run_child

ARRAYS = ("position", "scale", "quat_wxyz", "opacity", "harmonics", "offset")
PREFIX = ".gaussians_nodes.gaussians."
FLOATS = {2: np.float16, 4: np.float32}
# Bytes of a Gaussian with harmonics of degree 3, in 32 bits, and what else the file holds.
ROW_BYTES, HEAD_BYTES = 59 * 4, 1 << 20
GZIP = 16 + zlib.MAX_WBITS
# What the numbers in a NuRec file have to go through.
ACTIVATIONS = {"density_activation": "sigmoid", "scale_activation": "exp"}


def read_usd_splats(path: Path) -> GaussianCloud:
    """Read all splats of a USD stage or package, each moved as its prim says.

    Raises:
        FileFormatError: it holds none, or is damaged.
        MissingExtraError: a NuRec volume, and msgpack is not installed.
    """
    return cleaned(path, run_child((__name__,), path, _load))


def _load(data: dict[str, Any], folder: Path) -> GaussianCloud:
    arrays = [np.load(folder / f"{name}.npy", allow_pickle=False) for name in ARRAYS]
    *arrays, offset = arrays
    return GaussianCloud(*arrays, warnings=tuple(data["warnings"]), offset=tuple(offset.tolist()))


def _write(path: Path, folder: Path) -> None:
    cloud = _read(path)
    for name in ARRAYS:
        np.save(folder / f"{name}.npy", getattr(cloud, name))
    (folder / ANSWER).write_text(json.dumps({"warnings": cloud.warnings}))


def _read(path: Path) -> GaussianCloud:
    # In the child alone: its libraries take a second to import.
    from pxr import Usd, UsdGeom

    from ..usd.layers import check_layers
    from ..usd.read_stage import NUREC_KIND, TIME, open_stage, splats_in

    warnings = check_layers(path)
    stage = open_stage(path, warnings)
    clouds, meshes = [], 0
    xforms = UsdGeom.XformCache(TIME)
    # Also below prims that are only `over`, as in 3DGRUT's top layer.
    kinds = Usd.PrimIsActive & Usd.PrimIsLoaded & ~Usd.PrimIsAbstract
    for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(kinds)):
        meshes += prim.IsA(UsdGeom.Mesh)
        if kind := splats_in(prim):
            nurec = kind == NUREC_KIND
            cloud = _nurec(path, prim) if nurec else _particle_field(path, prim)
            world = np.array(xforms.GetLocalToWorldTransform(prim))
            clouds.append(_moved(path, cloud, world, nurec=nurec))
    if not clouds:
        raise FileFormatError(path, "contains no Gaussian splats")
    check_count(path, sum(len(c) for c in clouds), max(c.degree for c in clouds))
    if meshes:
        warnings.append(
            f"{meshes} meshes beside the splats are not used; give the file as --collision as well "
            "to use them as the surface"
        )
    return replace(joined(clouds), warnings=tuple(warnings))


def _moved(path: Path, cloud: GaussianCloud, world: Array, *, nurec: bool) -> GaussianCloud:
    """Apply a (4, 4) transform of row vectors, as USD has them.

    3DGRUT writes the matrix of a NuRec volume for column vectors, which its translation shows.
    """
    matrix = world if nurec and np.abs(world[:3, 3]).max() > 1e-9 else world.T
    linear = matrix[:3, :3]
    factor = np.cbrt(max(np.linalg.det(linear), 0.0))
    if factor < 1e-9 or np.abs(linear @ linear.T - factor**2 * np.eye(3)).max() > 1e-3 * factor**2:
        raise FileFormatError(
            path, "splats are mirrored or scaled unevenly; valid: rotation and scale"
        )
    return cloud.transformed(matrix, far=True)


def _particle_field(path: Path, prim: Any) -> GaussianCloud:
    def values(name: str, width: int) -> F32 | None:
        # Each attribute has a twin in half precision.
        for attribute in (prim.GetAttribute(name), prim.GetAttribute(f"{name}h")):
            data = attribute.Get() if attribute.IsValid() else None
            if data is not None and len(data):
                return np.array(data, dtype=np.float32).reshape(-1, width)
        return None

    def needed(name: str, width: int) -> F32:
        data = values(name, width)
        if data is None:
            raise FileFormatError(path, f"{prim.GetPath()} has no {name}")
        return data

    position = needed("positions", 3)
    count = len(position)
    harmonics = needed("radiance:sphericalHarmonicsCoefficients", 3)
    degree = prim.GetAttribute("radiance:sphericalHarmonicsDegree").Get() or 0
    check_count(path, count, degree)
    columns = [needed("scales", 3), needed("orientations", 4), needed("opacities", 1)]
    sizes = {len(column) for column in columns} | {len(harmonics) / (degree + 1) ** 2}
    if sizes != {count}:
        raise FileFormatError(
            path, f"{prim.GetPath()}: {count:,} positions, but arrays for {sorted(sizes)} Gaussians"
        )
    scale, xyzw, opacity = columns
    return GaussianCloud(
        position, scale, np.roll(xyzw, 1, axis=1), opacity[:, 0], harmonics.reshape(count, -1, 3)
    )


def _nurec(path: Path, prim: Any) -> GaussianCloud:
    data = _unpacked(path, _payload(path, prim))
    try:
        state = data["nre_data"]["state_dict"]
        layers = data["nre_data"].get("config", {}).get("layers", {})
        for name, valid in ACTIVATIONS.items():
            used = layers.get("gaussians", {}).get(name, valid)
            if used != valid:
                raise ValueError(f"{name} {used!r}; valid: {valid}")
        position, rotation, scale, density, albedo, specular = (
            _array(state, name)
            for name in (
                *("positions", "rotations", "scales", "densities"),
                *("features_albedo", "features_specular"),
            )
        )
        count, rest = len(position), specular.reshape(len(position), -1, 3)
        stored = round((rest.shape[1] + 1) ** 0.5) - 1
        active = state.get(f"{PREFIX}n_active_features")
        degree = stored if active is None else int(np.frombuffer(active, np.int64)[0])
        degree = min(degree, stored, MAX_DEGREE)
        harmonics = np.concatenate([albedo[:, None], rest[:, : (degree + 1) ** 2 - 1]], axis=1)
        check_count(path, count, degree)
        return GaussianCloud(
            position,
            np.exp(scale),
            rotation,
            (1 / (1 + np.exp(-density.reshape(count)))).astype(np.float32),
            harmonics,
        )
    # What msgpack holds may have any shape; whichever it is, the file is at fault.
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise FileFormatError(path, f"damaged NuRec volume: {error!r}") from error


def _array(state: dict[str, Any], name: str) -> F32:
    raw, shape = state[PREFIX + name], [int(n) for n in state[f"{PREFIX}{name}.shape"]]
    count = int(np.prod(shape))
    size = len(raw) // max(count, 1) if count else 2
    if size not in FLOATS or len(raw) != size * count:
        raise ValueError(f"{name}: {len(raw)} bytes for {shape}")
    return np.frombuffer(raw, FLOATS[size]).reshape(shape).astype(np.float32)


def _payload(path: Path, prim: Any) -> bytes:
    """Return the bytes of the `.nurec` file that a volume's fields name."""
    from ..usd.package import check_package, read_member

    for child in prim.GetAllChildren():
        asset = child.GetAttribute("filePath")
        value = asset.Get() if asset.IsValid() else None
        name = str(getattr(value, "path", value) or "").removeprefix("./")
        if not name.lower().endswith(".nurec"):
            continue
        if path.suffix.lower() != ".usdz":
            return read_input(path.parent / name, root=path.parent, max_bytes=limits().scan_bytes)
        if name not in check_package(path):
            raise FileFormatError(path, f"{prim.GetPath()} names {name!r}, which is not inside")
        return read_member(path, name)
    raise FileFormatError(path, f"{prim.GetPath()} names no .nurec file")


def _unpacked(path: Path, data: bytes) -> Any:
    if find_spec("msgpack") is None:
        raise MissingExtraError(f"{path.name}: a NuRec volume", "evaluate")
    import msgpack

    most = MAX_SPLATS * ROW_BYTES + HEAD_BYTES
    try:
        plain = zlib.decompressobj(GZIP).decompress(data, most)
        return msgpack.unpackb(plain, strict_map_key=False)
    # msgpack has a dozen types of its own.
    except Exception as error:
        raise FileFormatError(path, f"damaged NuRec volume: {error!r}") from error


def main(path: Path, memory_bytes: int) -> None:
    """Entry point of the child."""
    answer(path, memory_bytes, lambda folder: _write(path, folder))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
