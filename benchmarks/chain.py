"""The whole chain as a user runs it, stage by stage, and what that means per hour."""

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

from vlnpe.formats.process import source
from vlnpe.pipeline.engine.ledger import Ledger

EPISODES = 24
# Per-episode stages; the others happen once per scene or per dataset.
PER_EPISODE = ("replay", "render", "export", "mcap")
NAVDP_PER_HOUR = 104  # trajectories per GPU-hour, camera replay without legged physics


def collect(run: Path, *options: str, environment: dict[str, str] | None = None) -> dict[str, Any]:
    """Collect afresh into `run` as a user would; the command's summary."""
    shutil.rmtree(run, ignore_errors=True)
    command = [sys.executable, "-m", "vlnpe.pipeline.cli", "collect", *options]
    command += ["--out", str(run), "--json"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment)
    return json.loads(done.stdout.splitlines()[-1])


def report(run: Path) -> str:
    """Collect into `run` and return a Markdown section."""
    started = time.perf_counter()
    summary = collect(run, "--episodes", str(EPISODES))
    seconds = time.perf_counter() - started
    stages = summary["stages"]
    lines = [
        "## The chain",
        "",
        f"`vlnpe collect --episodes {EPISODES}` on the built-in scene, nothing cached but compiled",
        f"code: {seconds:.0f} s in all, {summary['robots'][0]['collected']:.0f} % collected.",
        "",
        "| stage | seconds |",
        "| --- | ---: |",
        *(f"| {name} | {counts['seconds']:.1f} |" for name, counts in stages.items()),
        "",
    ]
    marginal = sum(stages[name]["seconds"] for name in PER_EPISODE)
    hourly = 3600 * EPISODES / marginal
    lines.append(
        f"Replayed, rendered and exported: **{hourly:,.0f} episodes per hour**, "
        f"{hourly / NAVDP_PER_HOUR:.0f} × NavDP's published {NAVDP_PER_HOUR} per GPU-hour."
    )
    return "\n".join(lines) + "\n"


def first_run(run: Path) -> str:
    """Collect with empty caches, then with another seed; return a Markdown section."""
    names = ["HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "MPLCONFIGDIR", "PYTHONPYCACHEPREFIX"]
    first, compiling, then = (defaultdict[str, float](float) for _ in range(3))
    for parsed in Path(source.ROOT, "__pycache__").glob("sources-*.json"):
        parsed.unlink()
    with tempfile.TemporaryDirectory(dir=run.parent) as folder:
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        environment |= {name: str(Path(folder, name)) for name in names}
        for seed, seconds in enumerate((first, then)):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            options = ("--episodes", "6", "--seed", str(seed))
            collect(out := Path(folder, str(seed)), *options, environment=environment)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            for row in Ledger(out).rows():
                seconds[row.stage] += row.cpu_seconds
                compiling[row.stage] += row.compile_seconds
            used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            seconds["starting, importing, writing"] = used - sum(seconds.values())
    for column in (first, compiling, then):
        column["**together**"] = sum(column.values())
    return "\n".join(
        [
            "## The first run",
            "",
            "`vlnpe collect --episodes 6` on the built-in scene: CPU seconds with empty caches",
            "(compiled kernels, Python's bytecode, fonts, parsed source), wall seconds in which",
            "kernels were compiled, and CPU seconds afterwards with another seed.",
            "",
            "| stage | first | compiling | then |",
            "| --- | ---: | ---: | ---: |",
            *(f"| {n} | {first[n]:.1f} | {compiling[n]:.1f} | {then[n]:.1f} |" for n in first),
            "",
        ]
    )
