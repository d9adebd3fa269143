"""Stage `render`: pixels from recorded states."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from ....collectors.robots import RobotSpec
from ....rendering.camera.extras import Extras
from ....rendering.camera.views import View
from ....rendering.registry import scene_renderer_name
from ...engine.ledger import Row
from ...engine.work import WorkItem, work_item
from .pictures_job import FilmJob
from .render_job import RenderJob

STAGE = "render"
VIDEO_STAGE = "video"


@dataclass(frozen=True)
class Recorded:
    """Rollouts of one robot, and the scenes that they were recorded in.

    Attributes:
        rows: Rows of the replay stage by item; their outputs are relative to `root`.
        root: Folder of the ledger that holds these rows.
        scenes: Rows of the repair stage by scene id.
    """

    robot: RobotSpec
    rows: Mapping[str, Row]
    root: Path
    scenes: Mapping[str, Row]
    scenes_folder: Path


@dataclass(frozen=True)
class _Take:
    """One rollout under one view: the item's name, what is read, and what that was made of."""

    name: str
    view: View
    scene: Path
    rollout: Path
    made_of: tuple[str, str]


def items(
    recorded: Recorded,
    view: View,
    frames_per_second: int,
    frames: Path,
    base: Path,
    *,
    rgb_codec: str = "h264",
    extras: Extras | None = None,
    depth_storage: str = "video",
) -> list[WorkItem]:
    """Return one item per rollout: a frame folder `<robot>/<controller>/<view>/<episode>`.

    Args:
        base: Folder of the ledger that will hold these items.
        extras: Further videos; none by default.
        depth_storage: how datasets will store depth: video or image.
    """
    extras = extras or Extras()
    result = []
    for take in _takes(recorded, view):
        view = take.view
        out = frames / take.name
        # Relative, so that a run folder may be moved between rendering and exporting.
        relative = os.path.relpath(take.rollout, base)
        job = RenderJob(
            take.scene,
            take.rollout,
            relative,
            recorded.robot,
            view,
            frames_per_second,
            rgb_codec,
            extras,
            depth_storage,
            out,
        )
        how = {"frames_per_second": frames_per_second, "rgb_codec": rgb_codec}
        how |= {"depth_storage": depth_storage}
        inputs = (*take.made_of, view, extras)
        result.append(work_item(STAGE, take.name, job, (out,), *inputs, **how))
    return result


def video_items(
    recorded: Recorded, view: View, frames_per_second: int, videos: Path
) -> list[WorkItem]:
    """Return one item per rollout: a preview `<robot>/<controller>/<view>/<episode>.mp4`."""
    result = []
    for take in _takes(recorded, view):
        view = take.view
        out = videos / f"{take.name}.mp4"
        job = FilmJob(take.scene, take.rollout, recorded.robot, view, frames_per_second, out)
        rate = {"frames_per_second": frames_per_second}
        result.append(work_item(VIDEO_STAGE, take.name, job, (out,), *take.made_of, view, **rate))
    return result


def _takes(recorded: Recorded, view: View) -> Iterator[_Take]:
    drawn_by: dict[Path, str] = {}
    for name, row in recorded.rows.items():
        scene = str(row.facts["scene"])
        folder, episode = name.rsplit("/", 1)
        root = recorded.scenes_folder / scene
        if root not in drawn_by:
            drawn_by[root] = scene_renderer_name(root, view.renderer)
        yield _Take(
            f"{folder}/{view.name}/{episode}",
            replace(view, renderer=drawn_by[root]),
            root,
            recorded.root / row.outputs[0],
            (row.key, recorded.scenes[scene].key),
        )
