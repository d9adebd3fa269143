"""`make bench`: run every benchmark on the built-in scene and write benchmarks/README.md.

The scene is generated and repaired once under runs/bench. Nothing else should run meanwhile.
"""

from __future__ import annotations

import logging
import platform
import sys
from pathlib import Path

from benchmarks import chain, physics, render
from vlnpe.pipeline.executors import available_cores

ROOT = Path(__file__).resolve().parents[1]
HEADER = """# Benchmarks

Written by `make bench`. Read the ratios: absolute numbers depend on the machine and its load.

Machine: {machine}, {cores} cores used, Python {python}.
"""

log = logging.getLogger("benchmarks")


def main() -> int:
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    run = ROOT / "runs" / "bench"
    sections = [
        HEADER.format(machine=cpu_name(), cores=available_cores(), python=platform.python_version())
    ]
    for benchmark in (chain, physics, render):
        log.info("%s …", benchmark.__name__)
        sections.append(benchmark.report(run))
        log.info("%s", sections[-1])
    (ROOT / "benchmarks" / "README.md").write_text("\n".join(sections))
    return 0


def cpu_name() -> str:
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


if __name__ == "__main__":
    sys.exit(main())
