"""The walks in a run's folder, or an evaluation's, for the viewer."""

import re
from functools import cache, partial
from pathlib import Path

import mujoco
import numpy as np

from ...collectors.robots import RobotSpec
from ...formats.core.arrays import U8
from ...formats.core.camera import CameraModel
from ...formats.core.errors import InputError
from ...formats.core.rollout import Rollout
from ...formats.mcap.rollout import read_rollout
from ...formats.rendered.folder import read_frame_folder
from ...formats.untrusted.documents import read_json_object
from ...formats.video.mp4 import read_rgb_video
from ...formats.video.stream import pick_frames
from ...formats.vlnce.records import scene_stem
from ...viewer.library import Entry
from ...viewer.walk import Shots, Walk
from ..engine.ledger import Ledger, Row
from .robot_copies import robot_of_run

EVALUATIONS = "evaluations"


def run_of(folder: Path) -> Path:
    """Return the run of a folder, which is it or an evaluation in it."""
    folder = folder.resolve()
    return folder.parents[1] if folder.parent.name == EVALUATIONS else folder


def entries_of(folder: Path) -> list[Entry]:
    """Return the walks of a run and its evaluations, or of one evaluation.

    Raises:
        InputError: there are none.
    """
    root, folder = run_of(folder), folder.resolve()
    result = []
    folders = [folder]
    if root == folder:
        folders += sorted(p.parent for p in (root / EVALUATIONS).glob("*/manifest.json"))
    for place in folders:
        own = place != root
        ledger = Ledger.existing(place)
        seen = _seen_by_policy(place) if own else ""
        rows = [row for row in ledger.done() if _is_walk(row)]
        result += [_entry(root, ledger, row, place.name if own else "", seen) for row in rows]
    if not result:
        raise InputError(f"{folder}: contains no walks; valid: the folder of a run with rollouts")
    return result


def _is_walk(row: Row) -> bool:
    return bool(row.outputs) and row.outputs[0].endswith(".mcap") and "metrics" in row.facts


def _seen_by_policy(folder: Path) -> str:
    """Return the name of the view of an evaluation's policy; empty if its results lack it."""
    results = folder / "results.json"
    setting = read_json_object(results).get("setting") if results.is_file() else None
    return str(setting.get("view", "")) if isinstance(setting, dict) else ""


def _entry(root: Path, ledger: Ledger, row: Row, evaluation: str, seen: str) -> Entry:
    facts, metrics = row.facts, row.facts["metrics"]
    robot, controller, episode = row.item.split("/", 2)
    own: list[Path] = []
    if not evaluation:
        views = root / "frames" / robot / controller
        own = [p for kind in ("ego", "rig") for p in sorted(views.glob(f"{kind}-*/{episode}"))]
    name = f"{evaluation}: {row.item}" if evaluation else row.item
    frames = own[0] if own else None
    load = partial(_walk, name, ledger.root / row.outputs[0], root, frames, seen)
    return Entry(
        name=name,
        robot=robot,
        controller=controller,
        path=episode,
        scene=str(facts["scene"]),
        outcome=facts["end_reason"],
        length_m=metrics["trajectory_length_m"],
        seconds=metrics["duration_s"],
        contacts=int(facts.get("contacts") or 0),
        load=load,
        ends=partial(_ends, own[0]) if own else lambda: None,
    )


def _walk(name: str, path: Path, root: Path, frames: Path | None, seen: str) -> Walk:
    rollout = read_rollout(path)
    robot = robot_of_run(rollout.robot, root)
    shots = None
    if frames is not None:
        shots = _shots(frames)
    elif seen:
        scene = root / "scenes" / scene_stem(rollout.episode.scene_id)
        shots = _drawn(scene, rollout, robot, seen)
    return Walk(name, rollout, _model(robot), shots)


def _drawn(scene: Path, rollout: Rollout, robot: RobotSpec, seen: str) -> Shots | None:
    """Draw what a policy saw when it chose: a rollout of an evaluation has no pictures.

    A view of another kind than `ego-<width>x<height>-<field>deg-<light>` has none.
    """
    size = re.fullmatch(r"ego-(\d+)x(\d+)-([\d.]+)deg-(\w+)", seen)
    if size is None:
        return None
    # They take seconds to import, and most walks have pictures.
    from ...rendering.camera.rollout_frames import RolloutFrames
    from ...rendering.camera.views import View
    from ..stages.rollouts.render_job import scene_renderer

    view = View("ego", CameraModel("ego", int(size[1]), int(size[2]), float(size[3])), size[4])
    _, renderer = scene_renderer(scene, view.renderer, view.light)
    spans = [span.start_sample for span in rollout.actions]
    samples = np.array(spans or range(0, len(rollout.time_s), 25), np.int64)
    plan = RolloutFrames.plan(renderer, rollout, view, samples, robot)

    @cache
    def picture(number: int) -> U8:
        one = RolloutFrames.plan(renderer, rollout, view, samples[number : number + 1], robot)
        return next(one.render(renderer))[0]

    path = plan.path
    return Shots(view.camera, samples, path.position_world_m, path.quat_wxyz, picture)


@cache
def _model(robot: RobotSpec) -> mujoco.MjModel:
    return robot.build_model(floor=False)


def _shots(folder: Path) -> Shots:
    opened = read_frame_folder(folder)
    pictures: list[U8] = []

    def picture(number: int) -> U8:
        if not pictures:
            pictures.extend(read_rgb_video(opened.rgb_video))
        return pictures[number]

    return Shots(
        opened.camera,
        opened.arrays["sample_index"].astype(np.int64),
        opened.arrays["camera_position_world_m"],
        opened.arrays["camera_quat_wxyz"],
        picture,
    )


def _ends(folder: Path) -> tuple[U8, U8]:
    opened = read_frame_folder(folder)
    last = len(opened.arrays["sample_index"]) - 1
    frames = pick_frames(opened.rgb_video, [0, last])
    first, end = (np.asarray(frame.to_ndarray(format="rgb24"), np.uint8) for frame in frames)
    return first, end
