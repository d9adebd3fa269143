"""`make bench`: run every benchmark and write benchmarks/README.md.

The built-in scene is generated and collected afresh under runs/bench; real scans that lie beside
the repository, or that are named on the command line, are repaired there, too. Nothing else should
run meanwhile.
"""

from __future__ import annotations

import logging
import os
import platform
import sys
from pathlib import Path

import mujoco

from benchmarks import chain, physics, render
from vlnpe.formats.scene_bundle import SceneBundle, load_bundle
from vlnpe.pipeline.executors import available_cores
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.repair import repair_scene

ROOT = Path(__file__).resolve().parents[1]
SCANS = (ROOT.parent / "shared" / "scenes" / "small_house.glb",)
HEADER = """# Benchmarks

Written by `make bench`. Read the ratios: absolute numbers depend on the machine and its load.

Machine: {machine}, {cores} of {all} cores used, load {load:.1f} at the start; Python {python},
MuJoCo {mujoco}.
"""

log = logging.getLogger("benchmarks")


def main() -> int:
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    run = ROOT / "runs" / "bench"
    header = HEADER.format(
        machine=cpu_name(),
        cores=available_cores(),
        all=os.cpu_count(),
        load=os.getloadavg()[0],
        python=platform.python_version(),
        mujoco=mujoco.__version__,
    )
    sections = [header, _logged(chain.report(run))]
    builtin = load_bundle(next((run / "scenes").iterdir()))
    scans = [Path(name) for name in sys.argv[1:]] or [p for p in SCANS if p.is_file()]
    sections.append(_logged(physics.report([builtin, *(repaired(p, run) for p in scans)])))
    sections.append(_logged(render.report(run)))
    (ROOT / "benchmarks" / "README.md").write_text("\n".join(sections))
    return 0


def repaired(scan: Path, run: Path) -> SceneBundle:
    """A scan, repaired into `run`."""
    out = run / "scans" / scan.stem
    repair_scene(scan, out, RepairConfig(scene_id=scan.stem))
    return load_bundle(out)


def cpu_name() -> str:
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def _logged(section: str) -> str:
    log.info("%s", section)
    return section


if __name__ == "__main__":
    sys.exit(main())
