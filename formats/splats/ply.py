"""PLY files of Gaussian splats: as 3DGS trains them, and PlayCanvas' compressed form.

Layouts: the reference code of Kerbl et al. (2023) for the first; the PlayCanvas developer manual
for the second: chunks of 256 Gaussians share bounds, between which 32-bit words interpolate.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import F32
from ..core.atomic import atomic_file
from ..core.errors import FileFormatError
from .harmonics import C0
from .kind import COMPRESSED, ply_splat_kind
from .ply_header import PlyHeader, ply_rows, read_ply_header
from .record import GaussianCloud, check_count, cleaned, near_origin

SPLAT_PROPERTIES = (
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
    "rot_0", "rot_1", "rot_2", "rot_3",
)  # fmt: skip
CHUNK = 256
LICENCE_WORDS = ("licence", "license", "licence:", "license:")
BOUNDS = tuple(f"{end}_{what}" for end in ("min", "max") for what in ("x", "y", "z"))
SCALE_BOUNDS = tuple(f"{end}_scale_{axis}" for end in ("min", "max") for axis in "xyz")
COLOR_BOUNDS = tuple(f"{end}_{channel}" for end in ("min", "max") for channel in "rgb")
# PlayCanvas stores harmonics as bytes over −4 … 4.
HARMONICS_SPAN = 8.0


def read_ply_splats(path: Path) -> GaussianCloud:
    """Read either kind of PLY."""
    header = read_ply_header(path)
    kind = ply_splat_kind(header)
    if not kind:
        raise FileFormatError(path, "contains no Gaussian splats")
    comments = [c.partition(" ") for c in header.comments]
    licence = next((text for word, _, text in comments if word.lower() in LICENCE_WORDS), "")
    reader = _read_compressed if kind == COMPRESSED else _read_plain
    return cleaned(path, reader(path, header, licence))


def _read_plain(path: Path, header: PlyHeader, licence: str) -> GaussianCloud:
    names = header.elements["vertex"].properties
    rest = sum(name.startswith("f_rest_") for name in names)
    degree = _degree(path, rest)
    needed = [*SPLAT_PROPERTIES, *(f"f_rest_{k}" for k in range(rest))]
    missing = [name for name in needed if name not in names]
    if missing:
        raise FileFormatError(path, f"its splats lack the properties {', '.join(missing)}")
    check_count(path, header.elements["vertex"].count, degree)
    rows = ply_rows(path, header, "vertex")

    def columns(*fields: str) -> F32:
        return np.stack([rows[name].astype(np.float32) for name in fields], axis=-1)

    harmonics = np.empty((len(rows), (degree + 1) ** 2, 3), dtype=np.float32)
    harmonics[:, 0] = columns("f_dc_0", "f_dc_1", "f_dc_2")
    for k in range(rest):
        # Channel by channel: all of red, then green, then blue.
        harmonics[:, 1 + k % (rest // 3), k // (rest // 3)] = rows[f"f_rest_{k}"]
    with np.errstate(over="ignore", invalid="ignore"):
        return GaussianCloud(
            **near_origin(np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=-1)),
            scale=np.exp(columns("scale_0", "scale_1", "scale_2")),
            quat_wxyz=columns("rot_0", "rot_1", "rot_2", "rot_3"),
            opacity=(1 / (1 + np.exp(-rows["opacity"].astype(np.float64)))).astype(np.float32),
            harmonics=harmonics,
            licence=licence,
        )


def _read_compressed(path: Path, header: PlyHeader, licence: str) -> GaussianCloud:
    count = header.elements["vertex"].count
    chunk = header.elements.get("chunk")
    extra = header.elements.get("sh")
    degree = _degree(path, len(extra.properties) if extra else 0)
    check_count(path, count, degree)
    missing = {*BOUNDS, *SCALE_BOUNDS} - set(chunk.properties if chunk else ())
    if chunk is None or missing:
        raise FileFormatError(
            path, f"its compressed splats lack the chunk property {sorted(missing)[0]}"
        )
    if chunk.count * CHUNK < count or (extra is not None and extra.count != count):
        raise FileFormatError(path, f"{chunk.count:,} chunks for {count:,} Gaussians")
    bounds, words = ply_rows(path, header, "chunk"), ply_rows(path, header, "vertex")
    chunk_of = np.arange(count) // CHUNK

    def between(share: F32, names: tuple[str, ...]) -> F32:
        ends = names[:3], names[3:]
        low, high = (np.stack([bounds[name] for name in end], axis=-1)[chunk_of] for end in ends)
        return (low + share * (high - low)).astype(np.float32)

    color = _unpacked(words["packed_color"], (8, 8, 8, 8))
    rgb = color[:, :3]
    if set(COLOR_BOUNDS) <= set(chunk.properties):
        rgb = between(rgb, COLOR_BOUNDS)
    harmonics = np.empty((count, (degree + 1) ** 2, 3), dtype=np.float32)
    harmonics[:, 0] = (rgb - 0.5) / np.float32(C0)
    if extra is not None and degree:
        rows = ply_rows(path, header, "sh")
        each = len(extra.properties) // 3
        for k, name in enumerate(extra.properties):
            byte = rows[name].astype(np.float32)
            # The two extreme bytes stand for the ends themselves, others for their middles.
            share = np.where(byte == 0, 0, np.where(byte == 255, 1, (byte + 0.5) / 256))
            harmonics[:, 1 + k % each, k // each] = (share - 0.5) * HARMONICS_SPAN
    position = between(_unpacked(words["packed_position"], (11, 10, 11)), BOUNDS)
    with np.errstate(over="ignore"):
        scale = np.exp(between(_unpacked(words["packed_scale"], (11, 10, 11)), SCALE_BOUNDS))
    return GaussianCloud(
        position=position,
        scale=scale,
        quat_wxyz=_smallest_three(words["packed_rotation"]),
        opacity=color[:, 3].copy(),
        harmonics=harmonics,
        licence=licence,
    )


def _unpacked(words: NDArray[np.uint32], bits: tuple[int, ...]) -> F32:
    """Return fields in 0–1 (N, len(bits)) of 32-bit words, the first in the highest bits."""
    words, low = np.asarray(words, dtype=np.uint32), 32
    columns = []
    for width in bits:
        low -= width
        top = np.uint32((1 << width) - 1)
        columns.append((words >> np.uint32(low) & top).astype(np.float32) / np.float32(top))
    return np.stack(columns, axis=-1)


def _smallest_three(words: NDArray[np.uint32]) -> F32:
    """Return quaternions (N, 4), wxyz.

    Two bits name the largest component, ten bits give each of the others.
    """
    others = (_unpacked(np.asarray(words) << np.uint32(2), (10, 10, 10)) - 0.5) * np.sqrt(2.0)
    largest = (np.asarray(words) >> np.uint32(30)).astype(np.int64)
    quat = np.empty((len(others), 4), dtype=np.float32)
    places = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])[largest]
    np.put_along_axis(quat, places, others.astype(np.float32), axis=1)
    rest = np.sqrt(np.maximum(0.0, 1.0 - (others**2).sum(1, keepdims=True)))
    np.put_along_axis(quat, largest[:, None], rest.astype(np.float32), axis=1)
    return quat


def _degree(path: Path, rest: int) -> int:
    degrees = {0: 0, 9: 1, 24: 2, 45: 3}
    if rest not in degrees:
        raise FileFormatError(path, f"{rest} coefficients f_rest_*; valid: 0, 9, 24 or 45")
    return degrees[rest]


def write_ply_splats(path: Path, cloud: GaussianCloud, comments: tuple[str, ...] = ()) -> None:
    """Write a PLY file of 3D Gaussian splatting, atomically."""
    rest = (cloud.harmonics.shape[1] - 1) * 3
    names = [*SPLAT_PROPERTIES[:6], *(f"f_rest_{k}" for k in range(rest)), *SPLAT_PROPERTIES[6:]]
    rows = np.empty(len(cloud), dtype=[(name, "<f4") for name in names])
    opacity = np.clip(cloud.opacity, 1e-6, 1 - 1e-6)
    parts = (
        ("xyz", cloud.position),
        (("f_dc_0", "f_dc_1", "f_dc_2"), cloud.harmonics[:, 0]),
        (("opacity",), np.log(opacity / (1 - opacity))[:, None]),
        (("scale_0", "scale_1", "scale_2"), np.log(np.maximum(cloud.scale, 1e-12))),
        (("rot_0", "rot_1", "rot_2", "rot_3"), cloud.quat_wxyz),
    )
    for fields, values in parts:
        for k, field in enumerate(fields):
            rows[field] = values[:, k]
    for k in range(rest):
        rows[f"f_rest_{k}"] = cloud.harmonics[:, 1 + k % (rest // 3), k // (rest // 3)]
    head = ["ply", "format binary_little_endian 1.0", *(f"comment {c}" for c in comments)]
    head += [f"element vertex {len(rows)}", *(f"property float {name}" for name in names)]
    with atomic_file(path) as temporary, temporary.open("wb") as stream:
        stream.write(("\n".join([*head, "end_header"]) + "\n").encode())
        rows.tofile(stream)
