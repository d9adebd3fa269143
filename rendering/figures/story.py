"""Films of a policy's walk: its own view and one from behind, the instruction and its actions."""

import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ...collectors.robots import RobotSpec
from ...formats.core.arrays import I64
from ...formats.core.rollout import STATE_RATE_HZ, Rollout
from ..camera.rollout_frames import RolloutFrames
from ..camera.views import View, chase_view, make_view
from ..interface import Renderer
from .pictures import Picture, write_clip

TILE_PX = 240  # height of both views
FRAMES_PER_SECOND = 8
MOST_FRAMES = 160  # the end of a longer walk is shown
MOTIONS = ("velocity", "waypoints")  # events that name continuous actions
SPEECH = "said"  # events with a policy's own words


def policy_film(
    path: Path,
    renderer: Renderer,
    rollout: Rollout,
    view: View,
    robot: RobotSpec,
    *,
    on_part: Callable[[float], None] | None = None,
) -> Picture:
    """Write an `.mp4` with one frame per action and return its last frame, (H, W, 3) uint8.

    Args:
        renderer: of the rollout's scene, for the view's renderer and light.
        rollout: of an evaluation.
        view: the policy's own.
        on_part: called after each frame with the part of them that is done.
    """
    samples = _moments(rollout)
    ego = _resized(view, robot, renderer)
    behind = chase_view(renderer, 320, TILE_PX)
    plans = [RolloutFrames.plan(renderer, rollout, each, samples, robot) for each in (ego, behind)]
    pairs = zip(*(plan.render(renderer) for plan in plans), strict=True)

    def frames() -> Iterator[Picture]:
        frame: Picture = np.zeros((0, 0, 3), np.uint8)
        numbered = enumerate(zip(samples.tolist(), pairs, strict=True), start=1)
        for number, (sample, ((own, _), (chase, _))) in numbered:
            ended = sample == samples[-1]
            frame = _titled(np.concatenate([own, chase], axis=1), rollout, sample, ended)
            yield frame
            if on_part is not None:
                on_part(number / len(samples))
        yield from [frame] * FRAMES_PER_SECOND

    return write_clip(path, frames(), FRAMES_PER_SECOND)


def _moments(rollout: Rollout) -> I64:
    """Return the samples at which actions begin, and the last one."""
    starts = [span.start_sample for span in rollout.actions]
    if not starts:
        starts = [round(e.time_s * STATE_RATE_HZ) for e in rollout.events if e.kind in MOTIONS]
    if not starts:
        starts = rollout.frame_samples(4).tolist()
    last = len(rollout.time_s) - 1
    return np.unique([min(start, last) for start in starts] + [last])[-MOST_FRAMES:]


def _resized(view: View, robot: RobotSpec, renderer: Renderer) -> View:
    camera = view.camera
    width = round(TILE_PX * camera.width_px / camera.height_px / 2) * 2
    return make_view(
        "ego",
        robot,
        width_px=width,
        height_px=TILE_PX,
        hfov_deg=camera.hfov_deg,
        light=renderer.light,
        renderer=renderer.name,
        rig=view.rig,
    )


def _titled(views: Picture, rollout: Rollout, sample: int, ended: bool) -> Picture:
    """Return the views with the instruction above and the action below."""
    font = ImageFont.load_default(13)
    width = views.shape[1]
    lines = textwrap.wrap(rollout.episode.instruction, width // 7)[:4]
    head, foot = 8 + 16 * len(lines), 40
    image = Image.new("RGB", (width, (views.shape[0] + head + foot) // 2 * 2), (20, 24, 30))
    image.paste(Image.fromarray(views), (0, head))
    draw = ImageDraw.Draw(image)
    for k, line in enumerate(lines):
        draw.text((6, 4 + 16 * k), line, (230, 233, 238), font)
    text = "   ".join(filter(None, (_action_at(rollout, sample), _end(rollout) if ended else "")))
    time = f"{rollout.time_s[sample]:6.1f} s  "
    draw.text((6, views.shape[0] + head + 4), time + text, (240, 205, 110), font)
    speech = _latest(rollout, sample, (SPEECH,))
    if speech:
        draw.text((6, views.shape[0] + head + 21), speech[: width // 7], (160, 190, 240), font)
    return np.asarray(image)


def _end(rollout: Rollout) -> str:
    metrics = rollout.metrics
    what = "success" if metrics.success else str(rollout.end_reason).replace("_", " ")
    return f"ended: {what}, {metrics.navigation_error_euclidean_m:.1f} m from the goal"


def _action_at(rollout: Rollout, sample: int) -> str:
    for number, span in enumerate(rollout.actions):
        if span.start_sample <= sample < max(span.stop_sample, span.start_sample + 1):
            return f"action {number + 1}: {span.action.name}"
    return _latest(rollout, sample, MOTIONS)


def _latest(rollout: Rollout, sample: int, kinds: tuple[str, ...]) -> str:
    time_s = sample / STATE_RATE_HZ + 1e-6
    events = [e for e in rollout.events if e.kind in kinds and e.time_s <= time_s]
    if not events:
        return ""
    return events[-1].detail if kinds == (SPEECH,) else f"{events[-1].kind} {events[-1].detail}"
