"""Where the time of a collection goes: per stage of whole runs, per part of a frame.

    python -m benchmarks throughput                     # all of it, into benchmarks/README.md
    python -m benchmarks.throughput parts --robot h1    # one part, printed
    python -m benchmarks.throughput runs --scene small_house --robot aliengo --workers 2

What was measured is kept in runs/bench/throughput.json, so that parts can be measured apart.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from benchmarks import chain
from vlnpe.collectors.drives import gait_for
from vlnpe.collectors.rendering import embree, scene_tracer
from vlnpe.collectors.rendering.camera import rollout_views
from vlnpe.collectors.rendering.camera.extras import Extras
from vlnpe.collectors.rendering.camera.views import VIEWS, View
from vlnpe.collectors.rendering.scene.robot_trace import RobotTracer
from vlnpe.collectors.replay import ReplayConfig
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.formats.video import mp4
from vlnpe.pipeline.engine.ledger import Ledger
from vlnpe.pipeline.jobs import export, mcap, render, replay

ROOT = Path(__file__).resolve().parents[1]
SCENES = {"apartment": "builtin", "small_house": "../shared/scenes/small_house.glb"}
ROBOTS = ("aliengo", "h1", "g1", "jetbot")
STAGES = ("replay", "render", "export", "mcap", "dataset")
EPISODES = 48
WARM, TIMED = 1, 3  # episodes of the parts
FRAMES_PER_SECOND = 4
KEPT_CALLS = 64
# As on a machine that keeps compiled modules, whatever this shell says.
ENVIRONMENT = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}

HISTORY = """History: small_house, Aliengo, 48 episodes in a prepared scene, two cores (idle for
episodes/h; Xeon, Sapphire Rapids, but for the first line):

| what | episodes/h | render stage s | drawing, CPU-ms a frame |
| --- | ---: | ---: | ---: |
| packets of rays, one kernel | 3,430 | 37.6 | 21 |
| a kernel in steps that count references to arrays | 1,850 | 80.7 | 53 |
| kernels without reference counting | | | 15 |
| texture filter and light look-up as vector code, edges, H.264 `superfast` | 4,680 | 26.0 | 12 |
"""


# --- whole runs -----------------------------------------------------------------------------


def prepared(scene: str) -> Path:
    """Return a run folder in which the scene is repaired; collect two episodes there if not."""
    run = ROOT / "runs" / "bench" / "throughput" / scene
    if not (run / "manifest.json").is_file():
        chain.collect(run, "--scene", SCENES[scene], "--episodes", "2", "--robot", ",".join(ROBOTS))
    return run


def measure_run(scene: str, robot: str, workers: int, episodes: int) -> dict[str, Any]:
    """Collect `episodes` with one robot in a fresh copy of a prepared run; seconds by stage."""
    with tempfile.TemporaryDirectory(dir=prepared(scene).parent) as folder:
        run = Path(folder) / "run"
        shutil.copytree(prepared(scene), run)
        command = [sys.executable, "-m", "vlnpe.pipeline.cli", "collect", "--json"]
        command += ["--scene", SCENES[scene], "--robot", robot, "--episodes", str(episodes)]
        command += ["--workers", str(workers), "--seed", "1", "--out", str(run)]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(
            command, stdout=subprocess.PIPE, text=True, check=True,
            cwd=ROOT, env=ENVIRONMENT,
        )  # fmt: skip
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
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
            "episodes": episodes,
            "frames": frames,
            "stages": items,
            "peak_mib": after.ru_maxrss / 1024,
            "cpu_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        }


def episodes_per_hour(run: dict[str, Any]) -> float:
    return 3600 * run["episodes"] / sum(stage["wall_s"] for stage in run["stages"].values())


# --- parts of a frame -----------------------------------------------------------------------


class Stopwatch:
    """CPU time by label, of what runs inside wrapped functions, without what they call."""

    def __init__(self) -> None:
        self.cpu_s: dict[str, float] = defaultdict(float)
        self._inner = threading.local()
        self._undo: list[Callable[[], None]] = []

    def wrap(self, owner: Any, name: str, label: str) -> None:
        """Time `owner.name` until the block ends."""
        function = getattr(owner, name)

        def timed(*arguments: Any, **named: Any) -> Any:
            outer = getattr(self._inner, "seconds", 0.0)
            self._inner.seconds = 0.0
            started = time.thread_time()
            try:
                return function(*arguments, **named)
            finally:
                spent = time.thread_time() - started
                self.cpu_s[label] += spent - self._inner.seconds
                self._inner.seconds = outer + spent

        setattr(owner, name, timed)
        self._undo.append(lambda: setattr(owner, name, function))

    def unwrap(self) -> None:
        """Undo the last wrapping."""
        self._undo.pop()()

    @contextmanager
    def running(self) -> Iterator[None]:
        """Undo all wrapping at the end."""
        try:
            yield
        finally:
            while self._undo:
                self.unwrap()


def measure_parts(scene: str, robot_name: str) -> dict[str, Any]:
    """CPU milliseconds per frame of every part of an episode, and of starting a worker."""
    run = prepared(scene)
    folder = next((run / "scenes").iterdir())
    rollouts = sorted((run / "rollouts" / robot_name / "path").glob("*.mcap"))
    robot = get_robot(robot_name)
    view = View("ego", VIEWS["ego"].default_camera(robot))
    watch, frames = Stopwatch(), 0
    first: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as temporary, watch.running():
        _wrap(watch, robot)
        calls = _recorded_rays(watch)
        for number in range(WARM + TIMED):
            if number == WARM:
                first = dict(watch.cpu_s)
                watch.cpu_s.clear()
                calls.clear()
                frames = 0
            source = rollouts[number % len(rollouts)]
            episode = read_rollout(source).episode
            out = Path(temporary) / str(number)
            config = ReplayConfig(robot=robot_name, controller="path")
            rollout, review = out / "r.mcap", run / "review.jsonl"
            out.mkdir()
            jobs = {
                "replay": replay.ReplayJob(folder, episode, config, run / "models", rollout),
                "render": render.RenderJob(
                    folder, rollout, "r.mcap", robot_name, view, FRAMES_PER_SECOND, "h264",
                    Extras(), out / "frames",
                ),
                "export": export.UnitJob(rollout, out / "frames", out / "unit", "video", review),
                "mcap": mcap.McapJob(
                    rollout, out / "frames", folder, robot_name, "data", (), "video", review, "",
                    out / "m.mcap",
                ),
            }  # fmt: skip
            for name, job in jobs.items():
                started, counted = time.process_time(), sum(watch.cpu_s.values())
                watch.wrap(type(job), "run", REST[name])
                result = job.run()
                watch.unwrap()
                frames += result.facts["frames"] if name == "render" else 0
                # What no wrapped function saw ran in threads of the depth encoder, or of libraries.
                hidden = time.process_time() - started - (sum(watch.cpu_s.values()) - counted)
                watch.cpu_s["encoding depth" if name == "render" else REST[name]] += hidden
        parts = {label: 1e3 * seconds / frames for label, seconds in watch.cpu_s.items()}
        parts |= _split_rays(calls, parts.pop(RAYS))
    steady_s = sum(parts.values()) * 1e-3 * frames / TIMED
    return {
        "scene": scene,
        "robot": robot_name,
        "frames": frames,
        "ms_per_frame": parts,
        "first_episode_s": sum(first.values()) - steady_s * WARM,
        "imports_s": _import_seconds(),
    }


RAYS = "rays and shading"
REST = {
    "replay": "physics: control, recording",
    "render": "render: reading, bookkeeping",
    "export": "export to LeRobot",
    "mcap": "MCAP",
}


def _wrap(watch: Stopwatch, robot: Any) -> None:
    watch.wrap(mujoco, "mj_step", "physics: MuJoCo")
    watch.wrap(type(gait_for(robot)), "act", "physics: policy")
    watch.wrap(replay, "write_rollout", "writing rollouts")
    watch.wrap(embree.SceneRenderer, "render", "drawing: other")
    watch.wrap(scene_tracer, "find_edges", "drawing: other")
    for name in ("visible", "trace"):
        watch.wrap(RobotTracer, name, "robot body")
    watch.wrap(rollout_views, "write_rgb_video", "encoding colour")
    watch.wrap(rollout_views, "write_depth_video", "encoding depth")
    for name in ("add_rgb", "add_depth_codes"):
        watch.wrap(mp4, name, "statistics")


def _recorded_rays(watch: Stopwatch) -> list[tuple[Any, ...]]:
    """Time the kernel, and keep the arguments of some of its calls from now on."""
    calls: list[tuple[Any, ...]] = []
    kernel = scene_tracer.render_rays
    watch.wrap(scene_tracer, "render_rays", RAYS)
    timed = scene_tracer.render_rays

    def recording(*arguments: Any) -> None:
        timed(*arguments)
        if len(calls) < KEPT_CALLS:
            calls.append((kernel, arguments[0].copy(), arguments[1].copy(), *arguments[2:]))

    scene_tracer.render_rays = recording  # undone with the wrapping below it
    return calls


def _split_rays(calls: list[tuple[Any, ...]], total_ms: float) -> dict[str, float]:
    """Split the kernel's time by leaving out textures and light on the same rays."""

    def seconds(change: Callable[[Any], Any]) -> float:
        started = time.thread_time()
        for kernel, *call in calls:
            kernel(*call[:6], change(call[6]), *call[7:])
        return time.thread_time() - started

    def untextured(arrays: Any) -> Any:
        return arrays._replace(texture=np.full_like(arrays.texture, -1))

    def plain(arrays: Any) -> Any:
        return untextured(arrays)._replace(shaded=np.zeros_like(arrays.shaded))

    changes = (lambda arrays: arrays, untextured, plain)
    whole, bare, rays = (min(seconds(change) for _ in range(2)) for change in changes)
    return {
        "rays": total_ms * rays / whole,
        "light": total_ms * (bare - rays) / whole,
        "textures": total_ms * (whole - bare) / whole,
    }


def _import_seconds() -> float:
    """CPU seconds of a process that imports what a worker needs."""
    modules = ", ".join(module.__name__ for module in (replay, render, export, mcap))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", f"import {modules}"], check=True, env=ENVIRONMENT)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


# --- the page -------------------------------------------------------------------------------


def keep(kind: str, measured: dict[str, Any]) -> None:
    """Add what was measured to the kept results, in the place of an earlier one of its kind."""
    known = results()
    same = ("scene", "robot", "workers")
    known[kind] = [
        one for one in known[kind] if any(one.get(k) != measured.get(k) for k in same)
    ] + [measured]
    path = ROOT / "runs" / "bench" / "throughput.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(known, indent=1))


def results() -> dict[str, list[dict[str, Any]]]:
    path = ROOT / "runs" / "bench" / "throughput.json"
    return json.loads(path.read_text()) if path.is_file() else {"runs": [], "parts": []}


def section() -> str:
    """Return the Markdown section of all that is kept."""
    known = results()
    lines = ["## Throughput", ""]
    if known["runs"]:
        lines += [
            f"`vlnpe collect` in a prepared scene, 256 × 256 RGB-D at {FRAMES_PER_SECOND} frames/s:"
            " wall seconds by stage; CPU and waiting per frame (waiting: workers without an item,",
            "process start included).",
            "",
            "| scene | robot | workers | episodes | frames | "
            + " | ".join(STAGES)
            + " | CPU-ms a frame | waiting, ms a frame | peak MiB | **episodes/h** |",
            "| --- | --- |" + " ---: |" * (len(STAGES) + 7),
            *(_run_line(run) for run in known["runs"]),
            "",
        ]
    labels = sorted({label for one in known["parts"] for label in one["ms_per_frame"]})
    if labels:
        heads = [f"{one['scene']}, {one['robot']}" for one in known["parts"]]
        lines += [
            "One process, CPU-ms per frame:",
            "",
            "| part | " + " | ".join(heads) + " |",
            "| --- |" + " ---: |" * len(heads),
            *(_part_line(label, known["parts"]) for label in labels),
            "| **sum** | "
            + " | ".join(f"**{sum(o['ms_per_frame'].values()):.1f}**" for o in known["parts"])
            + " |",
            "| imports of a worker, CPU-s | "
            + " | ".join(f"{one['imports_s']:.1f}" for one in known["parts"])
            + " |",
            "| first episode beyond that: scene, models, kernels, CPU-s | "
            + " | ".join(f"{one['first_episode_s']:.1f}" for one in known["parts"])
            + " |",
            "",
        ]
    return "\n".join([*lines, HISTORY])


def _run_line(run: dict[str, Any]) -> str:
    stages = run["stages"]
    cells = [run["scene"], run["robot"], run["workers"], run["episodes"], run["frames"]]
    cells += [f"{stages[stage]['wall_s']:.1f}" for stage in STAGES]
    for kind in ("cpu_s", "waiting_s"):
        cells.append(f"{1e3 * sum(s[kind] for s in stages.values()) / run['frames']:.1f}")
    cells += [f"{run['peak_mib']:,.0f}", f"**{episodes_per_hour(run):,.0f}**"]
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def _part_line(label: str, parts: list[dict[str, Any]]) -> str:
    values = (one["ms_per_frame"].get(label, 0.0) for one in parts)
    return f"| {label} | " + " | ".join(f"{value:.2f}" for value in values) + " |"


def report(_: Path) -> str:
    """Measure everything and return the section."""
    for scene in SCENES:
        for robot in ROBOTS:
            keep("parts", measure_parts(scene, robot))
            for workers in (1, 2):
                keep("runs", measure_run(scene, robot, workers, EPISODES))
    return section()


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("kind", choices=("parts", "runs"))
    parser.add_argument("--scene", choices=[*SCENES], default="small_house")
    parser.add_argument("--robot", choices=ROBOTS, default="aliengo")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--episodes", type=int, default=EPISODES)
    chosen = parser.parse_args(arguments)
    if chosen.kind == "parts":
        keep("parts", measure_parts(chosen.scene, chosen.robot))
    else:
        run = measure_run(chosen.scene, chosen.robot, chosen.workers, chosen.episodes)
        keep("runs", run)
    sys.stdout.write(section() + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
