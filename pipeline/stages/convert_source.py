"""What is to be converted, and stage `unit`: each of its episodes as a unit."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from enum import StrEnum
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ...formats.convert.dataset import DatasetFacts, open_dataset
from ...formats.convert.episodes import DATASET_NAME, unit_from_dataset, unit_from_mcap
from ...formats.core.errors import FileFormatError
from ...formats.internnav import layout
from ...formats.internnav.foreign import Assumptions
from ...formats.internnav.reader import SceneFolder, find_scenes, is_layout, read_dataset_facts
from ...formats.internnav.to_unit import unit_from_layout
from ...formats.lerobot import read_episode_unit
from ..engine.keys import code_version, digest
from ..engine.runner import ItemResult, WorkItem

UNIT_STAGE = "unit"
CODE = ("formats", "pipeline/stages/convert.py", "pipeline/stages/convert_source.py")


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
        provenance = {"converted": source_note(Kind.N1) | options.assumptions.note()}
        facts = DatasetFacts(name, options.licence, provenance).to_json()
    (out / DATASET_NAME).write_text(json.dumps(facts))
    return ItemResult(_unit_facts(out, scene.folder) | asdict(seen))


def unit_items(source: Source, units: Path, options: Options) -> dict[str, list[WorkItem]]:
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
        # Digested once: the list of a large dataset is long, and it is in every episode's key.
        seen = digest(_seen(f for f in sorted(path.rglob("*")) if f.is_file()))
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
        *(
            folder / name
            for name in (
                layout.INFO_PATH,
                layout.TASKS_PATH,
                layout.EPISODES_PATH,
                layout.STATS_PATH,
                layout.UNITS_PATH,
                layout.DATASET_PATH,
            )
        ),
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


def source_note(kind: Kind) -> dict[str, Any]:
    """Where units came from, for a provenance of our own."""
    return {"from": str(kind), "vlnpe": version("vlnpe")}
