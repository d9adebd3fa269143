"""Read untrusted files in a child process with resource limits.

Libraries in C++ crash, hang, or take all memory on damaged files. Here they may: only the child
ends, and the parent says why.
"""

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...formats.core.errors import FileFormatError, InputError
from .readings import ANSWER, Readings, load_readings, write_readings

MEMORY_BYTES = 4 << 30
# Sound files of 1,000,000 triangles take some seconds, also on a busy machine.
SECONDS, SECONDS_PER_MIB = 60.0, 1.0
READERS = ("usd", "points")
# Variables that would have USD look for files or plugins elsewhere.
HIDDEN_VARIABLES = ("PXR_", "USD_", "TF_", "AR_")
ONE_THREAD = ("PXR_WORK_THREAD_LIMIT", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def read_in_child(
    reader: str, path: Path, seconds: float | None = None, memory_bytes: int = MEMORY_BYTES
) -> Readings:
    """Run a reader in `READERS` in a child process; see `run_child`."""
    return run_child((__name__, reader), path, load_readings, seconds, memory_bytes)


def run_child[T](
    reader: tuple[str, ...],
    path: Path,
    load: Callable[[dict[str, Any], Path], T],
    seconds: float | None = None,
    memory_bytes: int = MEMORY_BYTES,
) -> T:
    """Run a reader, a module and its first arguments that ends with `answer`, in a child process.

    `load` makes the result of the child's answer and the folder with its other files. The child may
    take `seconds` of wall time, None = by the file's size, and `memory_bytes` of address space.

    Raises:
        FileFormatError: the file is damaged, or reading it took too long or too much memory.
        InputError: what the reader needs is not installed.
    """
    path = path.absolute()
    if seconds is None:
        seconds = SECONDS + SECONDS_PER_MIB * path.stat().st_size / (1 << 20)
    with tempfile.TemporaryDirectory(prefix="vlnpe-read-") as folder:
        # -P: the working folder must never be a place to import from.
        command = [sys.executable, "-P", "-m", *reader, str(path), str(memory_bytes)]
        plain = {k: v for k, v in os.environ.items() if not k.startswith(HIDDEN_VARIABLES)}
        child = subprocess.Popen(
            command,
            cwd=folder,
            # USD writes a report when it crashes; with the folder it goes away.
            env={**plain, **dict.fromkeys(ONE_THREAD, "1"), "TMPDIR": folder},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        try:
            _, errors = child.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            raise FileFormatError(
                path, f"not read within {seconds:.0f} s: it is damaged or far too large"
            ) from None
        finally:
            if child.poll() is None:
                child.kill()
                child.communicate()
        data = _collected(path, Path(folder), child.returncode, errors, memory_bytes)
        return load(data, Path(folder))


def _collected(
    path: Path, folder: Path, status: int, errors: bytes, memory_bytes: int
) -> dict[str, Any]:
    written = folder / ANSWER
    if status != 0 or not written.is_file():
        lines = errors.decode(errors="replace").strip().splitlines()
        why = f"ended by {signal.Signals(-status).name}" if status < 0 else f"status {status}"
        last_lines = [line.strip() for line in lines if "FATAL" in line] or lines[-1:]
        last = f": {last_lines[0][:160]}" if last_lines else ""
        raise FileFormatError(
            path, f"its reader failed ({why}; memory limit {memory_bytes / 2**30:.3g} GiB){last}"
        )
    data = json.loads(written.read_text())
    if "missing" in data:
        raise InputError(data["missing"])
    if "error" in data:
        raise FileFormatError(data["path"], data["error"])
    return data


def answer(path: Path, memory_bytes: int, work: Callable[[Path], None]) -> None:
    """Let `work` write a child's answer within its limits; leave the reason if it fails."""
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    folder = Path.cwd()
    try:
        work(folder)
    except FileFormatError as error:
        reason = {"path": str(error.path), "error": error.reason}
        (folder / ANSWER).write_text(json.dumps(reason))
    except InputError as error:
        (folder / ANSWER).write_text(json.dumps({"missing": str(error)}))
    except MemoryError:
        reason = {"path": str(path), "error": f"needs more than {memory_bytes / 2**30:.3g} GiB"}
        (folder / ANSWER).write_text(json.dumps(reason))


def main(reader: str, path: Path, memory_bytes: int) -> None:
    """Run as the child process: read `path` and write the answer into the working folder."""
    if reader not in READERS:
        raise ValueError(f"unknown reader {reader!r}; valid: {', '.join(READERS)}")

    def work(folder: Path) -> None:
        # Each has large libraries of its own, which the other one and the parent do without.
        if reader == "usd":
            from ..usd.read_stage import read
        else:
            from .point_cloud import read
        write_readings(read(path), folder)

    answer(path, memory_bytes, work)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]))
