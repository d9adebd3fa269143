"""Fuse depth images into a truncated signed distance volume (Curless and Levoy, 1996)."""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import F32, Array
from ...formats.process.kernel import inlined, kernel

f32 = np.float32

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

    origin_m: Array
    voxel_m: float
    value: F32
    weight: F32

    @staticmethod
    def empty(lower_m: Array, upper_m: Array, voxel_m: float) -> "DistanceVolume":
        """Return an empty volume that covers a box."""
        shape = tuple(np.ceil((upper_m - lower_m) / voxel_m).astype(int) + 1)
        value, weight = (np.zeros(shape, dtype=np.float32) for _ in range(2))
        return DistanceVolume(np.asarray(lower_m, dtype=np.float64), voxel_m, value, weight)

    def integrate(
        self, depth_m: F32, *, focal_px: float, position_m: Array, rotation: Array
    ) -> None:
        """Add a depth image.

        Args:
            depth_m: (H, W) along the optical axis [m], 0 = nothing seen.
            position_m: (3,) optical centre, as estimated.
            rotation: (3, 3) camera (x right, y down, z forward) to world.
        """
        deepest = float(depth_m.max(initial=0.0))
        if deepest <= 0.0:
            return
        low, high = np.array(position_m, dtype=np.float64), np.array(position_m, dtype=np.float64)
        _enclose(depth_m, focal_px, rotation, position_m, low, high)
        margin = 3 * self.voxel_m
        start = np.floor((low - margin - self.origin_m) / self.voxel_m)
        stop = np.ceil((high + margin - self.origin_m) / self.voxel_m) + 1
        box = np.stack([np.maximum(start, 0), np.minimum(stop, self.value.shape)]).astype(np.int64)
        step = rotation * self.voxel_m
        offset = (self.origin_m - position_m) @ rotation
        scale = (focal_px, self.voxel_m, deepest)
        _integrate(self.value, self.weight, depth_m, step, offset, scale, box)


@kernel(3)
def _enclose(depth, focal, rotation, position, low, high):
    """Extend the box from `low` to `high` (3,) by the points that a depth image shows."""
    rows, columns = depth.shape
    for v in range(rows):
        y = (v + 0.5 - 0.5 * rows) / focal
        for u in range(columns):
            d = depth[v, u]
            if d <= 0.0:
                continue
            x = (u + 0.5 - 0.5 * columns) / focal
            for k in range(3):
                at = position[k] + d * (rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2])
                low[k], high[k] = min(low[k], at), max(high[k], at)


# By numpy's rules a division has no test for zero, which would keep loops from being vector code.
@kernel(3, error_model="numpy")
def _integrate(value, weight, depth, step, offset, scale, box):
    """Fuse a depth image into the voxels of `box`, its first and last (exclusive) index.

    A column of voxels passes through three loops: where each voxel is in the image, the depth
    there, and the sums. The first and the last become vector code, which takes half the time.
    """
    rows, columns = depth.shape
    focal, voxel, deepest = scale
    start, stop = box[0], box[1]
    front, behind = _FRONT * voxel, _BEHIND * voxel
    half_x, half_y = 0.5 * columns / focal, 0.5 * rows / focal
    farthest = deepest + behind
    image = depth.ravel()
    pixel = np.empty(value.shape[2], dtype=np.int32)
    z = np.empty(value.shape[2], dtype=np.float32)
    d = np.empty(value.shape[2], dtype=np.float32)
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
            low, high = int(np.ceil(first)), int(np.floor(last)) + 1
            ahead = (f32(bx), f32(by), f32(bz))
            along = (f32(step[2, 0]), f32(step[2, 1]), f32(step[2, 2]))
            _project(low, high - low, ahead, along, (f32(focal), columns, rows), pixel, z)
            for k in range(high - low):
                d[k] = image[np.uint32(pixel[k])]
            band = (f32(front), f32(behind))
            _add(d, z, band, value[i, j, low:high], weight[i, j, low:high])


@inlined(error_model="numpy")
def _project(low, count, ahead, along, camera, pixel, z):
    """Find pixel and depth of the `count` voxels from `low` on in a column.

    Args:
        ahead, along: voxel 0 of the column in the camera frame [m], and the step to the next.
        camera: focal length, columns and rows [px].
        pixel: index into the image's rows one after the other, written.
        z: depth along the optical axis [m], written.
    """
    focal, columns, rows = camera
    width = np.int32(columns)
    center_x, center_y = f32(0.5 * columns), f32(0.5 * rows)
    # Rounding must not lead out of the image.
    right, bottom = f32(columns - 0.01), f32(rows - 0.01)
    for k in range(count):
        n = f32(np.int32(low + k))
        depth = ahead[2] + n * along[2]
        zoom = focal / depth
        x = (ahead[0] + n * along[0]) * zoom + center_x
        y = (ahead[1] + n * along[1]) * zoom + center_y
        x, y = min(max(x, f32(0.0)), right), min(max(y, f32(0.0)), bottom)
        pixel[k] = np.int32(y) * width + np.int32(x)
        z[k] = depth


@inlined(error_model="numpy")
def _add(d, z, band, value, weight):
    """Add readings to the voxels of a column.

    Args:
        d: depth that was read at each voxel's pixel [m], 0 = none.
        z: the voxels' own depths.
        band: how far before and behind a surface the field is kept [m].
        value: the voxels' field, see `DistanceVolume`.
        weight: the voxels' weights.
    """
    front, behind = band
    per_front, per_behind = f32(1.0) / front, f32(1.0) / behind
    for k in range(len(value)):
        gap = d[k] - z[k]
        w = f32(1.0) / max(d[k] * d[k], f32(0.5))
        # What lies behind a surface is a guess that fades with depth; rays that graze a thin thing
        # must not carve it away.
        fade = max(f32(1.0) + gap * per_behind, f32(0.2))
        w *= fade if gap < f32(0.0) else f32(0.3) if gap > front else f32(1.0)
        signed = min(gap * per_front, f32(1.0))
        read = (d[k] > f32(0.0)) & (gap >= -behind)
        w = w if read else f32(0.0)
        total = weight[k] + w
        value[k] += (signed - value[k]) * w / max(total, f32(1e-9))
        weight[k] = min(total, f32(60.0))
