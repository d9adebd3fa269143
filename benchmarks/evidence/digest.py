"""The compact file that the page is made from: what every cell measured, episode by episode."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.evidence.cells import Bench, asked, results_of
from benchmarks.evidence.judge import METRICS, Walks
from benchmarks.evidence.records import Row, Table
from vlnpe.evaluation.policy import checkpoint_path
from vlnpe.evaluation.results import COLUMNS, by_uid, read_results, uid_of
from vlnpe.formats.core.atomic import atomic_file, file_digest
from vlnpe.formats.core.errors import FileFormatError, InputError
from vlnpe.learning.card import read_card

FORMAT = "vlnpe-evidence/2"
SAME_LOSS = 0.005  # relative, of one training on two machines; two seeds differ by about 0.02
_SAME = ("metrics", "settings", "training_scenes", "episodes")


def collect(
    bench: Bench,
    tables: Mapping[int, Table],
    missing: Mapping[str, str],
    published: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Return the content of the compact file: every cell that has results.

    A cell that a table shares with another stands there once. Per episode it holds the metrics in
    the order of `METRICS`, rounded to 0.01. Published cells that were not measured again stay if
    episodes, settings and training scenes are the same, so that a page can grow on several
    machines.

    Args:
        bench: data and outputs.
        tables: all of them.
        missing: why a row cannot be measured with the data at hand, by its cell's name for seed 0.
        published: content of the compact file so far.

    Raises:
        InputError: A results file does not hold the episodes that were asked for, or a published
            cell is of other data than others of its training, or of another training.
    """
    episodes = asked(bench)
    uids = [uid_of(e.split, e.scene_id, e.episode_id) for e in episodes]
    cells: dict[str, Any] = {}
    for row in _rows(tables):
        for seed in bench.settings.seeds:
            path = results_of(bench, row, seed)
            if path.is_file() and row.cell(seed) not in cells:
                cells[row.cell(seed)] = _cell(path, uids)
    value = {
        "format": FORMAT,
        "metrics": list(METRICS),
        "settings": {
            "train": dict(bench.settings.train),
            "dagger_rounds": bench.settings.dagger_rounds,
            "dagger_episodes": bench.settings.dagger_episodes,
        },
        "training_scenes": list(bench.scenes),
        "episodes": [[e.split, e.scene_id, e.trajectory_id, e.episode_id] for e in episodes],
        "seeds": list(bench.settings.seeds),
        "missing": dict(missing),
        "cells": cells,
    }
    return _with_published(value, published, tables) if published else value


def _with_published(
    value: dict[str, Any], published: Mapping[str, Any], tables: Mapping[int, Table]
) -> dict[str, Any]:
    """Return the value with the published cells of the same bench that it lacks."""
    if any(value[key] != published[key] for key in _SAME):
        return value
    seeds = sorted({*value["seeds"], *published["seeds"]})
    cells = {**published["cells"], **value["cells"]}
    data: dict[str, Any] = {}  # of every seed of a training
    trained: dict[tuple[str, int], Any] = {}
    for row, seed in product(_rows(tables), seeds):
        cell = cells.get(row.cell(seed), {})
        if "checkpoint_sha256" not in cell:
            continue
        name = row.policy_name
        same_data = cell["data_sha"] == data.setdefault(name, cell["data_sha"])
        if not same_data or not _same_training(cell, trained.setdefault((name, seed), cell)):
            raise InputError(
                f"{row.cell(seed)}: trained on other data, or in another way, than further cells "
                f"of {name}; measure them again, or write to another --docs"
            )
    return {**value, "seeds": seeds, "cells": cells}


def _same_training(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Return whether two checkpoints are of the same training, on machines that may differ.

    The same training on another processor gives weights that differ by rounding, whose losses
    stay within `SAME_LOSS` of each other.
    """
    if one["checkpoint_sha256"] == other["checkpoint_sha256"]:
        return True
    losses, expected = ({p["step"]: p["loss"] for p in c["curve"]} for c in (one, other))
    return losses.keys() == expected.keys() and all(
        abs(losses[step] - loss) <= SAME_LOSS * loss for step, loss in expected.items()
    )


def retrained(value: Mapping[str, Any], tables: Mapping[int, Table]) -> list[str]:
    """Return the trainings, with seeds, whose cells are of more than one checkpoint."""
    found: dict[str, set[str]] = {}
    seeds: list[int] = value["seeds"]
    for row, seed in product(_rows(tables), seeds):
        cell = value["cells"].get(row.cell(seed), {})
        if "checkpoint_sha256" in cell:
            found.setdefault(f"{row.policy_name}-s{seed}", set()).add(cell["checkpoint_sha256"])
    return [name for name, checkpoints in found.items() if len(checkpoints) > 1]


def _rows(tables: Mapping[int, Table]) -> Iterator[Row]:
    return (row for table in tables.values() for row in table.rows)


def _cell(path: Path, uids: list[str]) -> dict[str, Any]:
    found = read_results(path)
    episodes = by_uid(found["episodes"])
    lost = [uid for uid in uids if uid not in episodes]
    if lost:
        raise InputError(f"{path}: lacks {len(lost)} episodes, for example {lost[0]}")
    values = [[round(COLUMNS[m][1](episodes[uid]), 2) for m in METRICS] for uid in uids]
    cell = {"results_sha256": file_digest(path), "values": values}
    checkpoint = checkpoint_path(str(found["setting"]["policy"]))
    if checkpoint is not None:
        card, digest = read_card(checkpoint)
        cell |= {
            "checkpoint_sha256": digest,
            "data_sha": [source["sha"] for source in card.data],
            "episodes": sum(int(source["episodes"]) for source in card.data),
            "curve": [{k: round(float(v), 4) for k, v in point.items()} for point in card.curves],
        }
    return cell


def write(path: Path, value: Mapping[str, Any]) -> None:
    """Write the compact file, one episode or cell's list per line."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"))
    with atomic_file(path) as temporary:
        temporary.write_text(text.replace('},"', '},\n"') + "\n")


def read(path: Path) -> dict[str, Any]:
    """Read the compact file.

    Raises:
        FileFormatError: It is none.
    """
    try:
        value = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise FileFormatError(path, f"no evidence ({error})") from error
    if not isinstance(value, dict) or value.get("format") != FORMAT:
        raise FileFormatError(path, f"no evidence; valid: format {FORMAT}")
    return value


def walks_of(value: Mapping[str, Any], table: Table, label: str) -> Walks | None:
    """Return what a row's seeds measured, or None if no seed did."""
    row = table.row(label)
    seeds = [seed for seed in value["seeds"] if row.cell(seed) in value["cells"]]
    if not seeds:
        return None
    cells = [value["cells"][row.cell(seed)] for seed in seeds]
    values = np.array([cell["values"] for cell in cells], float)  # (S, N, metrics)
    episodes = value["episodes"]
    return Walks(
        tuple(uid_of(e[0], e[1], e[3]) for e in episodes),
        tuple(e[1] for e in episodes),
        tuple(e[2] for e in episodes),
        {metric: values[:, :, k] for k, metric in enumerate(value["metrics"])},
        tuple(seeds),
    )
