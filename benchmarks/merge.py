"""What joining many units into one LeRobot dataset costs.

`python -m benchmarks.merge [UNITS …]` joins copies of a tiny unit, by default up to 100,000: what a
run of 25,000 episodes and 4 robots has. `make bench ONLY=scaling` joins some of a usual size.
"""

import os
import resource
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from tests.support.runs import tiny_run
from vlnpe.formats.lerobot import assemble_dataset

MANY = (1_000, 10_000, 100_000)
LINKS = 10_000  # copies of a file that are links to one; ext4 allows 65,000


def main(arguments: Sequence[str]) -> int:
    counts = tuple(map(int, arguments)) or MANY
    with tempfile.TemporaryDirectory(prefix="vlnpe-merge-") as folder:
        scan = tiny_run.write_scan(Path(folder) / "scan.glb")
        done = tiny_run.collect(scan, Path(folder) / "run", "--no-mcap")
        if done.returncode:
            sys.stderr.write(done.stderr)
            return done.returncode
        sys.stdout.write("\n".join(table(first_unit(Path(folder) / "run"), counts)) + "\n")
    return 0


def table(unit: Path, counts: Sequence[int]) -> list[str]:
    """Return the lines of a Markdown table."""
    return [
        "| units | CPU s | ms a unit | wall s | dataset MB | files | peak MB |",
        "| ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
        *(line(*apart(merge_cost, unit, count)) for count in counts),
    ]


def merge_cost(unit: Path, count: int) -> tuple[Any, ...]:
    """Join `count` copies of a unit into one dataset; a line of the table."""
    with tempfile.TemporaryDirectory(prefix="vlnpe-merge-") as folder:
        units = [Path(folder) / "units" / f"{k:06d}" for k in range(count)]
        for number, one in enumerate(units):
            if number % LINKS == 0:
                shutil.copytree(unit, one)
            else:
                first = units[number - number % LINKS]
                shutil.copytree(first, one, copy_function=os.link)
        out = Path(folder) / "dataset"
        started, cpu_started = time.perf_counter(), time.process_time()
        assemble_dataset(units, out, provenance={}, licence="cc0-1.0", title="merge")
        cpu_s = time.process_time() - cpu_started
        seconds = time.perf_counter() - started
        files = [path for path in out.rglob("*") if path.is_file()]
        size = sum(path.stat().st_size for path in files) / 1e6
    return (
        f"{count:,}", f"{cpu_s:.1f}", f"{1000 * cpu_s / count:.1f}", f"{seconds:.0f}",
        f"{size:,.0f}", f"{len(files)}", f"{peak_mb():.0f}",
    )  # fmt: skip


def first_unit(run: Path) -> Path:
    return next(path for path in sorted((run / "units").glob("*/*")) if path.is_dir())


def apart(function: Callable[..., tuple[Any, ...]], *arguments: Any) -> tuple[Any, ...]:
    """Call in a separate process, so that its peak memory is that of the call alone."""
    with get_context("spawn").Pool(1) as pool:
        return pool.apply(function, arguments)


def line(*cells: Any) -> str:
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
