"""Time the parts of a frame in one process."""

import resource
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

from benchmarks.throughput.runs import ENVIRONMENT, prepared
from vlnpe.collectors.locomotion.runtime.drives import gait_for
from vlnpe.collectors.replay.replay import ReplayConfig
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.formats.video import mp4
from vlnpe.pipeline.stages.datasets import export_job, mcap_job
from vlnpe.pipeline.stages.rollouts import render_job, replay_job
from vlnpe.pipeline.stages.rollouts.handover import DepthKeeper
from vlnpe.rendering import embree, scene_tracer
from vlnpe.rendering.camera import rollout_views
from vlnpe.rendering.camera.extras import Extras
from vlnpe.rendering.camera.views import VIEWS, View
from vlnpe.rendering.scene.robot_trace import RobotTracer

WARM, TIMED = 1, 3  # episodes
FRAMES_PER_SECOND = 4
KEPT_CALLS = 64
RAYS = "rays and shading"
REST = {
    "replay": "physics: control, recording",
    "render": "render: reading, bookkeeping",
    "export": "export to LeRobot",
    "mcap": "MCAP",
}


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
            walker = replay_job.Walker(robot, config)
            rollout, review = out / "r.mcap", run / "review.jsonl"
            out.mkdir()
            depth = DepthKeeper()
            jobs = {
                "replay": replay_job.ReplayJob(folder, episode, walker, run / "models", rollout),
                "render": render_job.RenderJob(
                    folder, rollout, "r.mcap", robot, view, FRAMES_PER_SECOND, "h264",
                    Extras(), "video", out / "frames", depth,
                ),
                "export": export_job.UnitJob(
                    rollout, out / "frames", out / "unit", "video", review
                ),
                "mcap": mcap_job.McapJob(
                    rollout, out / "frames", folder, robot, "data", (), "video", review, "",
                    out / "m.mcap", depth,
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


def _wrap(watch: Stopwatch, robot: Any) -> None:
    watch.wrap(mujoco, "mj_step", "physics: MuJoCo")
    watch.wrap(type(gait_for(robot)), "act", "physics: policy")
    watch.wrap(replay_job, "write_rollout", "writing rollouts")
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


PARTS = (replay_job, render_job, export_job, mcap_job)


def _import_seconds() -> float:
    """CPU seconds of a process that imports what a worker needs."""
    modules = ", ".join(module.__name__ for module in PARTS)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", f"import {modules}"], check=True, env=ENVIRONMENT)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
