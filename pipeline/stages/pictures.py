"""Stage `pictures`: what the report shows: maps, film strips, and a clip of every failure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...collectors.controllers import CONTROLLERS
from ...collectors.robots import get_robot
from ...formats.core.atomic import write_json
from ...formats.mcap.rollout import read_rollout
from ..engine.keys import code_version, digest
from ..engine.ledger import Ledger, Row
from ..engine.run_folder import RunFolder
from ..engine.runner import Context, ItemResult, StageSummary, WorkItem, run_stage
from ..kept_robots import kept
from .render import scene_renderer

STAGE = "pictures"
CODE = ("collectors", "wayfinding", "formats", "pipeline/stages/pictures.py")
CLIP_S = 5.0  # how much of a failure's end is shown


@dataclass(frozen=True)
class Pictures:
    """Pictures that were made.

    Attributes:
        maps: by `<scene>/<level>`; a JSON file beside each says where it lies.
        strips: by robot.
        clips: by `<robot>/<controller>/<episode>`; the last frame lies beside each as `.jpg`.
    """

    maps: dict[str, Path]
    strips: dict[str, Path]
    clips: dict[str, Path]


def make(folder: RunFolder, context: Context, rows: Sequence[Row]) -> tuple[Pictures, StageSummary]:
    """Make what is missing of the pictures of the replay stage's `rows`."""
    kinds = (
        _map_items(folder, context.ledger),
        _strip_items(folder, context.ledger, rows),
        _clip_items(folder, context.ledger, rows),
    )
    summary = run_stage(context, STAGE, [item for items in kinds for item in items.values()])
    context.ledger.discard(STAGE, "clip ")
    good = summary.good()
    made = (
        {name: item.outputs[0] for name, item in items.items() if item.name in good}
        for items in kinds
    )
    return Pictures(*made), summary


def _map_items(folder: RunFolder, ledger: Ledger) -> dict[str, WorkItem]:
    result = {}
    for row in ledger.rows("repair"):
        if row.status != "done":
            continue
        for level in range(int(row.facts["levels"])):
            name = f"{row.item}/{level}"
            out = folder.report / "maps" / f"{row.item}-{level}.png"
            key = digest("map", row.key, level, code_version(*CODE))
            arguments = (folder.scenes / row.item, level, out)
            outputs = (out, out.with_suffix(".json"))
            result[name] = WorkItem(f"map {name}", key, outputs, process_map, arguments)
    return result


def process_map(scene: Path, level: int, out: Path) -> ItemResult:
    """Render one level from above."""
    from ...collectors.rendering.people.pictures import save_picture
    from ...collectors.rendering.people.scene_map import top_down_map

    bundle, renderer = scene_renderer(scene)
    picture = top_down_map(bundle, renderer, level)
    height, width = picture.image.shape[:2]
    mapping = {
        "left_m": picture.left_m,
        "top_m": picture.top_m,
        "px_per_m": picture.px_per_m,
        "width": width,
        "height": height,
    }
    write_json(out.with_suffix(".json"), mapping)
    save_picture(out, picture.image)
    return ItemResult()


def _strip_items(folder: RunFolder, ledger: Ledger, rows: Sequence[Row]) -> dict[str, WorkItem]:
    """One strip per robot, all of one episode where they can be: the one that most got through."""
    solved = Counter(row.facts["episode"] for row in rows if not row.failed)
    chosen: dict[str, Row] = {}
    known = list(CONTROLLERS)  # those that walk come first

    def rank(row: Row) -> tuple[bool, int, int, str]:
        facts = row.facts
        order = known.index(facts["controller"])
        return row.failed, order, -solved[facts["episode"]], row.item

    for row in sorted(rows, key=rank):
        chosen.setdefault(str(row.facts["robot"]), row)
    result = {}
    for robot, row in chosen.items():
        out = folder.report / "strips" / f"{robot}.jpg"
        arguments = _paths(folder, row)
        key = digest("strip", row.key, _scene_key(ledger, row), code_version(*CODE))
        result[robot] = WorkItem(f"strip {robot}", key, (out,), process_strip, (*arguments, out))
    return result


def process_strip(scene: Path, rollout: Path, robot: str, out: Path) -> ItemResult:
    """Render one episode of a robot, by its name or folder, as a strip of pictures."""
    from ...collectors.rendering.people.pictures import film_strip

    walked = read_rollout(rollout)
    film_strip(out, scene_renderer(scene)[1], walked, robot=get_robot(robot))
    facts = {
        "episode": walked.episode.episode_id,
        "controller": walked.controller,
        "end_reason": str(walked.end_reason),
    }
    return ItemResult(facts)


def _clip_items(folder: RunFolder, ledger: Ledger, rows: Sequence[Row]) -> dict[str, WorkItem]:
    """One clip per failed episode."""
    result = {}
    for row in rows:
        if not row.failed:
            continue
        out = folder.report / "clips" / f"{row.item.replace('/', '-')}.mp4"
        key = digest("clip", row.key, _scene_key(ledger, row), CLIP_S, code_version(*CODE))
        outputs = (out, out.with_suffix(".jpg"))
        arguments = (*_paths(folder, row), out)
        result[row.item] = WorkItem(f"clip {row.item}", key, outputs, process_clip, arguments)
    return result


def process_clip(scene: Path, rollout: Path, robot: str, out: Path) -> ItemResult:
    """Render the last seconds of one episode, and its last frame as a picture."""
    from ...collectors.rendering.people.pictures import save_picture, third_person_clip

    _, renderer = scene_renderer(scene)
    walked = read_rollout(rollout)
    last = third_person_clip(out, renderer, walked, CLIP_S, robot=get_robot(robot))
    save_picture(out.with_suffix(".jpg"), last)
    return ItemResult()


def _paths(folder: RunFolder, row: Row) -> tuple[Path, Path, str]:
    """Scene, rollout and robot of a row of the replay stage."""
    robot = kept(str(row.facts["robot"]), folder.root)
    return folder.scenes / str(row.facts["scene"]), folder.root / row.outputs[0], robot


def _scene_key(ledger: Ledger, row: Row) -> str:
    scene = ledger.row("repair", str(row.facts["scene"]))
    return scene.key if scene else ""
