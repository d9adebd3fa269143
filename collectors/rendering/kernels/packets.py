"""Embree's packets of rays: sixteen neighbouring rays share one walk through the ray structure.

`embreex` brings the Embree library and its one-ray call; for rays of a picture, which run close
together, the library's packet calls with the coherent flag take a third of the time and give the
same hits (Wald et al., "Embree: A Kernel Framework for Efficient CPU Ray Tracing", 2014). They are
called here through Embree 4's C interface, from kernels that numba compiles.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import functools
import weakref
from pathlib import Path
from typing import Any, NamedTuple

import embreex
import llvmlite.binding as llvm
import llvmlite.ir as ir
import numpy as np
from numba import njit, types
from numba.core import cgutils
from numba.core.typing.templates import signature
from numba.extending import intrinsic
from numpy.typing import NDArray

from ....formats.core.errors import VlnpeError
from ....formats.core.kernel import kernel

F32 = NDArray[np.float32]
I32 = NDArray[np.int32]

_CALL = signature(types.void, types.uintp, types.uintp, types.uintp, types.uintp)
intersect16: Any = types.ExternalFunction("rtcIntersect16", _CALL)
intersect8: Any = types.ExternalFunction("rtcIntersect8", _CALL)
intersect4: Any = types.ExternalFunction("rtcIntersect4", _CALL)
occluded16: Any = types.ExternalFunction("rtcOccluded16", _CALL)
occluded8: Any = types.ExternalFunction("rtcOccluded8", _CALL)
occluded4: Any = types.ExternalFunction("rtcOccluded4", _CALL)

# Rows of a packet of rays and hits, each as long as the packet (RTCRayHit16 and its kin).
ORIGIN, NEAR, DIRECTION, TIME, FAR, MASK, RAY_ID, RAY_FLAGS = 0, 3, 4, 7, 8, 9, 10, 11
NORMAL, HIT_U, HIT_V, PRIM, GEOM = 12, 15, 16, 17, 18
PACKET_ROWS = 24  # of which Embree uses 21
TILES = {16: (4, 4), 8: (4, 2), 4: (2, 2)}

_VERTICES, _INDICES, _FLOAT3, _UINT3 = 1, 0, 0x9003, 0x5003
_TRIANGLES = 0
_NATIVE = {16: 34, 8: 33, 4: 32}
_COHERENT = 1 << 16


@functools.cache
def library() -> ctypes.CDLL:
    """The Embree 4 library that embreex brings, also made known to compiled kernels.

    Raises:
        VlnpeError: it is not where embreex's wheels put it, nor in the system.
    """
    package = Path(embreex.__file__).parent
    found = [
        *sorted((package.parent / "embreex.libs").glob("libembree4*")),
        *sorted((package / ".dylibs").glob("libembree4*")),
    ]
    path = str(found[0]) if found else ctypes.util.find_library("embree4")
    if path is None:
        raise VlnpeError(
            f"Embree 4 not found: neither beside {package} nor in the system; "
            "install the wheel of embreex, or libembree4"
        )
    llvm.load_library_permanently(path)
    lib = ctypes.CDLL(path)
    pointer, size = ctypes.c_void_p, ctypes.c_size_t
    for name, result, arguments in (
        ("rtcNewDevice", pointer, [ctypes.c_char_p]),
        ("rtcGetDeviceProperty", ctypes.c_ssize_t, [pointer, ctypes.c_int]),
        ("rtcGetDeviceError", ctypes.c_int, [pointer]),
        ("rtcNewScene", pointer, [pointer]),
        ("rtcReleaseScene", None, [pointer]),
        ("rtcNewGeometry", pointer, [pointer, ctypes.c_int]),
        ("rtcReleaseGeometry", None, [pointer]),
        (
            "rtcSetNewGeometryBuffer",
            pointer,
            [pointer, ctypes.c_int, ctypes.c_uint, ctypes.c_int, size, size],
        ),
        ("rtcCommitGeometry", None, [pointer]),
        ("rtcAttachGeometry", ctypes.c_uint, [pointer, pointer]),
        ("rtcCommitScene", None, [pointer]),
    ):
        function = getattr(lib, name)
        function.restype, function.argtypes = result, arguments
    return lib


@functools.cache
def _device() -> int:
    device = library().rtcNewDevice(b"threads=1")
    if not device:
        raise VlnpeError("Embree cannot start on this processor")
    return int(device)


@functools.cache
def lanes() -> int:
    """Rays per packet that this processor takes at once: 16, 8 or 4."""
    lib, device = library(), _device()
    return next((n for n in (16, 8) if lib.rtcGetDeviceProperty(device, _NATIVE[n])), 4)


class PacketHits(NamedTuple):
    """What N rays met.

    Attributes:
        prim: (N,) int32 triangle, −1 = none.
        u, v: (N,) barycentric coordinates of the second and third corner.
        depth: (N,) ray parameter.
        normal: (N, 3) of the triangle, any length and side.
    """

    prim: I32
    u: F32
    v: F32
    depth: F32
    normal: F32


class PacketScene:
    """The ray structure of one triangle mesh.

    Attributes:
        handle: address of Embree's scene, for kernels.
        coherent, incoherent: arguments of a packet call, for rays close together or not.
    """

    def __init__(self, vertices: NDArray[np.floating], faces: NDArray[np.integer]):
        """Copy vertices (V, 3) [m] and faces (F, 3), and build."""
        library_ = library()
        self.handle = int(library_.rtcNewScene(_device()))
        weakref.finalize(self, library_.rtcReleaseScene, self.handle)
        geometry = library_.rtcNewGeometry(_device(), _TRIANGLES)
        for kind, layout, array in (
            (_VERTICES, _FLOAT3, np.ascontiguousarray(vertices, dtype=np.float32)),
            (_INDICES, _UINT3, np.ascontiguousarray(faces, dtype=np.uint32)),
        ):
            target = library_.rtcSetNewGeometryBuffer(geometry, kind, 0, layout, 12, len(array))
            if target is None:
                raise VlnpeError(f"Embree takes no mesh of {len(vertices)} vertices")
            ctypes.memmove(target, array.ctypes.data, array.nbytes)
        library_.rtcCommitGeometry(geometry)
        library_.rtcAttachGeometry(self.handle, geometry)
        library_.rtcReleaseGeometry(geometry)
        library_.rtcCommitScene(self.handle)
        self.coherent, self.incoherent = _arguments(_COHERENT), _arguments(0)

    def trace(self, origins: F32, directions: F32, far: F32, coherent: bool = True) -> PacketHits:
        """First hits of N rays.

        Args:
            origins: (N, 3) [m].
            directions: (N, 3), any length.
            far: (N,) largest ray parameter; unchanged where nothing is hit.
            coherent: whether neighbours in the list run close together.
        """
        count = len(directions)
        hits = PacketHits(
            np.empty(count, dtype=np.int32),
            np.zeros(count, dtype=np.float32),
            np.zeros(count, dtype=np.float32),
            np.array(far, dtype=np.float32),
            np.zeros((count, 3), dtype=np.float32),
        )
        arguments = self.coherent if coherent else self.incoherent
        _trace(
            self.handle, arguments, packet(), lanes(),
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32), hits,
        )  # fmt: skip
        return hits

    def hidden(self, origins: F32, directions: F32) -> NDArray[np.bool_]:
        """(N,) whether something lies between origin and origin + direction."""
        out = np.empty(len(directions), dtype=np.bool_)
        _hidden(self.handle, self.coherent, packet(), lanes(), origins, directions, out)
        return out


def packet() -> F32:
    """Room for one packet, aligned as Embree wants it: (PACKET_ROWS + 1) · 16 float32.

    The last row is the mask of lanes in use.
    """
    return aligned(((PACKET_ROWS + 1) * 16,))


def aligned(shape: tuple[int, ...]) -> F32:
    """Zeros (float32) that begin at a multiple of 64 bytes."""
    size = int(np.prod(shape)) * 4
    room = np.zeros(size + 64, dtype=np.uint8)
    start = -room.ctypes.data % 64
    return room[start : start + size].view(np.float32).reshape(shape)


def _arguments(flags: int) -> I32:
    """RTCIntersectArguments: flags, all features, no callbacks."""
    values = np.zeros(16, dtype=np.int32)
    values[:2] = flags, -1
    return values


@intrinsic
def _prefetch(typingctx, address):
    """Ask the processor to fetch the line at an address (uintp) while other work goes on."""

    def generate(context, builder, signature_, arguments):
        number, pointer = ir.IntType(32), ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer, number, number, number])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        line = builder.inttoptr(arguments[0], pointer)
        read, keep, data = (ir.Constant(number, value) for value in (0, 3, 1))
        builder.call(function, [line, read, keep, data])
        return context.get_dummy_value()

    return types.void(types.uintp), generate


prefetch: Any = _prefetch


@njit(inline="always")
def call_intersect(lanes_, valid, scene, rays, arguments):
    """Trace one packet of 16, 8 or 4 rays (addresses)."""
    if lanes_ == 16:
        intersect16(valid, scene, rays, arguments)
    elif lanes_ == 8:
        intersect8(valid, scene, rays, arguments)
    else:
        intersect4(valid, scene, rays, arguments)


@njit(inline="always")
def call_occluded(lanes_, valid, scene, rays, arguments):
    """Ask for one packet whether anything is in the way; its `FAR` becomes −inf where so."""
    if lanes_ == 16:
        occluded16(valid, scene, rays, arguments)
    elif lanes_ == 8:
        occluded8(valid, scene, rays, arguments)
    else:
        occluded4(valid, scene, rays, arguments)


@kernel()
def _trace(scene, arguments, rays, lanes_, origins, directions, hits):
    bits = rays.view(np.int32)
    valid = np.int64(PACKET_ROWS * 16)
    for first in range(0, len(directions), lanes_):
        for k in range(lanes_):
            i = min(first + k, len(directions) - 1)
            bits[valid + k] = -1 if first + k < len(directions) else 0
            for axis in range(3):
                rays[(ORIGIN + axis) * lanes_ + k] = origins[i, axis]
                rays[(DIRECTION + axis) * lanes_ + k] = directions[i, axis]
            rays[NEAR * lanes_ + k] = 0.0
            rays[TIME * lanes_ + k] = 0.0
            rays[FAR * lanes_ + k] = hits.depth[i]
            bits[MASK * lanes_ + k] = -1
            bits[RAY_FLAGS * lanes_ + k] = 0
            bits[GEOM * lanes_ + k] = -1
        call_intersect(
            lanes_, rays.ctypes.data + 4 * valid, scene, rays.ctypes.data, arguments.ctypes.data
        )
        for k in range(min(lanes_, len(directions) - first)):
            i = first + k
            if bits[GEOM * lanes_ + k] == -1:
                hits.prim[i] = -1
                continue
            hits.prim[i] = bits[PRIM * lanes_ + k]
            hits.depth[i] = rays[FAR * lanes_ + k]
            hits.u[i] = rays[HIT_U * lanes_ + k]
            hits.v[i] = rays[HIT_V * lanes_ + k]
            for axis in range(3):
                hits.normal[i, axis] = rays[(NORMAL + axis) * lanes_ + k]


@kernel()
def _hidden(scene, arguments, rays, lanes_, origins, directions, out):
    bits = rays.view(np.int32)
    valid = np.int64(PACKET_ROWS * 16)
    for first in range(0, len(directions), lanes_):
        for k in range(lanes_):
            i = min(first + k, len(directions) - 1)
            bits[valid + k] = -1 if first + k < len(directions) else 0
            for axis in range(3):
                rays[(ORIGIN + axis) * lanes_ + k] = origins[i, axis]
                rays[(DIRECTION + axis) * lanes_ + k] = directions[i, axis]
            rays[NEAR * lanes_ + k] = 0.0
            rays[TIME * lanes_ + k] = 0.0
            rays[FAR * lanes_ + k] = 1.0
            bits[MASK * lanes_ + k] = -1
            bits[RAY_FLAGS * lanes_ + k] = 0
        call_occluded(
            lanes_, rays.ctypes.data + 4 * valid, scene, rays.ctypes.data, arguments.ctypes.data
        )
        for k in range(min(lanes_, len(directions) - first)):
            out[first + k] = rays[FAR * lanes_ + k] < 0.0
