"""`vlnpe verify`: open every output of a run with a reader, and say what does not hold."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pyarrow.parquet as pq
from mcap.exceptions import McapError
from mcap.reader import make_reader

from ..formats.core.errors import VlnpeError
from ..formats.core.progress import progress_bar
from ..formats.internnav.reader import find_scenes, read_layout_episode
from ..formats.mcap.rollout import read_rollout
from ..formats.scene.bundle import INDEX_NAME, load_bundle
from ..formats.scene.visibility import read_visibility
from ..formats.video.stream import probe_video
from ..formats.vlnce.files import read_episodes
from ..scene_repair.verify.scene import verify_scene
from .engine.ledger import Ledger, Row


@dataclass(frozen=True)
class Check:
    """One output and what is wrong with it; an empty problem means that it is sound."""

    what: str
    problem: str = ""


def verify_run(root: Path) -> list[Check]:
    """Check every current output of the run in `root`, or the one repaired scene that it is.

    Raises:
        FileFormatError: no run there.
    """
    if (root / INDEX_NAME).is_file():
        return [Check(f"scene {root.name}", _unsound("repair", root, root.name))]
    ledger = Ledger.existing(root)
    rows = [row for row in ledger.rows() if row.status == "done"]
    checks = []
    for row in progress_bar("verify", len(rows), items=rows):
        checks.append(Check(f"{row.stage} {row.item}", _problem(root, row)))
    return checks


def _problem(root: Path, row: Row) -> str:
    for output in row.outputs:
        path = root / output
        if not path.exists():
            return f"{output} is missing"
        problem = _unsound(row.stage, path, output)
        if problem:
            return problem
    return ""


def _unsound(stage: str, path: Path, name: str) -> str:
    try:
        READERS.get(stage, _exists)(path)
    except (VlnpeError, McapError, OSError, ValueError, KeyError) as error:
        return f"{name}: {error}"
    return ""


def _exists(path: Path) -> None:
    if path.is_file() and path.stat().st_size == 0:
        raise ValueError("empty")


def _scene(path: Path) -> None:
    problems = verify_scene(load_bundle(path))["problems"]
    if problems:
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise ValueError(f"{problems[0]}{more}")


def _mcap(path: Path) -> None:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            raise ValueError("no index")
        count = sum(1 for _ in reader.iter_messages())
        if count != summary.statistics.message_count:
            raise ValueError(f"{count} messages, its index says {summary.statistics.message_count}")


def _instructed(path: Path) -> None:
    """An episode file, or facts records beside it."""
    if path.parent.name == "facts":
        json.loads(gzip.decompress(path.read_bytes()))
    else:
        read_episodes(path)


def _dataset(path: Path) -> None:
    """Frames in the tables, in the episode index and in each video must agree."""
    frames = sum(pq.read_metadata(p).num_rows for p in path.glob("data/*/*.parquet"))
    lengths = [
        n
        for p in sorted(path.glob("meta/episodes/*/*.parquet"))
        for n in pq.read_table(p, columns=["length"])["length"].to_pylist()
    ]
    if sum(lengths) != frames:
        raise ValueError(f"{frames} frames in data, {sum(lengths)} in meta/episodes")
    for key in sorted(p for p in (path / "videos").iterdir() if p.is_dir()):
        shown = sum(probe_video(p).frames for p in key.glob("*/*.mp4"))
        if shown != frames:
            raise ValueError(f"{frames} frames in data, {shown} in {key.name}")


def _layout(path: Path) -> None:
    for scene in find_scenes(path):
        for number in scene.episodes:
            read_layout_episode(scene.folder, number)


READERS: dict[str, Callable[[Path], object]] = {
    "repair": _scene,
    "sample": read_episodes,
    "align": read_episodes,
    "filter": read_episodes,
    "look": read_visibility,
    "instruct": _instructed,
    "replay": read_rollout,
    "mcap": _mcap,
    "dataset": _dataset,
    "lerobot": _dataset,
    "n1": _layout,
}
