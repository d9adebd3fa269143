"""Jobs and workers for tests of the runner; at module level, because workers are spawned."""

import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vlnpe.formats.core.atomic import atomic_file
from vlnpe.formats.core.errors import FileFormatError, SceneError
from vlnpe.pipeline.execution.processes import Workers
from vlnpe.pipeline.execution.parts import telling
from vlnpe.pipeline.engine.work import ItemResult


class InlineWorkers(Workers):
    """Runs items in this process, as they come."""

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future


@dataclass(frozen=True)
class Call:
    """A job that calls one of the functions below."""

    function: Callable[..., ItemResult]
    arguments: tuple[Any, ...]

    def run(self) -> ItemResult:
        return self.function(*self.arguments)


def write(path: Path, text: str) -> ItemResult:
    with atomic_file(path) as temporary:
        temporary.write_text(text)
    return ItemResult({"length": len(text)}, failed=text == "fell")


def compiled(path: Path) -> ItemResult:
    """Write a file after compiling a function, in a process that has the kernels' module."""
    import numba

    import vlnpe.formats.process.kernel  # noqa: F401 (it listens to numba)

    double: Any = numba.njit(lambda x: x + x)
    return write(path, str(double(1)))


def imported(name: str, once: Path | None = None) -> bool:
    """Return whether this worker has a module, as soon as the file `once` is there."""
    while once is not None and not once.exists():
        time.sleep(0.05)
    return name in sys.modules


def refuse(path: Path) -> ItemResult:
    raise SceneError(f"{path.name} has no floor")


class StubbornError(Exception):
    """Cannot be pickled back, as many a library's errors."""

    def __init__(self, first: str, second: str):
        super().__init__(first + second)


def refuse_stubbornly(path: Path) -> ItemResult:
    raise StubbornError("not ", "portable")


def misread(path: Path) -> ItemResult:
    raise FileFormatError(path, "no mesh")


def crash(path: Path) -> ItemResult:
    raise ZeroDivisionError("a bug")


def write_half(path: Path) -> ItemResult:
    with atomic_file(path) as temporary:
        temporary.write_text("half")
        raise ValueError("broke in the middle")


def run_out_of_memory(path: Path) -> ItemResult:
    raise MemoryError


def linger(path: Path, seconds: float) -> ItemResult:
    """Write half a file, and the rest after a while; beside it stands which process does."""
    with atomic_file(path) as temporary:
        temporary.write_text("half")
        process = path.with_suffix(".process")
        process.write_text(str(os.getpid()))
        process.rename(path.with_suffix(".pid"))  # whole as soon as a test finds it
        time.sleep(seconds)
    return ItemResult()


def tell(path: Path, part: float, seconds: float) -> ItemResult:
    """Tell how much is done, and write the file after a while."""
    with telling(path) as how_much:
        how_much(part)
        time.sleep(seconds)
    return write(path, "done")


def die(path: Path) -> ItemResult:
    os._exit(9)


def fill_disk(path: Path) -> ItemResult:
    raise OSError(28, "No space left on device", str(path))


def write_late(path: Path, text: str, seconds: float, started: Path | None = None) -> ItemResult:
    if started is not None:
        started.touch()
    time.sleep(seconds)
    return write(path, text)
