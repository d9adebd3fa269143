"""The compact file that the page is made from: what every cell measured, episode by episode."""

import json
from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.evidence.cells import Bench, asked, results_of
from benchmarks.evidence.judge import METRICS, Walks
from benchmarks.evidence.records import Row, Table, Training
from vlnpe.evaluation.policy_registry import resolve_policy
from vlnpe.evaluation.results import COLUMNS, by_uid, read_results, uid_of
from vlnpe.formats.core.atomic import atomic_file, file_digest
from vlnpe.formats.core.errors import FileFormatError, InputError
from vlnpe.learning.card import read_card
from vlnpe.pipeline.engine import work

FORMAT = "vlnpe-evidence/2"
SAME_LOSS = 0.005  # relative, of one training on two machines; two seeds differ by about 0.02
_SAME = ("metrics", "settings", "training_scenes", "episodes", "instructions_sha256")


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
        published: content of the compact file so far, whose notes stay.

    Raises:
        InputError: A results file does not hold the episodes that were asked for, or was made with
            other instructions, a robot walked its tests with several gaits, or a table's cells are
            of different recordings of the same walks, or of different trainings.
    """
    episodes = asked(bench)
    uids = [uid_of(e.split, e.scene_id, e.episode_id) for e in episodes]
    instructions = work.digest([e.instruction for e in episodes])
    cells: dict[str, Any] = {}
    for row in _rows(tables):
        for seed in bench.settings.seeds:
            path = results_of(bench, row, seed)
            if path.is_file() and row.cell(seed) not in cells:
                cells[row.cell(seed)] = _cell(path, uids, instructions)
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
        "instructions_sha256": instructions,
        "seeds": list(bench.settings.seeds),
        "missing": dict(missing),
        "notes": list(published.get("notes", ())) if published else [],
        "cells": cells,
    }
    if published:
        value = _with_published(value, published, tables)
    _check_gaits(value, tables)
    return value


def _check_gaits(value: Mapping[str, Any], tables: Mapping[int, Table]) -> None:
    """Raise InputError if the tests of a robot were walked with several gaits."""
    gaits: dict[str, str | None] = {}
    seeds: list[int] = value["seeds"]
    for row, seed in product(_rows(tables), seeds):
        cell, test = value["cells"].get(row.cell(seed)), row.test
        if cell is None or test.controller == "flash":
            continue
        # Pages of earlier versions do not say which gait.
        gait = cell.get("gait_sha256", "unknown")
        if gait != gaits.setdefault(test.robot, gait):
            raise InputError(
                f"{row.cell(seed)}: {test.robot} walked with another gait than in further cells; "
                "measure them again, or write a page of its own with --name"
            )


def _with_published(
    value: dict[str, Any], published: Mapping[str, Any], tables: Mapping[int, Table]
) -> dict[str, Any]:
    """Return the value with the published cells of the same bench that it lacks."""
    if any(value[key] != published.get(key) for key in _SAME):
        return value
    seeds = sorted({*value["seeds"], *published["seeds"]})
    cells = {**published["cells"], **value["cells"]}
    for table in tables.values():
        data: dict[Any, str] = {}  # of every training on the same walks
        trained: dict[tuple[str, int], Any] = {}
        for cell, row, seed in _trained(cells, table, seeds):
            shas = _data(cell, row).items()
            same_data = all(sha == data.setdefault(walks, sha) for walks, sha in shas)
            first = trained.setdefault((row.policy_name, seed), cell)
            if not same_data or not _same_training(cell, first):
                raise InputError(
                    f"{row.cell(seed)}: trained on other data, or in another way, than further "
                    f"cells of table {table.number}; measure them again, or write to another --docs"
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
    """Return the trainings, with seeds, that were made again from the same data for some cells."""
    found: dict[tuple[str, ...], set[str]] = {}
    for table in tables.values():
        for cell, row, seed in _trained(value["cells"], table, value["seeds"]):
            training = (f"{row.policy_name}-s{seed}", *cell["data_sha"])
            found.setdefault(training, set()).add(cell["checkpoint_sha256"])
    return [name for (name, *_), checkpoints in found.items() if len(checkpoints) > 1]


def other_collections(
    value: Mapping[str, Any], tables: Mapping[int, Table]
) -> dict[int, list[str]]:
    """Return what tables are trained on from another collection than the tables before them.

    By number of the table: the walks, as `robot/controller`.
    """
    first: dict[Any, str] = {}
    found: dict[int, list[str]] = {}
    for number, table in tables.items():
        for cell, row, _ in _trained(value["cells"], table, value["seeds"]):
            for walks, sha in _data(cell, row).items():
                name = walks[0]
                if sha != first.setdefault(walks, sha) and name not in found.get(number, []):
                    found.setdefault(number, []).append(name)
    return found


def data_of_cells(value: Mapping[str, Any], tables: Mapping[int, Table]) -> dict[str, str]:
    """Return the walks that each trained cell was trained on, with their digests, by its name."""
    return {
        row.cell(seed): ", ".join(
            f"{walks} {sha[:12]}" for (walks, *_), sha in _data(cell, row).items()
        )
        for table in tables.values()
        for cell, row, seed in _trained(value["cells"], table, value["seeds"])
    }


def _trained(
    cells: Mapping[str, Any], table: Table, seeds: list[int]
) -> Iterator[tuple[Any, Row, int]]:
    """Yield the measured cells of trained policies, with their rows and seeds."""
    for row, seed in product(table.rows, seeds):
        cell = cells.get(row.cell(seed), {})
        if "checkpoint_sha256" in cell:
            yield cell, row, seed


def _data(cell: Mapping[str, Any], row: Row) -> dict[tuple[str, int, str, float], str]:
    """Return the digest of each robot's walks, by `robot/controller` and which were taken."""
    training = row.policy
    assert isinstance(training, Training)
    return {
        (walks, training.scenes, training.only, training.fraction): sha
        for walks, sha in zip(training.robots, cell["data_sha"], strict=True)
    }


def _rows(tables: Mapping[int, Table]) -> Iterator[Row]:
    return (row for table in tables.values() for row in table.rows)


def _cell(path: Path, uids: list[str], instructions: str) -> dict[str, Any]:
    found = read_results(path)
    episodes = by_uid(found["episodes"])
    lost = [uid for uid in uids if uid not in episodes]
    if lost:
        raise InputError(f"{path}: lacks {len(lost)} episodes, for example {lost[0]}")
    values = [[round(COLUMNS[m][1](episodes[uid]), 2) for m in METRICS] for uid in uids]
    setting = found["setting"]
    # Results of earlier versions do not say which; those of more episodes say it of all of these.
    given = setting.get("instructions_sha256", instructions)
    if given != instructions and len(episodes) == len(uids):
        raise InputError(
            f"{path}: made with other instructions than those of the episodes that are asked for "
            f"(instructions_sha256 {given[:12]}, not {instructions[:12]}); measure it again"
        )
    cell = {
        "results_sha256": file_digest(path),
        "gait_sha256": setting.get("gait_sha256"),
        "values": values,
    }
    checkpoint = resolve_policy(str(setting["policy"])).checkpoint
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
