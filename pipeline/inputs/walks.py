"""The walks in a run's folder, or an evaluation's, for the viewer."""

import shlex
from functools import cache, partial
from pathlib import Path

import mujoco
import numpy as np

from ...collectors.robots import RobotSpec
from ...formats.core.arrays import U8
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


def scenes_beside(folder: Path, given: Path | None = None) -> Path:
    """Return the folder of the scenes of a run, or of an evaluation within or outside its run.

    Args:
        given: by the user; by default where they were when the walks were made.

    Raises:
        InputError: they are nowhere.
    """
    ledger = Ledger.existing(folder)
    root = ledger.root.resolve()
    places = [given] if given else [root / "scenes", root.parents[1] / "scenes"]
    if not given and not any(place.is_dir() for place in places):
        places += _scenes_when_made(ledger.finished or ledger.unfinished)
    for place in places:
        if place.is_dir():
            return place.resolve()
    tried = ", ".join(map(str, places))
    raise InputError(f"{folder}: its scenes are not in {tried}; give their folder with --scenes")


def _scenes_when_made(command: str) -> list[Path]:
    """Return where the scenes were that an evaluation's command line names."""
    from ..options.command_line import parsed
    from ..options.evaluate import Evaluate
    from .episode_file import scenes_of

    words = shlex.split(command)  # `cd FOLDER && vlnpe evaluate …`
    if "evaluate" not in words:
        return []
    options = parsed("evaluate", words[words.index("evaluate") + 1 :], Evaluate)
    folder = Path(words[1])
    try:
        return [scenes_of(folder / options.episodes, options.scenes and folder / options.scenes)]
    except InputError:
        return []


def entries_of(folder: Path, scenes: Path) -> list[Entry]:
    """Return the walks of a run and its evaluations, or of one evaluation, in repaired `scenes`.

    Raises:
        InputError: there are none.
    """
    top = Ledger.existing(folder)
    inside = sorted(p.parent for p in (top.root / EVALUATIONS).glob("*/manifest.json"))
    result = [
        _entry(ledger, row, ledger.root.name if ledger is not top else "", scenes)
        for ledger in (top, *map(Ledger, inside))
        for row in ledger.done()
        if row.outputs and row.outputs[0].endswith(".mcap") and "metrics" in row.facts
    ]
    if not result:
        raise InputError(f"{folder}: contains no walks; valid: the folder of a run with rollouts")
    return result


def _entry(ledger: Ledger, row: Row, evaluation: str, scenes: Path) -> Entry:
    root, facts, metrics = ledger.root, row.facts, row.facts["metrics"]
    robot, controller, episode = row.item.split("/", 2)
    views = root / "frames" / robot / controller
    frames = [p for kind in ("ego", "rig") for p in sorted(views.glob(f"{kind}-*/{episode}"))]
    name = f"{evaluation}: {row.item}" if evaluation else row.item
    load = partial(_walk, name, root / row.outputs[0], root, scenes, frames[0] if frames else None)
    return Entry(
        name=name,
        folder=root,
        item=row.item,
        robot=robot,
        controller=controller,
        path=episode,
        scene=str(facts["scene"]),
        outcome=facts["end_reason"],
        length_m=metrics["trajectory_length_m"],
        seconds=metrics["duration_s"],
        contacts=int(facts.get("contacts") or 0),
        load=load,
        ends=partial(_ends, frames[0]) if frames else lambda: None,
    )


def _walk(name: str, path: Path, root: Path, scenes: Path, frames: Path | None) -> Walk:
    rollout = read_rollout(path)
    robot = robot_of_run(rollout.robot, root)
    scene = scenes / scene_stem(rollout.episode.scene_id)
    shots = _shots(frames) if frames else _drawn(scene, rollout, robot, _seen_by_policy(root))
    return Walk(name, rollout, _model(robot), shots)


def _seen_by_policy(folder: Path) -> str:
    """Return the name of the view of an evaluation's policy; empty if there is none."""
    results = folder / "results.json"
    setting = read_json_object(results).get("setting") if results.is_file() else None
    return str(setting.get("view", "")) if isinstance(setting, dict) else ""


def _drawn(scene: Path, rollout: Rollout, robot: RobotSpec, seen: str) -> Shots | None:
    """Draw what a policy saw when it chose: a rollout of an evaluation has no pictures."""
    if not seen:
        return None
    # They take seconds to import, and most walks have pictures.
    from ...rendering.camera.rollout_frames import RolloutFrames
    from ...rendering.camera.views import named_view
    from ...rendering.registry import AUTO, scene_renderer_name
    from ..stages.scenes.renderer import scene_renderer

    view = named_view(seen, robot, scene_renderer_name(scene, AUTO))
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
