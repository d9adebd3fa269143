"""Rendered RGB-D frames per second on one core, ego views along recorded walks, both renderers."""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vlnpe.formats.core.rollout import Rollout
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.formats.scene.bundle import load_bundle
from vlnpe.rendering.camera.rollout_frames import RolloutFrames
from vlnpe.rendering.camera.views import make_view
from vlnpe.rendering.gl.probe import graphics_card, why_no_gl
from vlnpe.rendering.interface import Renderer
from vlnpe.rendering.registry import make_renderer

SIZES = ((224, 224), (256, 256), (640, 480))
ROLLOUTS = 2
COMPARED = 6  # frames that are looked at for likeness
REPEAT_S = 4.0


def report(runs: Sequence[Path]) -> str:
    """Render rollouts of each scene of some runs and return a Markdown section.

    Embree is the reference. Times are processor time of all threads: on a machine without a card,
    OpenGL draws on the processor with threads of its own.
    """
    lines = []
    for run in runs:
        scene = next(path for path in (run / "scenes").iterdir() if path.is_dir())
        recorded = sorted((run / "rollouts").rglob("*.mcap"))[:ROLLOUTS]
        lines += _scene(scene, [read_rollout(path) for path in recorded])
    reason = why_no_gl()
    device = graphics_card() or "no card: Mesa's llvmpipe on the processor"
    return "\n".join(
        [
            "## Rendering RGB-D with the robot's body, processor time on one core",
            "",
            f"gl draws with: {device}." if not reason else f"gl is left out: {reason}.",
            "Likeness: PSNR of the colours and share of depths within 2 mm, both against embree.",
            "",
            "| scene, triangles | renderer | size | frames/s | ms | of embree | PSNR dB | depth |",
            "| --- | --- | --- | ---: | ---: | ---: | ---: | ---: |",
            *lines,
            "",
        ]
    )


def _scene(scene: Path, rollouts: list[Rollout]) -> list[str]:
    bundle = load_bundle(scene)
    title = f"{scene.name}, {len(bundle.visual().faces):,}"
    names = ["embree"] if why_no_gl() else ["embree", "gl"]
    renderers = {name: make_renderer(bundle, name) for name in names}
    lines = []
    for width, height in SIZES:
        reference, truth = 0.0, []
        for name, renderer in renderers.items():
            plans = [_plan(renderer, rollout, width, height) for rollout in rollouts]
            pictures = _evenly_chosen(plans[0], renderer)  # also compiles and fills caches
            truth = truth or pictures
            seconds = _seconds_per_frame(plans, renderer)
            reference = reference or seconds
            alike = "| |" if name == "embree" else _likeness(truth, pictures)
            lines.append(
                f"| {title} | {name} | {width} × {height} | {1 / seconds:.0f} | "
                f"{1000 * seconds:.1f} | {reference / seconds:.2f} {alike}"
            )
    return lines


def _plan(renderer: Renderer, rollout: Rollout, width: int, height: int) -> RolloutFrames:
    view = make_view("ego", rollout.robot, width_px=width, height_px=height, renderer=renderer.name)
    return RolloutFrames.plan(renderer, rollout, view, rollout.frame_samples(4))


def _evenly_chosen(plan: RolloutFrames, renderer: Renderer) -> list[tuple[np.ndarray, np.ndarray]]:
    frames = list(plan.render(renderer))
    return [frames[k] for k in np.linspace(0, len(frames) - 1, COMPARED).astype(int)]


def _seconds_per_frame(plans: list[RolloutFrames], renderer: Renderer) -> float:
    count, started, wall = 0, time.process_time(), time.monotonic()
    while not count or time.monotonic() - wall < REPEAT_S:
        for plan in plans:
            count += sum(1 for _ in plan.render(renderer))
    return (time.process_time() - started) / count


def _likeness(
    truth: list[tuple[np.ndarray, np.ndarray]], pictures: list[tuple[np.ndarray, np.ndarray]]
) -> str:
    squares = [
        np.mean((a.astype(float) - b) ** 2) for (a, _), (b, _) in zip(truth, pictures, strict=True)
    ]
    near = [np.mean(np.abs(a - b) < 2e-3) for (_, a), (_, b) in zip(truth, pictures, strict=True)]
    lowest = 10 * np.log10(255.0**2 / max(squares))
    return f"| ≥ {lowest:.1f} | ≥ {100 * min(near):.2f} % |"
