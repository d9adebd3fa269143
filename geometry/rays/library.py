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
from numba import types
from numba.core.typing.templates import signature

from ...formats.core.errors import VlnpeError
from ...formats.process.kernel import inlined

_CALL = signature(types.void, types.uintp, types.uintp, types.uintp, types.uintp)


def _external(name: str) -> Any:
    return types.ExternalFunction(name, _CALL)


intersect16, occluded16 = _external("rtcIntersect16"), _external("rtcOccluded16")
intersect8, occluded8 = _external("rtcIntersect8"), _external("rtcOccluded8")
intersect4, occluded4 = _external("rtcIntersect4"), _external("rtcOccluded4")

# RTC_DEVICE_PROPERTY_NATIVE_RAY<N>_SUPPORTED by packet size.
_NATIVE = {16: 34, 8: 33}


@functools.cache
def library() -> ctypes.CDLL:
    """Load the Embree 4 library that embreex brings, and make it known to compiled kernels.

    Raises:
        VlnpeError: the library is neither where embreex's wheels put it nor in the system.
    """
    package = Path(embreex.__file__).parent
    folders = (package.parent / "embreex.libs", package / ".dylibs")
    files = [file for folder in folders for file in sorted(folder.glob("libembree4*"))]
    path = str(files[0]) if files else ctypes.util.find_library("embree4")
    if path is None:
        raise VlnpeError(
            f"Embree 4 not found: neither beside {package} nor in the system; "
            "install the wheel of embreex, or libembree4"
        )
    llvm.load_library_permanently(path)
    lib = ctypes.CDLL(path)
    pointer, size = ctypes.c_void_p, ctypes.c_size_t
    number, unsigned = ctypes.c_int, ctypes.c_uint
    prototypes: dict[str, tuple[Any, list[Any]]] = {
        "rtcNewDevice": (pointer, [ctypes.c_char_p]),
        "rtcGetDeviceProperty": (ctypes.c_ssize_t, [pointer, number]),
        "rtcGetDeviceError": (number, [pointer]),
        "rtcNewScene": (pointer, [pointer]),
        "rtcReleaseScene": (None, [pointer]),
        "rtcNewGeometry": (pointer, [pointer, number]),
        "rtcReleaseGeometry": (None, [pointer]),
        "rtcSetNewGeometryBuffer": (pointer, [pointer, number, unsigned, number, size, size]),
        "rtcCommitGeometry": (None, [pointer]),
        "rtcAttachGeometry": (unsigned, [pointer, pointer]),
        "rtcCommitScene": (None, [pointer]),
    }
    for name, (result, arguments) in prototypes.items():
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


@inlined()
def call_intersect(lanes_, valid, scene, rays, arguments):
    """Trace one packet of 16, 8 or 4 rays; arguments are addresses."""
    if lanes_ == 16:
        intersect16(valid, scene, rays, arguments)
    elif lanes_ == 8:
        intersect8(valid, scene, rays, arguments)
    else:
        intersect4(valid, scene, rays, arguments)


@inlined()
def call_occluded(lanes_, valid, scene, rays, arguments):
    """Test the rays of one packet for occlusion; `FAR` of occluded rays becomes −inf."""
    if lanes_ == 16:
        occluded16(valid, scene, rays, arguments)
    elif lanes_ == 8:
        occluded8(valid, scene, rays, arguments)
    else:
        occluded4(valid, scene, rays, arguments)
