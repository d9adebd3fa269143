"""Give a dataset that LeRobot edited what it lost: vlnpe's episode columns, provenance, card.

LeRobot's own tools delete, split and merge episodes. They keep frame rows, tasks, videos and
statistics, and drop what they do not know. Episodes are recognised by their frame rows: states and
actions of two walks are never equal to the bit.
"""

import hashlib
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ..core.atomic import atomic_file, write_bytes, write_json
from ..core.errors import FileFormatError
from ..lerobot.card import FILM_STRIP, CameraFacts, CardFacts, dataset_card
from ..lerobot.episode_columns import EPISODE_COLUMNS, LATER_COLUMNS, camera_of
from ..lerobot.layout import PROVENANCE_PATH, SPLITS_PATH
from ..untrusted.files import check_input
from ..untrusted.tables import read_schema, read_table
from .dataset import episode_files, open_dataset, read_facts, read_info

# What identifies an episode; LeRobot's tools copy both.
IDENTITY = ("observation.state", "action")
POSE = "observation.camera_pose"


@dataclass(frozen=True)
class Restored:
    """What `restore` did: episodes, and the datasets that they came from."""

    episodes: int
    sources: tuple[Path, ...]


def restore(root: Path, originals: Sequence[Path]) -> Restored:
    """Write into dataset `root` what its episodes had in `originals`; nothing else changes.

    Raises:
        FileFormatError: one of them is not a dataset, or an episode of `root` is in no original.
    """
    info = read_info(root)
    known: dict[str, tuple[Path, dict[str, Any]]] = {}
    for original in originals:
        open_dataset(original)  # whole, and with all columns
        digests = _digests(original)
        for path in episode_files(original):
            written = set(read_schema(path, root=original).names)
            names = ["episode_index", *(key for key in EPISODE_COLUMNS if key in written)]
            for row in read_table(path, names, root=original).to_pylist():
                known[digests[row.pop("episode_index")]] = (original, LATER_COLUMNS | row)
    own = _digests(root)
    lost = sorted(number for number, digest in own.items() if digest not in known)
    if lost:
        raise FileFormatError(
            root,
            f"{len(lost)} episodes (the first is number {lost[0]}) are in none of "
            f"{', '.join(map(str, originals))}; name all datasets that it was made from",
        )
    found = {number: known[digest] for number, digest in own.items()}
    for path in episode_files(root):
        _write_columns(path, {number: row for number, (_, row) in found.items()})
    sources = tuple(dict.fromkeys(original for original, _ in found.values()))
    _write_meta(root, info, {number: found[number][1] for number in sorted(found)}, sources)
    return Restored(len(found), sources)


def _digests(root: Path) -> dict[int, str]:
    """Return a digest of each episode's states and actions, by its number."""
    states: dict[int, Any] = {}
    for path in sorted(root.glob("data/*/*.parquet")):
        table = read_table(path, ["episode_index", *IDENTITY], root=root)
        numbers = table["episode_index"].to_numpy()
        columns = [np.array(table[key].to_pylist(), np.float32) for key in IDENTITY]
        for number in np.unique(numbers).tolist():
            state = states.setdefault(number, hashlib.sha256())
            for values in columns:
                state.update(np.ascontiguousarray(values[numbers == number]).tobytes())
    return {number: state.hexdigest() for number, state in states.items()}


def _write_columns(path: Path, rows: dict[int, dict[str, Any]]) -> None:
    table = read_table(path)
    numbers = table["episode_index"].to_pylist()
    table = table.drop_columns([key for key in EPISODE_COLUMNS if key in table.column_names])
    for key, kind in EPISODE_COLUMNS.items():
        values = [rows[number][key] for number in numbers]
        table = table.append_column(key, pa.array(values, kind))
    with atomic_file(path) as temporary:
        pq.write_table(table, temporary)


def _write_meta(
    root: Path, info: dict[str, Any], rows: dict[int, dict[str, Any]], sources: Sequence[Path]
) -> None:
    """Write provenance, splits, film strip and card."""
    facts = [read_facts(source) for source in sources]
    scenes = {row["scene_id"] for row in rows.values()}
    provenance: dict[str, Any] = dict(facts[0].provenance)
    if len(facts) > 1:
        provenance = {"sources": [one.provenance for one in facts]}
    found = {k: v for one in facts for k, v in one.provenance.get("scenes", {}).items()}
    provenance["scenes"] = {name: found[name] for name in sorted(scenes) if name in found}
    splits: dict[str, list[int]] = {}
    split_scenes: dict[str, set[str]] = {}
    for number, row in rows.items():
        splits.setdefault(row["split"], []).append(number)
        split_scenes.setdefault(row["split"], set()).add(row["scene_id"])
    write_json(root / PROVENANCE_PATH, provenance)
    write_json(root / SPLITS_PATH, splits)
    strip = sources[0] / FILM_STRIP
    if strip.exists():
        check_input(strip, root=sources[0])
        shutil.copyfile(strip, root / FILM_STRIP)
    first = next(iter(rows.values()))
    licences = {one.licence for one in facts}
    card = CardFacts(
        title=root.resolve().name,
        licence=licences.pop() if len(licences) == 1 else "other",
        splits=splits,
        split_scenes=split_scenes,
        depth_far_m=first["depth_far_m"],
        camera=CameraFacts.of(camera_of(first), _camera_poses(root)),
        provenance=provenance,
        instructions=len({text for row in rows.values() for text in row["instructions"]}),
    )
    write_bytes(root / "README.md", dataset_card(card, info).encode())


def _camera_poses(root: Path) -> np.ndarray:
    """Return the poses (N, 7) of all frames."""
    tables = [read_table(p, [POSE], root=root) for p in sorted(root.glob("data/*/*.parquet"))]
    return np.array(pa.concat_tables(tables)[POSE].to_pylist(), np.float64)
