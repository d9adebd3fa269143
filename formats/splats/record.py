"""Gaussian splats as they are read: one record for all file formats."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import FileFormatError
from ..core.frames import matrix_to_quat, quat_to_matrix
from .harmonics import rotate_harmonics

F32 = NDArray[np.float32]

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

    def __len__(self) -> int:
        return len(self.position)

    @property
    def degree(self) -> int:
        """Return the degree of the harmonics, 0–3."""
        return round(self.harmonics.shape[1] ** 0.5) - 1

    def take(self, index: ArrayLike) -> "GaussianCloud":
        """Return the Gaussians that `index` selects, by mask or by number."""
        rows = np.asarray(index)
        return replace(
            self,
            position=self.position[rows],
            scale=self.scale[rows],
            quat_wxyz=self.quat_wxyz[rows],
            opacity=self.opacity[rows],
            harmonics=self.harmonics[rows],
        )

    def transformed(self, similarity: ArrayLike) -> "GaussianCloud":
        """Return the cloud moved by a (4, 4) similarity, its harmonics rotated with it."""
        matrix = np.asarray(similarity, dtype=np.float64)
        factor = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
        rotation = matrix[:3, :3] / factor
        turn = matrix_to_quat(rotation)
        return replace(
            self,
            position=(self.position @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32),
            scale=(self.scale * factor).astype(np.float32),
            quat_wxyz=_product(turn, self.quat_wxyz),
            harmonics=rotate_harmonics(self.harmonics, rotation),
            up=None,
            unit=None,
        )


def cleaned(path: Path, cloud: GaussianCloud) -> GaussianCloud:
    """Drop unusable Gaussians with a warning; normalise quaternions; clip opacities.

    Raises:
        FileFormatError: none is usable.
    """
    length = np.linalg.norm(cloud.quat_wxyz, axis=1)
    usable = np.isfinite(cloud.position).all(1) & (np.abs(cloud.position) < MAX_COORDINATE).all(1)
    usable &= np.isfinite(cloud.scale).all(1) & (cloud.scale < MAX_COORDINATE).all(1)
    usable &= np.isfinite(length) & (length > 1e-6) & np.isfinite(cloud.opacity)
    usable &= np.isfinite(cloud.harmonics).all((1, 2))
    warnings = cloud.warnings
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
    """Return all clouds in one, with harmonics of the highest degree; the rest is of the first."""
    width = max(cloud.harmonics.shape[1] for cloud in clouds)

    def padded(cloud: GaussianCloud) -> F32:
        missing = width - cloud.harmonics.shape[1]
        return np.pad(cloud.harmonics, ((0, 0), (0, missing), (0, 0)))

    return replace(
        clouds[0],
        position=np.concatenate([c.position for c in clouds]),
        scale=np.concatenate([c.scale for c in clouds]),
        quat_wxyz=np.concatenate([c.quat_wxyz for c in clouds]),
        opacity=np.concatenate([c.opacity for c in clouds]),
        harmonics=np.concatenate([padded(c) for c in clouds]),
    )


def check_count(path: Path, count: int, degree: int) -> None:
    """Refuse counts and degrees that no reader should allocate memory for.

    Raises:
        FileFormatError: too many; names the number and the valid ones.
    """
    if not 1 <= count <= MAX_SPLATS:
        raise FileFormatError(path, f"declares {count:,} Gaussians; valid: 1 to {MAX_SPLATS:,}")
    if not 0 <= degree <= MAX_DEGREE:
        raise FileFormatError(path, f"harmonics of degree {degree}; valid: 0 to {MAX_DEGREE}")


def covariances(cloud: GaussianCloud) -> F32:
    """Return the covariances (N, 6) as xx, xy, xz, yy, yz, zz [units²], in blocks of memory."""
    out = np.empty((len(cloud), 6), dtype=np.float32)
    for first in range(0, len(cloud), 1 << 18):
        part = slice(first, first + (1 << 18))
        axes = quat_to_matrix(cloud.quat_wxyz[part]) * cloud.scale[part, None, :]
        full = axes @ np.swapaxes(axes, 1, 2)
        out[part] = full[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    return out


def _product(left_wxyz: ArrayLike, right_wxyz: ArrayLike) -> F32:
    a, b, c, d = np.moveaxis(np.asarray(left_wxyz, dtype=np.float64), -1, 0)
    w, x, y, z = np.moveaxis(np.asarray(right_wxyz, dtype=np.float64), -1, 0)
    product = [
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    ]
    return np.stack(product, axis=-1).astype(np.float32)
