"""Stage `render`: pixels from recorded states."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from ...collectors.rendering.camera.extras import Extras
from ...collectors.rendering.camera.views import View
from ..engine.ledger import Row
from ..engine.work import WorkItem, work_item
from ..jobs.pictures import FilmJob
from ..jobs.render import RenderJob
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
    result = []
    for name, row in rollouts.items():
        scene = str(row.facts["scene"])
        made_of = (row.key, scenes[scene].key, view, frames_per_second, rgb_codec, extras)
        folder, episode = name.rsplit("/", 1)
        out = frames / folder / view.name / episode
        rollout = root / row.outputs[0]
        # Relative, so that a run folder may be moved between rendering and exporting.
        relative = os.path.relpath(rollout, base)
        robot = kept(name.split("/")[0], root)
        job = RenderJob(
            scenes_folder / scene,
            rollout,
            relative,
            robot,
            view,
            frames_per_second,
            rgb_codec,
            extras,
            out,
        )
        item = f"{folder}/{view.name}/{episode}"
        result.append(work_item(STAGE, item, job, (out,), *made_of))
    return result


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
    result = []
    for name, row in rollouts.items():
        scene = str(row.facts["scene"])
        folder, episode = name.rsplit("/", 1)
        out = videos / folder / view.name / f"{episode}.mp4"
        robot = kept(name.split("/")[0], root)
        job = FilmJob(
            scenes_folder / scene, root / row.outputs[0], robot, view, frames_per_second, out
        )
        item = f"{folder}/{view.name}/{episode}"
        made_of = (row.key, scenes[scene].key, view, frames_per_second)
        result.append(work_item(VIDEO_STAGE, item, job, (out,), *made_of))
    return result
