"""Time and memory of the whole command over the number of triangles, on one core."""

import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vlnpe.apartments.generate import generate_scan

from .planting.glb import Glb
from .scenes import APARTMENT, apartment

# Triangles of a single apartment, and numbers of apartments that stand side by side.
FEW_TRIANGLES = 100_000
APARTMENTS = (1, 2, 4, 8)
STREET_M = 1.0
TARGET_TRIANGLES, TARGET_S, TARGET_GIB = 1_000_000, 60.0, 4.0
PICTURE = "speed.png"


@dataclass(frozen=True)
class Run:
    """One run of `vlnpe repair`.

    Attributes:
        triangles: of the scan.
        cpu_s: of the core that it ran on.
        wall_s: on the clock; more than that if others used the core.
        peak_gib: greatest resident memory.
    """

    triangles: int
    cpu_s: float
    wall_s: float
    peak_gib: float


def measure(cache: Path, folder: Path) -> list[Run]:
    """Repair ever larger scans in child processes."""
    runs = []
    scans = [_small(cache), *(_street(count, cache) for count in APARTMENTS)]
    _repair(scans[0], folder)  # compiles and fills caches
    for scan in scans:
        triangles = sum(len(part.faces) for part in Glb(scan).parts())
        runs.append(_repair(scan, folder, triangles))
    return runs


def report(runs: list[Run], picture: Path) -> list[str]:
    """Return Markdown, and write the curve as a picture."""
    exponent, at_target = fit(runs)
    _draw(runs, exponent, picture)
    peak = np.interp(TARGET_TRIANGLES, [r.triangles for r in runs], [r.peak_gib for r in runs])
    return [
        "| triangles | CPU seconds | wall seconds | peak memory, GiB | µs per triangle |",
        "| ---: | ---: | ---: | ---: | ---: |",
        *(
            f"| {r.triangles:,} | {r.cpu_s:.1f} | {r.wall_s:.1f} | {r.peak_gib:.2f} "
            f"| {1e6 * r.cpu_s / r.triangles:.0f} |"
            for r in runs
        ),
        "",
        f"CPU seconds grow with the number of triangles to the power of **{exponent:.2f}**; "
        f"at {TARGET_TRIANGLES:,} triangles that fit gives **{at_target:.0f} s** "
        f"(target ≤ {TARGET_S:.0f} s) and, interpolated, **{peak:.1f} GiB** "
        f"(target ≤ {TARGET_GIB:.0f} GiB).",
        "",
        f"![growth]({picture.name})",
    ]


def fit(runs: list[Run]) -> tuple[float, float]:
    """Return the exponent of the growth, and the fitted seconds at the target size."""
    x, y = np.log([r.triangles for r in runs]), np.log([r.cpu_s for r in runs])
    slope, offset = np.polyfit(x, y, 1)
    return float(slope), float(np.exp(slope * np.log(TARGET_TRIANGLES) + offset))


def _small(cache: Path) -> Path:
    """Return an apartment of few triangles."""
    folder = cache / f"speed-{FEW_TRIANGLES}"
    if not (folder / "truth.npz").is_file():
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        scan = replace(APARTMENT.scan, target_faces=FEW_TRIANGLES)
        generate_scan(0, folder, replace(APARTMENT, scan=scan), lambda _: None)
    return folder / "scan.glb"


def _street(count: int, cache: Path) -> Path:
    """Write several apartments side by side into one file."""
    folder = cache / f"speed-street-{count}"
    folder.mkdir(parents=True, exist_ok=True)
    first = apartment(0, cache)
    glb, edge = Glb(first.path), _extent(first.path)[1]
    for seed in range(1, count):
        other = apartment(seed, cache).path
        low, high = _extent(other)
        glb.absorb(Glb(other), np.array([edge + STREET_M - low, 0.0, 0.0]))
        edge += STREET_M + high - low
    glb.write(folder / "scan.glb")
    return folder / "scan.glb"


def _extent(scan: Path) -> tuple[float, float]:
    """Return the least and greatest x."""
    x = np.concatenate([part.points_m[:, 0] for part in Glb(scan).parts()])
    return float(x.min()), float(x.max())


def _repair(scan: Path, folder: Path, triangles: int = 0) -> Run:
    out = folder / "speed"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "vlnpe.pipeline.cli", "repair", str(scan), "--out", str(out)]
    core = {min(os.sched_getaffinity(0))}
    started = time.perf_counter()
    with (folder / "speed.log").open("wb") as log:
        child = subprocess.Popen(
            command,
            stdout=log,
            stderr=log,
            env=environment,
            preexec_fn=lambda: os.sched_setaffinity(0, core),
        )
        _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    wall_s = time.perf_counter() - started
    if child.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {child.returncode}, see speed.log")
    return Run(triangles, usage.ru_utime + usage.ru_stime, wall_s, usage.ru_maxrss * 1024 / 2**30)


def _draw(runs: list[Run], exponent: float, picture: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    x = np.array([r.triangles for r in runs])
    figure, axis = pyplot.subplots(figsize=(6, 4), dpi=90)
    axis.loglog(x, [r.cpu_s for r in runs], "o-", label="CPU seconds")
    axis.loglog(x, [r.peak_gib for r in runs], "s-", label="peak memory, GiB")
    linear = runs[0].cpu_s * x / x[0]
    axis.loglog(x, linear, "--", color="grey", label="linear growth of the first")
    axis.set(xlabel="triangles", title=f"vlnpe repair, one core: exponent {exponent:.2f}")
    axis.grid(visible=True, which="both", alpha=0.3)
    axis.legend()
    figure.tight_layout()
    figure.savefig(picture)
    pyplot.close(figure)
