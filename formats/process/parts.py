"""What kernels call is optimised by LLVM inside of the kernels, and nowhere else.

numba brings every function that a kernel calls to machine code, its own (`numpy.empty`, `max`, …)
as well as ours, though kernels take in their intermediate code and nobody runs the other.
`NUMBA_DUMP_OPTIMIZED` and `NUMBA_DUMP_ASSEMBLY` therefore show kernels alone.
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
_FOR_PYTHON = "_ZN7cpython"  # how names of functions begin through which Python calls compiled ones


class KernelCompiler(Compiler):
    """numba's compiler for a kernel, which leaves what it calls to the kernel's optimisation."""

    def compile_extra(self, func: Any) -> Any:
        """Compile a function."""
        self.state.library = _Whole(self.state.targetctx.codegen(), func.__qualname__)
        self.state.library.enable_object_caching()
        with libraries(_Part, int(_settings.OPT)):
            result = super().compile_extra(func)
        for environment in result._find_referenced_environments():
            # That of a function in intermediate code has an address since now alone.
            result.codegen.set_env(environment.env_name, environment)
        return result


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
    """Intermediate code for kernels to take in; it has no address, unless Python may call it."""

    def finalize(self) -> None:
        """Take in the code of what is called, and leave all else to the kernels."""
        if any(f.name.startswith(_FOR_PYTHON) for f in self.get_defined_functions()):
            super().finalize()
            return
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()
        self._finalized = True

    @property
    def codegen(self) -> Any:
        """What numba asks to write a function's environment into its code."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Write a function's environment into its code, if it has an address of its own."""
        codegen: Any = self._codegen
        if codegen._engine.get_global_value_address(name):
            codegen.set_env(name, environment)
