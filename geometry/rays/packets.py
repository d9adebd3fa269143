"""Packets of neighbouring rays that share one walk through Embree's ray structure."""

import ctypes
import weakref
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...formats.core.arrays import F32, I32, Floats, Mask
from ...formats.core.errors import VlnpeError
from ...formats.process.kernel import inlined, kernel
from .library import call_intersect, call_occluded, device, lanes, library

f32 = np.float32

# Rows of a packet of rays and hits, each as long as the packet (RTCRayHit16 and similar).
ORIGIN, NEAR, DIRECTION, TIME, FAR, MASK, RAY_ID, RAY_FLAGS = 0, 3, 4, 7, 8, 9, 10, 11
NORMAL, HIT_U, HIT_V, PRIM, GEOM = 12, 15, 16, 17, 18
PACKET_ROWS = 24  # of which Embree uses 21
VALID = PACKET_ROWS * 16  # where the mask of active lanes starts
# Columns and rows of the image tile whose rays make a packet.
TILES = {16: (4, 4), 8: (4, 2), 4: (2, 2)}

_VERTICES, _INDICES, _FLOAT3, _UINT3 = 1, 0, 0x9003, 0x5003
_TRIANGLES = 0
_COHERENT = 1 << 16


class PacketHits(NamedTuple):
    """First hits of N rays.

    Attributes:
        prim: (N,) int32 index of the triangle, −1 = none.
        u, v: (N,) barycentric coordinates of the second and third corner.
        depth: (N,) ray parameter.
        normal: (N, 3) normal of the triangle, of any length, on either side.
    """

    prim: I32
    u: F32
    v: F32
    depth: F32
    normal: F32

    @property
    def bary(self) -> F32:
        """Return the weights (N, 2) of the triangles' second and third corners."""
        return np.stack([self.u, self.v], axis=1)


class PacketScene:
    """The ray structure of one triangle mesh.

    Attributes:
        handle: address of Embree's scene, for kernels.
        arguments: RTCIntersectArguments of a packet call, for kernels.
    """

    def __init__(self, vertices: Floats, faces: NDArray[np.integer]):
        """Copy vertices (V, 3) [m] and faces (F, 3), and build the ray structure."""
        library_ = library()
        self.handle = int(library_.rtcNewScene(device()))
        weakref.finalize(self, library_.rtcReleaseScene, self.handle)
        geometry = library_.rtcNewGeometry(device(), _TRIANGLES)
        for kind, layout, array in (
            (_VERTICES, _FLOAT3, np.ascontiguousarray(vertices, dtype=np.float32)),
            (_INDICES, _UINT3, np.ascontiguousarray(faces, dtype=np.uint32)),
        ):
            target = library_.rtcSetNewGeometryBuffer(geometry, kind, 0, layout, 12, len(array))
            if target is None:
                raise VlnpeError(f"Embree cannot allocate a mesh of {len(vertices)} vertices")
            ctypes.memmove(target, array.ctypes.data, array.nbytes)
        library_.rtcCommitGeometry(geometry)
        library_.rtcAttachGeometry(self.handle, geometry)
        library_.rtcReleaseGeometry(geometry)
        library_.rtcCommitScene(self.handle)
        # Flags; all features; no callbacks.
        self.arguments, self._scattered = np.zeros((2, 16), dtype=np.int32)
        self.arguments[:2], self._scattered[:2] = (_COHERENT, -1), (0, -1)

    @staticmethod
    def of_corners(corners: Floats) -> "PacketScene":
        """Build the ray structure of loose triangles (F, 3, 3) [m]."""
        return PacketScene(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))

    def trace(
        self, *, origins: Floats, directions: Floats, far: F32, coherent: bool = True
    ) -> PacketHits:
        """Return the first hits of N rays.

        Args:
            origins: (N, 3) [m].
            directions: (N, 3), any length.
            far: (N,) largest ray parameter; returned as depth where nothing is hit.
            coherent: neighbours in the list run close together. It only changes the time taken.
        """
        count = len(directions)
        hits = PacketHits(
            np.empty(count, dtype=np.int32),
            np.zeros(count, dtype=np.float32),
            np.zeros(count, dtype=np.float32),
            np.array(far, dtype=np.float32),
            np.zeros((count, 3), dtype=np.float32),
        )
        _trace(
            self.handle, self.arguments if coherent else self._scattered, packet(), lanes(),
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32), hits,
        )  # fmt: skip
        return hits

    def occluded(self, *, origins: Floats, directions: Floats) -> Mask:
        """Return (N,) whether something lies between origin and origin + direction, (N, 3) [m]."""
        out = np.empty(len(directions), dtype=np.bool_)
        _occluded(
            self.handle, self.arguments, packet(), lanes(),
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32), out,
        )  # fmt: skip
        return out


def tile_order(size_px: tuple[int, int], *, tile_px: tuple[int, int]) -> I32:
    """Return the pixels (row-major indices) of an image tile by tile, −1 = none.

    The rays of a tile are closest together, so that they make the best packets. Sizes are
    (width, height) of the image and (columns, rows) of a tile.
    """
    width, height = size_px
    across, down = tile_px
    rows = np.arange(-(-height // down) * down)
    columns = np.arange(-(-width // across) * across)
    index = np.where(
        (rows[:, None] < height) & (columns < width), rows[:, None] * width + columns, -1
    )
    tiles = index.reshape(len(rows) // down, down, len(columns) // across, across)
    return np.ascontiguousarray(tiles.swapaxes(1, 2)).ravel().astype(np.int32)


def packet() -> F32:
    """Return memory for one packet, aligned for Embree: ((PACKET_ROWS + 1) · 16,) float32.

    The last row is the mask of active lanes.
    """
    return aligned(((PACKET_ROWS + 1) * 16,))


def aligned(shape: tuple[int, ...]) -> F32:
    """Return float32 zeros whose memory starts at a multiple of 64 bytes."""
    size = int(np.prod(shape)) * 4
    room = np.zeros(size + 64, dtype=np.uint8)
    start = -room.ctypes.data % 64
    return room[start : start + size].view(np.float32).reshape(shape)


@inlined()
def fill_ray(rays, bits, n, k, x, y, z, dx, dy, dz, far):
    """Write a ray into lane `k` of a packet of `n` rays, and activate the lane.

    Args:
        rays, bits: the packet, see `packet`, and the same memory as int32.
        x, y, z: origin [m].
        dx, dy, dz: direction.
        far: largest ray parameter.
    """
    bits[VALID + k] = -1
    rays[ORIGIN * n + k] = x
    rays[(ORIGIN + 1) * n + k] = y
    rays[(ORIGIN + 2) * n + k] = z
    rays[DIRECTION * n + k] = dx
    rays[(DIRECTION + 1) * n + k] = dy
    rays[(DIRECTION + 2) * n + k] = dz
    rays[NEAR * n + k] = f32(0.0)
    rays[TIME * n + k] = f32(0.0)
    rays[FAR * n + k] = far
    bits[MASK * n + k] = -1
    bits[RAY_FLAGS * n + k] = 0


@inlined()
def fill_list(rays, bits, n, first, origins, directions, far):
    """Write rays `first` to `first + n` of a list into a packet; `far` is (N,)."""
    for k in range(n):
        i = min(first + k, len(directions) - 1)
        fill_ray(
            rays, bits, n, k,
            origins[i, 0], origins[i, 1], origins[i, 2],
            directions[i, 0], directions[i, 1], directions[i, 2], far[i],
        )  # fmt: skip
        bits[GEOM * n + k] = -1
        if first + k >= len(directions):
            bits[VALID + k] = 0


@kernel(3)
def _trace(scene, arguments, rays, n, origins, directions, hits):
    bits = rays.view(np.int32)
    valid = rays.ctypes.data + 4 * VALID
    for first in range(0, len(directions), n):
        fill_list(rays, bits, n, first, origins, directions, hits.depth)
        call_intersect(n, valid, scene, rays.ctypes.data, arguments.ctypes.data)
        for k in range(min(n, len(directions) - first)):
            i = first + k
            if bits[GEOM * n + k] == -1:
                hits.prim[i] = -1
                continue
            hits.prim[i] = bits[PRIM * n + k]
            hits.depth[i] = rays[FAR * n + k]
            hits.u[i] = rays[HIT_U * n + k]
            hits.v[i] = rays[HIT_V * n + k]
            for axis in range(3):
                hits.normal[i, axis] = rays[(NORMAL + axis) * n + k]


@kernel(3)
def _occluded(scene, arguments, rays, n, origins, directions, out):
    bits = rays.view(np.int32)
    valid = rays.ctypes.data + 4 * VALID
    far = np.ones(len(directions), dtype=np.float32)
    for first in range(0, len(directions), n):
        fill_list(rays, bits, n, first, origins, directions, far)
        call_occluded(n, valid, scene, rays.ctypes.data, arguments.ctypes.data)
        for k in range(min(n, len(directions) - first)):
            out[first + k] = rays[FAR * n + k] < 0.0
