"""What kernels call is optimised by LLVM inside of the kernels, and nowhere else.

numba brings every function that a kernel calls to machine code, its own (`numpy.empty`, `max`, …)
as well as ours, though kernels take in their intermediate code and nobody runs the other.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import config
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import cpu_target

_settings: Any = config
_ASKED = _settings.OPT  # by the environment; 3 unless a person looks for a mistake


class KernelCompiler(Compiler):
    """numba's compiler for a kernel, which leaves what it calls to the kernel's optimisation."""

    def compile_extra(self, func: Any) -> Any:
        """Compile a function."""
        self.state.library = _Whole(self.state.targetctx.codegen(), func.__qualname__)
        self.state.library.enable_object_caching()
        with libraries(_Part, int(_settings.OPT)):
            return super().compile_extra(func)


@contextmanager
def libraries(kind: type[JITCodeLibrary], level: int) -> Iterator[None]:
    """Let numba make libraries of code of a kind, and LLVM optimise them at most at a level.

    The caller holds numba's lock.
    """
    target: Any = cpu_target
    codegen = target.target_context.codegen()
    before = codegen._library_class, _settings.OPT
    codegen._library_class, _settings.OPT = kind, type(_ASKED)(min(level, _ASKED))
    try:
        yield
    finally:
        codegen._library_class, _settings.OPT = before


class _Whole(JITCodeLibrary):
    """The code of a kernel."""

    def _optimize_functions(self, ll_module: Any) -> None:
        """Leave functions as they are below level 3: a kernel's own optimisation repeats this."""
        if _settings.OPT < 3:
            ll_module.data_layout = self._codegen._data_layout
        else:
            super()._optimize_functions(ll_module)


class _Part(_Whole):
    """Intermediate code for kernels to take in; it has no address."""

    def finalize(self) -> None:
        """Take in the code of what is called, and leave all else to the kernels."""
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0, numba's address of a function that has no code."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        """What numba asks to write a function's environment into its code."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: a kernel's code has its own."""
