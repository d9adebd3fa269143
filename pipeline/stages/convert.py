"""Stages `unit`, and `dataset`, `mcap` or `n1`: recorded episodes from one format to another."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ...formats.atomic import write_json
from ...formats.convert.dataset import DatasetFacts, open_dataset
from ...formats.convert.episodes import (
    DATASET_NAME,
    dataset_from_units,
    joint_facts,
    mcap_from_unit,
    unit_dataset,
    unit_from_dataset,
    unit_from_mcap,
)
from ...formats.errors import FileFormatError, InputError
from ...formats.internnav import layout
from ...formats.internnav.foreign import Assumptions
from ...formats.internnav.reader import SceneFolder, find_scenes, is_layout, read_dataset_facts
from ...formats.internnav.to_unit import unit_from_layout
from ...formats.internnav.tokens import own_vocabulary, read_vocabulary
from ...formats.internnav.writer import SceneEpisode, share_instructions, write_scene
from ...formats.lerobot import EpisodeUnit, read_episode_unit
from ..keys import code_version, digest
from ..ledger import Row
from ..runner import Context, ItemResult, StageSummary, WorkItem, run_stage

log = logging.getLogger(__name__)

UNIT_STAGE = "unit"
CODE = ("formats", "pipeline/stages/convert.py")


class Kind(StrEnum):
    """Formats that episodes are handed on in."""

    MCAP = "mcap"
    LEROBOT = "lerobot"
    N1 = "n1"


@dataclass(frozen=True)
class Options:
    """How to convert.

    Attributes:
        licence: of data that does not tell its own.
        vocabulary: VLN-CE episode file whose words give InternNav's tokens; None: our own words.
        assumptions: of what InternData-N1 does not tell.
        scan: InternData-N1's folder to write, one of `layout.SCANS`; None: as the robot says.
    """

    licence: str
    vocabulary: Path | None
    assumptions: Assumptions
    scan: str | None = None


@dataclass(frozen=True)
class Source:
    """Where episodes come from.

    Attributes:
        path: what the user gave.
        kind: its format.
        name: of the dataset that comes out; several scans give several.
    """

    path: Path
    kind: Kind
    name: str


def detect(path: Path) -> Source:
    """Tell what lies at `path`.

    Raises:
        FileFormatError: nothing that can be converted.
    """
    name = path.resolve().stem if path.is_file() else path.resolve().name
    if path.is_file() and path.suffix == ".mcap":
        return Source(path, Kind.MCAP, name)
    if not path.is_dir():
        raise FileFormatError(path, "no such folder, and no .mcap file")
    if (path / "meta" / "episodes").is_dir():
        return Source(path, Kind.LEROBOT, name)
    if any(path.glob("*.mcap")):
        return Source(path, Kind.MCAP, name)
    if is_layout(path):
        return Source(path, Kind.N1, name)
    raise FileFormatError(
        path,
        "nothing to convert; valid: a folder of .mcap files, a LeRobot v3 dataset, "
        "InternData-N1's VLN-PE layout",
    )


def run(
    context: Context, source: Source, target: Kind, options: Options
) -> tuple[list[StageSummary], list[Path]]:
    """Convert all episodes; return the stages' summaries and what was written.

    Raises:
        InputError: the source is already of that kind or unusable, or holds several robots.
    """
    if source.kind is target:
        raise InputError(f"{source.path}: is {target} already")
    root = context.ledger.root
    summaries, written = [], []
    for name, items in _unit_items(source, root / "units", options).items():
        units = run_stage(context, UNIT_STAGE, items, f"{name}/", required=True)
        summaries.append(units)
        rows = dict(sorted(units.good().items()))
        _check_alike(rows)
        _tell_doubts(rows)
        folder = root / target / name
        if target is Kind.LEROBOT:
            last = [_dataset_item(rows, root, folder, name, source, options)]
        elif target is Kind.MCAP:
            last = _mcap_items(rows, root, folder)
        else:
            last = _scene_items(rows, root, folder, name, options)
        summaries.append(run_stage(context, str(target), last, f"{name}/"))
        context.ledger.discard(str(target), f"{name}/")
        written.append(folder)
    return summaries, written


def process_mcap(path: Path, out: Path) -> ItemResult:
    """Write an MCAP file's unit."""
    unit_from_mcap(path, out)
    return ItemResult(_unit_facts(out, path))


def process_dataset_episode(root: Path, number: int, out: Path) -> ItemResult:
    """Write the unit of one episode of a LeRobot dataset."""
    unit_from_dataset(root, number, out)
    return ItemResult(_unit_facts(out, root))


def process_layout(
    scene: SceneFolder, number: int, out: Path, name: str, options: Options
) -> ItemResult:
    """Write the unit of one episode of InternData-N1."""
    seen = unit_from_layout(scene, number, out, options.assumptions)
    facts = read_dataset_facts(scene.folder)
    if facts is None:
        provenance = {"converted": _note(Kind.N1) | options.assumptions.note()}
        facts = DatasetFacts(name, options.licence, provenance).to_json()
    (out / DATASET_NAME).write_text(json.dumps(facts))
    return ItemResult(_unit_facts(out, scene.folder) | asdict(seen))


def process_dataset(units: Sequence[Path], out: Path, facts: DatasetFacts) -> ItemResult:
    """Assemble a LeRobot dataset."""
    summary = dataset_from_units(units, out, facts)
    return ItemResult({"episodes": summary.episodes, "frames": summary.frames})


def process_to_mcap(unit: Path, out: Path) -> ItemResult:
    """Write a unit's MCAP file."""
    mcap_from_unit(unit, out)
    return ItemResult({"bytes": out.stat().st_size})


def process_scene(
    episodes: Sequence[SceneEpisode], vocabulary: Any, dataset: dict[str, Any] | None, out: Path
) -> ItemResult:
    """Write one scene in InternData-N1's layout."""
    frames = write_scene(out, episodes, vocabulary, dataset)
    return ItemResult({"episodes": len(episodes), "frames": frames})


def _unit_items(source: Source, units: Path, options: Options) -> dict[str, list[WorkItem]]:
    """Items that write units, by the name of the dataset they belong to."""
    code = code_version(*CODE)
    groups: dict[str, list[WorkItem]] = {}

    def add(name: str, episode: str, seen: Any, process: Any, *arguments: Any) -> None:
        out = units / name / episode
        key = digest(UNIT_STAGE, seen, episode, options, code)
        item = WorkItem(f"{name}/{episode}", key, (out,), process, arguments)
        groups.setdefault(name, []).append(item)

    path = source.path.resolve()
    if source.kind is Kind.MCAP:
        for file in [path] if path.is_file() else sorted(path.glob("*.mcap")):
            out = units / source.name / file.stem
            add(source.name, file.stem, _seen([file]), process_mcap, file, out)
    elif source.kind is Kind.LEROBOT:
        opened = open_dataset(path)
        seen = _seen(f for f in sorted(path.rglob("*")) if f.is_file())
        for number in opened.episodes:
            episode = f"episode_{number:06d}"
            out = units / source.name / episode
            add(source.name, episode, seen, process_dataset_episode, path, number, out)
    else:
        scenes = find_scenes(path)
        scans = {scene.scan for scene in scenes}
        for scene in scenes:
            name = source.name if len(scans) == 1 else f"{source.name}-{scene.scan}"
            relative = "-".join(scene.folder.resolve().relative_to(path).parts) or scene.scene
            for number in scene.episodes:
                episode = f"{relative}-{number:06d}"
                seen = _seen(_layout_files(scene.folder, number))
                out = units / name / episode
                arguments = (scene, number, out, name, options)
                add(name, episode, seen, process_layout, *arguments)
    if not groups:
        raise FileFormatError(source.path, "no episode in it")
    return groups


def _layout_files(folder: Path, number: int) -> list[Path]:
    names = {"episode_chunk": number // layout.EPISODES_PER_CHUNK, "episode_index": number}
    return [
        folder / layout.DATA_PATH.format(**names),
        *(
            folder / layout.VIDEO_PATH.format(video_key=key, **names)
            for key in (layout.RGB_KEY, layout.DEPTH_KEY)
        ),
        folder / layout.TASKS_PATH,
        folder / layout.STATS_PATH,
    ]


def _seen(files: Iterable[Path]) -> list[Any]:
    """What tells that files are the same as before, without reading gigabytes."""
    found: list[Any] = []
    for path in files:
        status = path.stat() if path.is_file() else None
        found.append([str(path), *((status.st_size, status.st_mtime_ns) if status else ())])
    return found


def _unit_facts(folder: Path, source: Path) -> dict[str, Any]:
    unit = read_episode_unit(folder)
    return {
        "source": str(source),
        "robot": unit.robot,
        "frames": unit.length,
        "alike": digest(unit.frames_per_second, unit.robot, unit.features),
    }


def _check_alike(rows: Mapping[str, Row]) -> None:
    """One dataset holds one robot, one camera and one frame rate."""
    first = next(iter(rows.values()))
    for row in rows.values():
        if row.facts["alike"] != first.facts["alike"]:
            what = "robot" if row.facts["robot"] != first.facts["robot"] else "view or frame rate"
            raise InputError(
                f"{row.facts['source']}: {row.facts['robot']}, another {what} than "
                f"{first.facts['source']} ({first.facts['robot']}); one dataset holds one: "
                "convert them from folders of their own"
            )


def _tell_doubts(rows: Mapping[str, Row]) -> None:
    """Warn of others' frame rates that are not believed."""
    doubted = [
        row
        for row in rows.values()
        if not row.facts.get("ours", True)
        and (row.facts["fps"], row.facts["timestamp_step_s"]) != (4, 0.25)
    ]
    if doubted:
        facts = doubted[0].facts
        log.warning(
            "%d episodes say %s frames/s and rows %s s apart; taken as asked for instead",
            len(doubted),
            facts["fps"],
            facts["timestamp_step_s"],
        )


def _tell_size(unit: EpisodeUnit) -> None:
    size = (unit.columns["camera_width_px"], unit.columns["camera_height_px"])
    if size != (layout.IMAGE_SIZE_PX, layout.IMAGE_SIZE_PX):
        log.warning(
            "images of %d × %d; InternNav's depth encoder takes %d × %d: render that size for it",
            *size,
            layout.IMAGE_SIZE_PX,
            layout.IMAGE_SIZE_PX,
        )


def _dataset_item(
    rows: Mapping[str, Row],
    root: Path,
    out: Path,
    name: str,
    source: Source,
    options: Options,
) -> WorkItem:
    units = tuple(root / row.outputs[0] for row in rows.values())
    facts = joint_facts(units, name, options.licence, _note(source.kind))
    keys = [row.key for row in rows.values()]
    key = digest(Kind.LEROBOT, keys, facts.to_json(), code_version(*CODE))
    return WorkItem(f"{name}/dataset", key, (out,), process_dataset, (units, out, facts))


def _mcap_items(rows: Mapping[str, Row], root: Path, folder: Path) -> list[WorkItem]:
    code = code_version(*CODE)
    result = []
    for item, row in rows.items():
        out = folder / f"{item.rsplit('/', 1)[1]}.mcap"
        key = digest(Kind.MCAP, row.key, code)
        result.append(WorkItem(item, key, (out,), process_to_mcap, (root / row.outputs[0], out)))
    return result


def _scene_items(
    rows: Mapping[str, Row], root: Path, folder: Path, name: str, options: Options
) -> list[WorkItem]:
    units = [read_episode_unit(root / row.outputs[0]) for row in rows.values()]
    _tell_size(units[0])
    tasks = share_instructions(units)
    texts = [text for own in tasks for text in own]
    vocabulary = read_vocabulary(options.vocabulary) if options.vocabulary else None
    vocabulary = vocabulary or own_vocabulary(texts)
    scenes: dict[tuple[str, str], list[tuple[EpisodeUnit, SceneEpisode, str]]] = {}
    for unit, own, row in zip(units, tasks, rows.values(), strict=True):
        place = (
            options.scan or layout.scan_name(unit.robot, unit.columns["controller"]),
            layout.scene_name(unit.columns["scene_id"]),
        )
        scenes.setdefault(place, []).append((unit, SceneEpisode(unit.folder, own), row.key))
    result = []
    code = code_version(*CODE)
    for (scan, scene), members in scenes.items():
        ids = {unit.columns["scene_id"] for unit, _, _ in members}
        if len(ids) > 1:
            raise InputError(f"scenes {', '.join(sorted(ids))} would share the folder {scene}")
        facts = unit_dataset(members[0][0].folder)
        dataset = None if facts is None else facts.to_json()
        out = folder / scan / scene
        episodes = tuple(episode for _, episode, _ in members)
        key = digest(Kind.N1, [k for *_, k in members], tasks, vocabulary.words, dataset, code)
        arguments = (episodes, vocabulary, dataset, out)
        result.append(WorkItem(f"{name}/{scan}/{scene}", key, (out,), process_scene, arguments))
    write_json(folder / layout.VOCABULARY_NAME, vocabulary.to_json())
    return result


def _note(kind: Kind) -> dict[str, Any]:
    return {"from": str(kind), "vlnpe": version("vlnpe")}
