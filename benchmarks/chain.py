"""The whole chain as a user runs it, stage by stage, and what that means per hour."""

import json
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

EPISODES = 24
# Per-episode stages; the others happen once per scene or per dataset.
PER_EPISODE = ("replay", "render", "export", "mcap")
NAVDP_PER_HOUR = 104  # trajectories per GPU-hour, camera replay without legged physics


def collect(run: Path, *options: str) -> dict[str, Any]:
    """Collect afresh into `run` as a user would; the command's summary."""
    shutil.rmtree(run, ignore_errors=True)
    command = [sys.executable, "-m", "vlnpe.pipeline.cli", "collect", *options]
    command += ["--out", str(run), "--json"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
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
