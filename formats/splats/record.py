"""Gaussian splats as they are read: one record for all file formats."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import F32, Array
from ..core.errors import FileFormatError
from ..core.frames import matrix_to_quat, quat_multiply, quat_to_matrix
from ..core.geometry import coarse_warning, far_offset
from ..untrusted.limits import limits
from .harmonics import rotate_harmonics

# More than any published indoor capture has; a record of so many without harmonics takes 0.9 GiB.
MAX_SPLATS = 20_000_000
MAX_DEGREE = 3
# Coordinates beyond this [units] are damage, not distance.
MAX_COORDINATE = 1e6


@dataclass(frozen=True)
class GaussianCloud:
    """N Gaussians with opacity and view-dependent colour (Kerbl et al., 2023).

    Attributes:
        position: (N, 3) float32 centres, in units of the file.
        scale: (N, 3) float32 standard deviations along the principal axes, in units of the file.
        quat_wxyz: (N, 4) float32 unit quaternions, principal axes to the file's frame.
        opacity: (N,) float32 in 0–1.
        harmonics: (N, (degree + 1)², 3) float32 coefficients of real spherical harmonics for RGB;
            the colour is 0.5 plus their sum along the viewing direction, in sRGB 0–1.
        antialiased: whether the splats were trained with the filter of Mip-Splatting.
        up: axis that the format promises to be up, with the reason, or None.
        unit: unit of length that the format promises, with the reason, or None.
        licence: as the file states it, empty if it states none.
        warnings: what had to be dropped while reading.
        offset: (3,) to add to `position` for the file's coordinates, which may lie too far from the
            origin for 32 bits.
    """

    position: F32
    scale: F32
    quat_wxyz: F32
    opacity: F32
    harmonics: F32
    antialiased: bool = False
    up: tuple[str, str] | None = None
    unit: tuple[str, str] | None = None
    licence: str = ""
    warnings: tuple[str, ...] = ()
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __len__(self) -> int:
        return len(self.position)

    @property
    def degree(self) -> int:
        """Return the degree of the harmonics, 0–3."""
        return round(self.harmonics.shape[1] ** 0.5) - 1

    def take(self, index: ArrayLike) -> "GaussianCloud":
        """Return the Gaussians that `index` selects, by mask or by number."""
        rows = np.asarray(index)
        names = ("position", "scale", "quat_wxyz", "opacity", "harmonics")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def transformed(self, similarity: ArrayLike, far: bool = False) -> "GaussianCloud":
        """Return the cloud moved by a (4, 4) similarity, its harmonics rotated with it.

        Args:
            similarity: applies to the file's coordinates.
            far: give the result an offset if it lies far from the origin; otherwise it has none.
        """
        matrix = np.asarray(similarity, dtype=np.float64)
        factor = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
        rotation = matrix[:3, :3] / factor
        turn = matrix_to_quat(rotation)
        position = self.position.astype(np.float64) @ matrix[:3, :3].T
        position += matrix[:3, :3] @ self.offset + matrix[:3, 3]
        return replace(
            self,
            **(near_origin(position) if far else _at_origin(position)),
            scale=(self.scale * factor).astype(np.float32),
            quat_wxyz=quat_multiply(turn, self.quat_wxyz).astype(np.float32),
            harmonics=rotate_harmonics(self.harmonics, rotation),
            up=None,
            unit=None,
        )


def near_origin(position: Array) -> dict[str, Any]:
    """Return `position` in 32 bits and `offset` for points (N, 3) that may lie far away."""
    return _at_origin(position, far_offset(position))


def _at_origin(position: Array, offset: Array | None = None) -> dict[str, Any]:
    offset = np.zeros(3) if offset is None else offset
    with np.errstate(over="ignore"):
        near = (position - offset).astype(np.float32)
    return {"position": near, "offset": (float(offset[0]), float(offset[1]), float(offset[2]))}


def cleaned(path: Path, cloud: GaussianCloud) -> GaussianCloud:
    """Drop unusable Gaussians with a warning; normalise quaternions; clip opacities."""
    if not np.any(cloud.offset):
        cloud = replace(cloud, **near_origin(cloud.position.astype(np.float64)))
    offset = np.array(cloud.offset)
    length = np.linalg.norm(cloud.quat_wxyz, axis=1)
    usable = np.isfinite(cloud.position).all(1) & (np.abs(cloud.position) < MAX_COORDINATE).all(1)
    usable &= np.isfinite(cloud.scale).all(1) & (cloud.scale < MAX_COORDINATE).all(1)
    usable &= np.isfinite(length) & (length > 1e-6) & np.isfinite(cloud.opacity)
    usable &= np.isfinite(cloud.harmonics).all((1, 2))
    warnings = (*cloud.warnings, *coarse_warning(cloud.position + offset, offset))
    if not usable.any():
        raise FileFormatError(path, f"none of its {len(cloud):,} Gaussians has valid numbers")
    if not usable.all():
        warnings = (*warnings, f"{int((~usable).sum()):,} Gaussians with invalid numbers dropped")
        cloud, length = cloud.take(usable), length[usable]
    return replace(
        cloud,
        quat_wxyz=cloud.quat_wxyz / length[:, None].astype(np.float32),
        opacity=np.clip(cloud.opacity, 0.0, 1.0),
        warnings=warnings,
    )


def joined(clouds: list[GaussianCloud]) -> GaussianCloud:
    """Return all clouds in one, with harmonics of the highest degree; other facts of the first."""
    origin = np.array(clouds[0].offset)
    width = max(cloud.harmonics.shape[1] for cloud in clouds)

    def arrays(cloud: GaussianCloud) -> tuple[F32, ...]:
        position = (cloud.position + (np.array(cloud.offset) - origin)).astype(np.float32)
        missing = width - cloud.harmonics.shape[1]
        harmonics = np.pad(cloud.harmonics, ((0, 0), (0, missing), (0, 0)))
        return position, cloud.scale, cloud.quat_wxyz, cloud.opacity, harmonics

    position, scale, quat, opacity, harmonics = (
        np.concatenate(parts) for parts in zip(*map(arrays, clouds), strict=True)
    )
    return replace(
        clouds[0],
        position=position,
        scale=scale,
        quat_wxyz=quat,
        opacity=opacity,
        harmonics=harmonics,
    )


def check_count(path: Path, count: int, degree: int) -> None:
    """Refuse counts and degrees that no reader should allocate memory for.

    Readers call it before they decompress or copy anything.
    """
    if not 1 <= count <= MAX_SPLATS:
        raise FileFormatError(path, f"declares {count:,} Gaussians; valid: 1 to {MAX_SPLATS:,}")
    if not 0 <= degree <= MAX_DEGREE:
        raise FileFormatError(path, f"harmonics of degree {degree}; valid: 0 to {MAX_DEGREE}")
    size, cap = count * 4 * (11 + 3 * (degree + 1) ** 2), limits().splat_bytes
    if size > cap:
        raise FileFormatError(
            path,
            f"declares {count:,} Gaussians with harmonics of degree {degree}, which take {size:,} "
            f"bytes in memory; valid: up to {cap:,} (limit splat_bytes)",
        )


def covariances(cloud: GaussianCloud) -> F32:
    """Return the covariances (N, 6) as xx, xy, xz, yy, yz, zz [units²], in blocks of memory."""
    out = np.empty((len(cloud), 6), dtype=np.float32)
    for first in range(0, len(cloud), 1 << 18):
        part = slice(first, first + (1 << 18))
        axes = quat_to_matrix(cloud.quat_wxyz[part]) * cloud.scale[part, None, :]
        full = axes @ np.swapaxes(axes, 1, 2)
        out[part] = full[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    return out
