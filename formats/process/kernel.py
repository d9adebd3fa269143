"""Compiled kernels whose cache never outlives their source.

numba keeps compiled code beside a function's file and compares that file alone. A kernel that
calls another module's kernel, or uses its constants, would run with their former code.
"""

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import config, event
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock

from .parts import KernelCompiler, libraries
from .source import ROOT, code_digest

_compiling = event.TimingListener()
event.register("numba:compile", _compiling)

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(level: int = 2, **options: Any) -> Callable[[Function], Function]:
    """Return `numba.njit(cache=True, nogil=True, **options)`, cached for each state of the code.

    LLVM optimises it at a `level`: 3 takes a sixth longer, which what runs per ray or pixel repays.

    Other threads of Python run while a kernel does. Of several processes that call a kernel for
    the first time, one compiles it and the others wait for its cache.

    The cache is keyed by `code_digest` of the function's module: an edit of any module that it
    imports, transitively, compiles it again.
    """

    def decorate(function: Function) -> Function:
        # numba reads this variable once, while it decorates.
        settings: Any = config
        before = settings.CACHE_DIR
        folder = cache_folder() / code_digest(function.__module__)[:16]
        settings.CACHE_DIR = str(folder)
        try:
            njit: Any = numba.njit
            always = {"cache": True, "nogil": True, "no_cfunc_wrapper": True}
            dispatcher: Any = njit(pipeline_class=KernelCompiler, **always, **options)(function)
        finally:
            settings.CACHE_DIR = before
        compile_or_load = dispatcher.compile

        def compile_once(signature: Any) -> Any:
            # Kernels lock those they call while they hold their own lock; none calls itself.
            with global_compiler_lock, (folder / f"{function.__qualname__}.lock").open("w") as lock:
                with contextlib.suppress(OSError):  # a file system without locks
                    fcntl.flock(lock, fcntl.LOCK_EX)
                with libraries(JITCodeLibrary, level):
                    return compile_or_load(signature)

        dispatcher.compile = compile_once
        return cast(Function, dispatcher)

    return decorate


def compile_seconds() -> float:
    """Return the wall time in which this process has compiled kernels; loading them is no part."""
    return _compiling.duration if _compiling.done else 0.0


def called(**options: Any) -> Callable[[Function], Function]:
    """Return a decorator for a function that only kernels call: it is compiled with them."""
    njit: Any = numba.njit
    return njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)


def inlined(**options: Any) -> Callable[[Function], Function]:
    """Return a decorator for a function that LLVM puts into the code of the kernels that call it.

    numba's `inline="always"` copies the source instead, and infers the types of every copy: kernels
    then take several times as long to compile. The function must create no arrays: references to
    them are not counted.
    """
    return called(forceinline=True, _nrt=False, **options)


@cache
def cache_folder() -> Path:
    """Return the folder of all compiled kernels: beside the package if that can be written to."""
    if os.environ.get("NUMBA_CACHE_DIR"):
        return Path(os.environ["NUMBA_CACHE_DIR"])
    if os.access(ROOT, os.W_OK):
        return ROOT / "__pycache__" / "kernels"
    return Path(tempfile.gettempdir()) / f"vlnpe-kernels-{os.getuid()}"
