"""Time whole runs, stage by stage."""

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks import chain
from vlnpe.pipeline.engine.ledger import Ledger

ROOT = Path(__file__).resolve().parents[2]
SCENES = {"apartment": "builtin", "small_house": "../shared/scenes/small_house.glb"}
ROBOTS = ("aliengo", "h1", "g1", "jetbot")
STAGES = ("replay", "render", "export", "mcap", "dataset")
EPISODES = 48
# As on a machine that keeps compiled modules, whatever this shell says.
ENVIRONMENT = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}


def prepared(scene: str) -> Path:
    """Return a run folder in which the scene is repaired; collect two episodes there if not."""
    run = ROOT / "runs" / "bench" / "throughput" / scene
    if not (run / "manifest.json").is_file():
        chain.collect(run, "--scene", SCENES[scene], "--episodes", "2", "--robot", ",".join(ROBOTS))
    return run


def measure_run(scene: str, robot: str, workers: int, episodes: int) -> dict[str, Any]:
    """Collect `episodes` with one robot in a fresh copy of a prepared run; seconds by stage.

    The run may use as many cores as it has workers: a worker alone on two cores encodes depth on
    the second one, and two could not be compared with it.
    """
    cores = sorted(os.sched_getaffinity(0))[:workers]
    with tempfile.TemporaryDirectory(dir=prepared(scene).parent) as folder:
        run = Path(folder) / "run"
        shutil.copytree(prepared(scene), run)
        command = [sys.executable, "-m", "vlnpe.pipeline.cli", "collect", "--json"]
        command += ["--scene", SCENES[scene], "--robot", robot, "--episodes", str(episodes)]
        command += ["--workers", str(workers), "--seed", "1", "--out", str(run)]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(
            command, stdout=subprocess.PIPE, text=True,
            cwd=ROOT, env=ENVIRONMENT, preexec_fn=lambda: os.sched_setaffinity(0, cores),
        )  # fmt: skip
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if not done.stdout:  # with an episode that was set aside the status is 1, too
            done.check_returncode()
        stages = json.loads(done.stdout.splitlines()[-1])["stages"]
        items: dict[str, dict[str, float]] = {}
        frames = 0
        ledger = Ledger(run)
        for stage in STAGES:
            rows = [r for r in ledger.rows(stage) if r.current]
            rows = [r for r in rows if "seed-1" in r.item] or rows
            if stage == "render":
                frames = sum(int(row.facts["frames"]) for row in rows)
            busy = sum(row.seconds for row in rows)
            wall = stages[stage]["seconds"]
            items[stage] = {
                "wall_s": wall,
                "cpu_s": sum(row.cpu_seconds for row in rows),
                "waiting_s": (workers if stage != "dataset" else 1) * wall - busy,
            }
        return {
            "scene": scene,
            "robot": robot,
            "workers": workers,
            "cores": len(cores),
            "episodes": episodes,
            "frames": frames,
            "stages": items,
            "peak_mib": after.ru_maxrss / 1024,
            "cpu_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        }


def episodes_per_hour(run: dict[str, Any]) -> float:
    return 3600 * run["episodes"] / sum(stage["wall_s"] for stage in run["stages"].values())
