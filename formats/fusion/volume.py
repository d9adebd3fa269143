"""Fuse depth images into a truncated signed distance volume (Curless and Levoy, 1996)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.kernel import kernel

# In voxels: how far before and behind a surface the field is kept.
_FRONT = 3.0
_BEHIND = 2.2


@dataclass(frozen=True)
class DistanceVolume:
    """A dense field over a box.

    Attributes:
        origin_m: (3,) centre of voxel (0, 0, 0).
        voxel_m: side of a voxel.
        value: (X, Y, Z) float32 distance / truncation in −1…1, positive towards the camera.
        weight: (X, Y, Z) float32; 0 where nothing was ever seen.
    """

    origin_m: NDArray[np.float64]
    voxel_m: float
    value: NDArray[np.float32]
    weight: NDArray[np.float32]

    @staticmethod
    def empty(
        lower_m: NDArray[np.float64], upper_m: NDArray[np.float64], voxel_m: float
    ) -> "DistanceVolume":
        """Return an empty volume that covers a box."""
        shape = tuple(np.ceil((upper_m - lower_m) / voxel_m).astype(int) + 1)
        return DistanceVolume(
            np.asarray(lower_m, dtype=np.float64),
            voxel_m,
            np.zeros(shape, dtype=np.float32),
            np.zeros(shape, dtype=np.float32),
        )

    def integrate(
        self,
        depth_m: NDArray[np.float32],
        *,
        focal_px: float,
        position_m: NDArray[np.float64],
        rotation: NDArray[np.float64],
    ) -> None:
        """Add a depth image.

        Args:
            depth_m: (H, W) along the optical axis [m], 0 = nothing seen.
            position_m: (3,) optical centre, as estimated.
            rotation: (3, 3) camera (x right, y down, z forward) to world.
        """
        rows, columns = np.nonzero(depth_m > 0)
        if not len(rows):
            return
        height, width = depth_m.shape
        rays = np.stack(
            [
                (columns + 0.5 - 0.5 * width) / focal_px,
                (rows + 0.5 - 0.5 * height) / focal_px,
                np.ones(len(rows)),
            ],
            axis=-1,
        ).astype(np.float32)
        points = rays * depth_m[rows, columns, None] @ rotation.T + position_m
        margin = 3 * self.voxel_m
        # Axis by axis: along the first of two axes numpy is many times slower.
        low = np.minimum([axis.min() for axis in points.T], position_m) - margin
        high = np.maximum([axis.max() for axis in points.T], position_m) + margin
        start = np.maximum(np.floor((low - self.origin_m) / self.voxel_m), 0).astype(np.int64)
        stop = np.minimum(
            np.ceil((high - self.origin_m) / self.voxel_m) + 1, self.value.shape
        ).astype(np.int64)
        step = rotation * self.voxel_m
        offset = (self.origin_m - position_m) @ rotation
        scale = (focal_px, self.voxel_m, float(depth_m.max()))
        _integrate(self.value, self.weight, depth_m, step, offset, scale, np.stack([start, stop]))


@kernel()
def _integrate(value, weight, depth, step, offset, scale, box):
    """Fuse a depth image into the voxels of `box`, its first and last (exclusive) index."""
    rows, columns = depth.shape
    focal, voxel, deepest = scale
    start, stop = box[0], box[1]
    front, behind = _FRONT * voxel, _BEHIND * voxel
    half_x, half_y = 0.5 * columns / focal, 0.5 * rows / focal
    farthest = deepest + behind
    for i in range(start[0], stop[0]):
        for j in range(start[1], stop[1]):
            bx = offset[0] + i * step[0, 0] + j * step[1, 0]
            by = offset[1] + i * step[0, 1] + j * step[1, 1]
            bz = offset[2] + i * step[0, 2] + j * step[1, 2]
            # The part of the column that the camera sees: six planes, each linear in k.
            first, last = float(start[2]), float(stop[2] - 1)
            for plane in range(6):
                if plane == 0:
                    a, b = bz - 0.2, step[2, 2]
                elif plane == 1:
                    a, b = farthest - bz, -step[2, 2]
                else:
                    sign = 1.0 if plane % 2 else -1.0
                    if plane < 4:
                        a = half_x * bz + sign * bx
                        b = half_x * step[2, 2] + sign * step[2, 0]
                    else:
                        a = half_y * bz + sign * by
                        b = half_y * step[2, 2] + sign * step[2, 1]
                if b > 1e-12:
                    first = max(first, -a / b)
                elif b < -1e-12:
                    last = min(last, -a / b)
                elif a < 0.0:
                    last = -1.0
            # As a comparison that NaN fails too: a loop from int(NaN) would all but never end.
            if not first <= last:
                continue
            for k in range(int(np.ceil(first)), int(np.floor(last)) + 1):
                z = bz + k * step[2, 2]
                zoom = focal / z
                u = int((bx + k * step[2, 0]) * zoom + 0.5 * columns)
                v = int((by + k * step[2, 1]) * zoom + 0.5 * rows)
                if u < 0 or v < 0 or u >= columns or v >= rows:
                    continue
                d = depth[v, u]
                gap = d - z
                if d <= 0.0 or gap < -behind:
                    continue
                w = 1.0 / max(d * d, 0.5)
                signed = min(gap / front, 1.0)
                if gap < 0.0:
                    # What lies behind a surface is a guess that fades with depth.
                    w *= max(1.0 + gap / behind, 0.2)
                elif gap > front:
                    # Rays that graze a thin thing must not carve it away.
                    w *= 0.3
                total = weight[i, j, k] + w
                value[i, j, k] += (signed - value[i, j, k]) * w / total
                weight[i, j, k] = min(total, 60.0)
