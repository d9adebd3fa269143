"""The splats of a repaired scene: arrays in the world frame, in 16-bit steps where these suffice.

splats.npz
  position   (N, 3) float32 world [m]
  log_scale  (N, 3) float16 logarithm of the standard deviations [m]
  quat_wxyz  (N, 4) int16, 32767 = 1
  opacity    (N,) uint16, 65535 = 1
  harmonics  (N, K, 3) float16, coefficients as in 3DGS
  antialiased  () bool
"""

from pathlib import Path
from typing import Any

import numpy as np

from ..core.atomic import atomic_file
from ..core.errors import FileFormatError
from ..untrusted.arrays import read_arrays
from .record import GaussianCloud

SPLATS_NAME = "splats.npz"
ONE16, ONE_U16 = 32767, 65535
LEAST_SCALE_M = 1e-6


def save_splats(folder: Path, cloud: GaussianCloud) -> None:
    """Write the splats of the scene in `folder`, in world coordinates."""
    with atomic_file(folder / SPLATS_NAME) as temporary, temporary.open("wb") as stream:
        np.savez(
            stream,
            position=cloud.position,
            log_scale=np.log(np.maximum(cloud.scale, LEAST_SCALE_M)).astype(np.float16),
            quat_wxyz=np.rint(cloud.quat_wxyz * ONE16).astype(np.int16),
            opacity=np.rint(cloud.opacity * ONE_U16).astype(np.uint16),
            harmonics=np.clip(cloud.harmonics, -60000, 60000).astype(np.float16),
            antialiased=np.bool_(cloud.antialiased),
        )


def load_splats(folder: Path) -> GaussianCloud:
    """Read the splats of the scene in `folder`."""
    path = folder / SPLATS_NAME
    if not path.is_file():
        raise FileFormatError(path, "missing: this scene has no Gaussian splats")
    data: dict[str, Any] = read_arrays(path)
    try:
        cloud = GaussianCloud(
            position=data["position"],
            scale=np.exp(data["log_scale"].astype(np.float32)),
            quat_wxyz=data["quat_wxyz"].astype(np.float32) / ONE16,
            opacity=data["opacity"].astype(np.float32) / ONE_U16,
            harmonics=data["harmonics"].astype(np.float32),
            antialiased=bool(data["antialiased"]),
        )
    except (KeyError, ValueError) as error:
        raise FileFormatError(path, f"damaged splats: {error}") from error
    count = len(cloud.position)
    parts = (cloud.scale, cloud.quat_wxyz, cloud.opacity, cloud.harmonics)
    if any(len(part) != count for part in parts) or cloud.harmonics.ndim != 3:
        raise FileFormatError(path, "damaged splats: arrays of different lengths")
    return cloud


def has_splats(folder: Path) -> bool:
    """Return whether the scene in `folder` has splats."""
    return (folder / SPLATS_NAME).is_file()
