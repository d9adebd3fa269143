"""The compact file that the page is made from: what every cell measured, episode by episode."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.evidence.cells import Bench, asked, results_of
from benchmarks.evidence.judge import METRICS, Walks
from benchmarks.evidence.plan import Table, Training
from vlnpe.evaluation.policy import checkpoint_path
from vlnpe.evaluation.results import COLUMNS, read_results
from vlnpe.formats.core.atomic import atomic_file, file_digest
from vlnpe.formats.core.errors import FileFormatError, InputError
from vlnpe.learning.card import read_card

FORMAT = "vlnpe-evidence/1"


def collect(
    bench: Bench, tables: Mapping[int, Table], missing: Mapping[str, str]
) -> dict[str, Any]:
    """Return the content of the compact file: every cell that has results.

    A cell that a table shares with another stands there once. Per episode it holds the metrics in
    the order of `METRICS`, rounded to 0.01.

    Args:
        bench: data and outputs.
        tables: all of them.
        missing: why a row cannot be measured with the data at hand, by its cell's name for seed 0.

    Raises:
        InputError: A results file does not hold the episodes that were asked for.
    """
    episodes = asked(bench)
    uids = [f"{e.split}/{e.scene_id}/{e.episode_id}" for e in episodes]
    cells: dict[str, Any] = {}
    for table in tables.values():
        for row in table.rows:
            for seed in bench.settings.seeds:
                name, path = row.cell(seed), results_of(bench, row, seed)
                if path.is_file() and name not in cells:
                    cells[name] = _cell(path, uids)
    return {
        "format": FORMAT,
        "metrics": list(METRICS),
        "settings": {
            "train": dict(bench.settings.train),
            "dagger_rounds": bench.settings.dagger_rounds,
            "dagger_episodes": bench.settings.dagger_episodes,
        },
        "training_scenes": list(bench.scenes),
        "episodes": [[e.split, e.scene_id, e.trajectory_id, e.episode_id] for e in episodes],
        "missing": dict(missing),
        "cells": cells,
    }


def _cell(path: Path, uids: list[str]) -> dict[str, Any]:
    found = read_results(path)
    by_uid = {f"{e['split']}/{e['scene']}/{e['episode']}": e for e in found["episodes"]}
    lost = [uid for uid in uids if uid not in by_uid]
    if lost:
        raise InputError(f"{path}: lacks {len(lost)} episodes, for example {lost[0]}")
    values = [[round(COLUMNS[m][1](by_uid[uid]), 2) for m in METRICS] for uid in uids]
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
    found = {}
    for name, cell in value["cells"].items():
        head, _, test = name.partition("--")
        policy, _, seed = head.rpartition("-s")
        own = row.policy.name if isinstance(row.policy, Training) else row.policy
        if policy == own and test == row.test.name:
            found[int(seed)] = cell
    if not found:
        return None
    seeds = sorted(found)
    values = np.array([found[seed]["values"] for seed in seeds], float)  # (S, N, metrics)
    episodes = value["episodes"]
    return Walks(
        tuple("/".join((e[0], e[1], e[3])) for e in episodes),
        tuple(e[1] for e in episodes),
        tuple(e[2] for e in episodes),
        {metric: values[:, :, k] for k, metric in enumerate(value["metrics"])},
        tuple(seeds),
    )
