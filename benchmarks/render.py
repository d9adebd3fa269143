"""Rendered RGB-D frames per second on one core, ego views along recorded walks."""

from __future__ import annotations

import time
from pathlib import Path

import numba

from vlnpe.collectors.rendering.registry import make_renderer
from vlnpe.collectors.rendering.rollout_views import RolloutFrames
from vlnpe.collectors.rendering.views import make_view
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.formats.scene_bundle import load_bundle

SIZES = ((224, 224), (256, 256), (640, 480))
ROLLOUTS = 3


def report(run: Path) -> str:
    """Render rollouts of `run` and return a Markdown section."""
    numba.set_num_threads(1)
    scene = next((run / "scenes").iterdir())
    bundle = load_bundle(scene)
    renderer = make_renderer(bundle)
    rollouts = [read_rollout(p) for p in sorted((run / "rollouts").rglob("*.mcap"))[:ROLLOUTS]]
    rows, reference = [], 0.0
    for width, height in SIZES:
        frames, started = 0, time.process_time()
        for number, rollout in enumerate([rollouts[0], *rollouts]):
            if number == 1:  # the first pass compiles and fills caches
                frames, started = 0, time.process_time()
            view = make_view("ego", rollout.robot, width, height)
            plan = RolloutFrames.plan(renderer, rollout, view, rollout.frame_samples(4))
            frames += sum(1 for _ in plan.render(renderer))
        rate = frames / (time.process_time() - started)
        reference = reference or rate
        rows.append(
            f"| {width} × {height} | {rate:.0f} | {1000 / rate:.1f} | {rate / reference:.2f} |"
        )
    return "\n".join(
        [
            "## Rendering, embree, one core, CPU time",
            "",
            f"{scene.name}, {len(bundle.visual().faces):,} triangles, with the robot's body.",
            "",
            "| size | frames/s | ms per frame | of 224 × 224 |",
            "| --- | ---: | ---: | ---: |",
            *rows,
            "",
        ]
    )
