"""Stage `render`: pixels from recorded states."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from ...collectors.rendering.camera.extras import Extras
from ...collectors.rendering.camera.rollout_views import render_rollout
from ...collectors.rendering.camera.views import View
from ...collectors.rendering.interface import Renderer
from ...collectors.rendering.people.pictures import watchable_video
from ...collectors.rendering.registry import make_renderer
from ...collectors.robots import get_robot
from ...formats.core.atomic import atomic_folder
from ...formats.mcap.rollout import read_rollout
from ...formats.scene.bundle import SceneBundle, load_bundle
from ..engine.keys import code_version, digest
from ..engine.ledger import Row
from ..engine.runner import ItemResult, WorkItem
from ..kept_robots import kept

STAGE = "render"
VIDEO_STAGE = "video"


def items(
    rollouts: Mapping[str, Row],
    scenes: Mapping[str, Row],
    root: Path,
    scenes_folder: Path,
    frames: Path,
    base: Path,
    view: View,
    frames_per_second: int,
    rgb_codec: str = "h264",
    extras: Extras | None = None,
) -> list[WorkItem]:
    """One item per rollout.

    Args:
        rollouts: rows of the replay stage by item; their outputs are relative to `root`.
        scenes: rows of the repair stage by scene id.
        root: the ledger's folder.
        scenes_folder: of the repaired scenes.
        frames: output folder, in the folder of the ledger `base`.
        base: folder of the ledger that will hold these items.
        view: what to see.
        frames_per_second: of the videos.
        rgb_codec: key of `formats.video.RGB_CODECS`.
        extras: further videos, default none.
    """
    extras = extras or Extras()
    code = code_version("collectors", "wayfinding", "formats", "pipeline/stages/render.py")
    result = []
    for name, row in rollouts.items():
        scene = str(row.facts["scene"])
        made_of = (row.key, scenes[scene].key, view, frames_per_second, rgb_codec, extras)
        key = digest(STAGE, *made_of, code)
        folder, episode = name.rsplit("/", 1)
        out = frames / folder / view.name / episode
        rollout = root / row.outputs[0]
        # Relative, so that a run folder may be moved between rendering and exporting.
        relative = os.path.relpath(rollout, base)
        robot = kept(name.split("/")[0], root)
        how = (view, frames_per_second, rgb_codec, extras)
        arguments = (scenes_folder / scene, rollout, relative, robot, *how, out)
        result.append(WorkItem(f"{folder}/{view.name}/{episode}", key, (out,), process, arguments))
    return result


def process(
    scene: Path,
    rollout: Path,
    relative: str,
    robot: str,
    view: View,
    frames_per_second: int,
    rgb_codec: str,
    extras: Extras,
    out: Path,
) -> ItemResult:
    """Render one rollout of `robot`, which is a name or a folder."""
    bundle, renderer = scene_renderer(scene, view.renderer, view.light)
    recorded = read_rollout(rollout)
    with atomic_folder(out) as temporary:
        count = render_rollout(
            bundle,
            renderer,
            recorded,
            view,
            temporary,
            frames_per_second,
            codec=rgb_codec,
            robot=get_robot(robot),
            extras=extras,
        )
    facts = {
        "frames": count,
        "rollout": relative,
        "scene": scene.name,
        "end_reason": str(recorded.end_reason),
        "frames_per_second": frames_per_second,
    }
    return ItemResult(facts)


def video_items(
    rollouts: Mapping[str, Row],
    scenes: Mapping[str, Row],
    root: Path,
    scenes_folder: Path,
    videos: Path,
    view: View,
    frames_per_second: int,
) -> list[WorkItem]:
    """One item per rollout: a video to look at, `<robot>/<controller>/<view>/<episode>.mp4`.

    Args:
        rollouts: rows of the replay stage by item; their outputs are relative to `root`.
        scenes: rows of the repair stage by scene id.
        root: the ledger's folder.
        scenes_folder: of the repaired scenes.
        videos: output folder.
        view: what to see.
        frames_per_second: of the videos.
    """
    code = code_version("collectors", "wayfinding", "formats", "pipeline/stages/render.py")
    result = []
    for name, row in rollouts.items():
        scene = str(row.facts["scene"])
        key = digest(VIDEO_STAGE, row.key, scenes[scene].key, view, frames_per_second, code)
        folder, episode = name.rsplit("/", 1)
        out = videos / folder / view.name / f"{episode}.mp4"
        robot = kept(name.split("/")[0], root)
        arguments = (
            scenes_folder / scene, root / row.outputs[0], robot, view, frames_per_second, out,
        )  # fmt: skip
        item = f"{folder}/{view.name}/{episode}"
        result.append(WorkItem(item, key, (out,), process_video, arguments))
    return result


def process_video(
    scene: Path, rollout: Path, robot: str, view: View, frames_per_second: int, out: Path
) -> ItemResult:
    """Render one rollout of `robot`, which is a name or a folder, to be looked at."""
    _, renderer = scene_renderer(scene, view.renderer, view.light)
    recorded = read_rollout(rollout)
    out.parent.mkdir(parents=True, exist_ok=True)
    count = watchable_video(
        out, renderer, recorded, view, frames_per_second, robot=get_robot(robot)
    )
    return ItemResult({"frames": count, "scene": scene.name})


@lru_cache(maxsize=1)
def scene_renderer(
    scene: Path, name: str = "embree", light: str = "baked"
) -> tuple[SceneBundle, Renderer]:
    """A repaired scene with its renderer; a worker keeps the last, which takes seconds to load."""
    bundle = load_bundle(scene)
    return bundle, make_renderer(bundle, name, light)
