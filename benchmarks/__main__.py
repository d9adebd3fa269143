"""`make bench`: run the benchmarks and write benchmarks/README.md.

The built-in scene is generated and collected afresh under runs/bench; real scans that lie beside
the repository are collected in, too. Only the named sections are measured again by
`make bench ONLY="render write"`; the others stay as they were. Nothing else should run meanwhile.
"""

import logging
import os
import platform
import re
import sys
from collections.abc import Callable
from pathlib import Path

import mujoco

from benchmarks import (
    chain,
    closed_loop,
    durability,
    labels,
    layouts,
    load,
    mcap,
    memory,
    physics,
    render,
    scaling,
    training,
)
from benchmarks.fuzz import report as fuzz
from benchmarks.throughput import page as throughput
from vlnpe.formats.core.errors import did_you_mean
from vlnpe.formats.process.threads import available_cores
from vlnpe.formats.scene.bundle import SceneBundle, load_bundle

ROOT = Path(__file__).resolve().parents[1]
SCANS = (ROOT.parent / "shared" / "scenes" / "small_house.glb",)
PAGE = ROOT / "benchmarks" / "README.md"
# In the page's order. All but the first read what the first collected.
SECTIONS: dict[str, Callable[[Path], str]] = {
    "chain": chain.report,
    "first_run": chain.first_run,
    "throughput": throughput.report,
    "memory": memory.report,
    "physics": lambda run: physics.report(scenes(run)),
    "labels": lambda run: labels.report(scenes(run)),
    "render": lambda run: render.report(runs(run)),
    "mcap": mcap.report,
    "layouts": layouts.report,
    "load": load.report,
    "training": training.report,
    "closed_loop": closed_loop.report,
    "durability": durability.report,
    "scaling": scaling.report,
    "fuzz": fuzz.report,
}
HEADER = """# Benchmarks

Written by `make bench`. Read the ratios: absolute numbers depend on the machine and its load.
Floor repair, measured against planted holes, has [its own page](scene_repair/README.md).
The summary for users is [docs/results/speed.md](../docs/results/speed.md).
"""

log = logging.getLogger("benchmarks")


def main(names: list[str]) -> int:
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    unknown = sorted(set(names) - set(SECTIONS))
    if unknown:
        named = ", ".join(f"{name}{did_you_mean(name, SECTIONS)}" for name in unknown)
        log.error("unknown section %s; valid: %s", named, ", ".join(SECTIONS))
        return 2
    run = ROOT / "runs" / "bench"
    if not (run / "manifest.json").is_file():
        names = ["chain", *names] if names else []
    sections = previous_sections(PAGE.read_text() if PAGE.is_file() else "")
    for name, report in SECTIONS.items():
        if name in names or not names:
            sections[name] = f"{report(run).strip()}\n\n{machine()}\n"
            log.info("%s", sections[name])
            # After each section, so that an interrupted run keeps what it measured.
            PAGE.write_text(page(sections))
    return 0


def previous_sections(text: str) -> dict[str, str]:
    """Return the sections of an earlier page by name."""
    parts = re.split(r"^<!-- (\w+) -->\n", text, flags=re.MULTILINE)[1:]
    return {name: body.strip() + "\n" for name, body in zip(parts[::2], parts[1::2], strict=True)}


def page(sections: dict[str, str]) -> str:
    bodies = [f"<!-- {name} -->\n{sections[name]}" for name in SECTIONS if name in sections]
    return "\n".join([HEADER, *bodies])


def runs(run: Path) -> list[Path]:
    """Return the built-in scene's run and, where real scans are, a small one in each."""
    others = [run.with_name(f"{run.name}-{scan.stem}") for scan in SCANS if scan.is_file()]
    for other, scan in zip(others, SCANS, strict=False):
        if not (other / "report" / "index.html").is_file():
            chain.collect(other, "--scene", str(scan), "--episodes", "4")
    return [run, *others]


def scenes(run: Path) -> list[SceneBundle]:
    return [load_bundle(next((r / "scenes").iterdir())) for r in runs(run)]


def machine() -> str:
    """Return the machine and its load, in a line."""
    return (
        f"*{cpu_name()}, {available_cores()} of {os.cpu_count()} cores, load "
        f"{os.getloadavg()[0]:.1f}; Python {platform.python_version()}, "
        f"MuJoCo {mujoco.__version__}.*"
    )


def cpu_name() -> str:
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
