"""Embree 4 for kernels: the library that embreex brings, and its calls for packets of rays.

`embreex` offers calls for single rays; for the rays of a picture, which run close together, the
library's packet calls with the coherent flag take a third of the time and give the same hits
(Wald et al., "Embree: A Kernel Framework for Efficient CPU Ray Tracing", 2014). They are called
here through Embree's C interface, from kernels that numba compiles.
"""

import ctypes
import ctypes.util
import functools
from pathlib import Path
from typing import Any

import embreex
import llvmlite.binding as llvm
from numba import njit, types
from numba.core.typing.templates import signature

from ...formats.core.errors import VlnpeError

_CALL = signature(types.void, types.uintp, types.uintp, types.uintp, types.uintp)
intersect16: Any = types.ExternalFunction("rtcIntersect16", _CALL)
intersect8: Any = types.ExternalFunction("rtcIntersect8", _CALL)
intersect4: Any = types.ExternalFunction("rtcIntersect4", _CALL)
occluded16: Any = types.ExternalFunction("rtcOccluded16", _CALL)
occluded8: Any = types.ExternalFunction("rtcOccluded8", _CALL)
occluded4: Any = types.ExternalFunction("rtcOccluded4", _CALL)

# RTC_DEVICE_PROPERTY_NATIVE_RAY<N>_SUPPORTED by packet size.
_NATIVE = {16: 34, 8: 33}


@functools.cache
def library() -> ctypes.CDLL:
    """Load the Embree 4 library that embreex brings, and make it known to compiled kernels.

    Raises:
        VlnpeError: the library is neither where embreex's wheels put it nor in the system.
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
def device() -> int:
    """Return the address of this process's Embree device.

    Raises:
        VlnpeError: Embree does not run on this processor.
    """
    handle = library().rtcNewDevice(b"threads=1")
    if not handle:
        raise VlnpeError("Embree does not run on this processor")
    return int(handle)


@functools.cache
def lanes() -> int:
    """Return how many rays this processor traces per packet: 16, 8 or 4."""
    return next((n for n in _NATIVE if library().rtcGetDeviceProperty(device(), _NATIVE[n])), 4)


@njit(inline="always")
def call_intersect(lanes_, valid, scene, rays, arguments):
    """Trace one packet of 16, 8 or 4 rays; arguments are addresses."""
    if lanes_ == 16:
        intersect16(valid, scene, rays, arguments)
    elif lanes_ == 8:
        intersect8(valid, scene, rays, arguments)
    else:
        intersect4(valid, scene, rays, arguments)


@njit(inline="always")
def call_occluded(lanes_, valid, scene, rays, arguments):
    """Test the rays of one packet for occlusion; `FAR` of occluded rays becomes −inf."""
    if lanes_ == 16:
        occluded16(valid, scene, rays, arguments)
    elif lanes_ == 8:
        occluded8(valid, scene, rays, arguments)
    else:
        occluded4(valid, scene, rays, arguments)
