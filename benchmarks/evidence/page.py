"""A page of all rows and claims, from the compact file of results."""

import math
from collections.abc import Collection, Mapping
from typing import Any

from benchmarks.evidence.cells import no_data
from benchmarks.evidence.digest import (
    SAME_LOSS,
    data_of_cells,
    other_collections,
    retrained,
    walks_of,
)
from benchmarks.evidence.judge import (
    UNMEASURED,
    difference,
    mean_interval,
    verdict,
)
from benchmarks.evidence.records import Claim, Row, Table, Training
from vlnpe.evaluation.results import COLUMNS, decimals
from vlnpe.learning.ablation.intervals import Difference

SHOWN = ("SR", "OS", "SPL", "NE", "CR", "FR", "StR")
PHYSICAL = {"FR", "StR"}  # cannot happen to an agent without a body
NAME = "evidence"  # of the page, unless another is asked for
_HEAD = """# What the data is worth

Written by `make evidence` from `{name}.json`; do not edit. Each row is a policy, trained (once per
seed) unless it is `random`, `forward` or `oracle`, that walked the same unseen episodes in closed
loop. SR and the other metrics are explained in `vlnpe evaluate --help`. Cells are means with
95 % intervals over seeds and scenes (`benchmarks/evidence/judge.py`): the variance over seeds and
that over scenes and paths (clustered bootstrap) are added, and the width is Student's t. A row with
one seed has an interval over scenes and paths alone. Differences are paired by episode. A claim is
**reproduced** (**shown**, where VLN-PE does not report it) if the interval of its difference lies
above zero, **contradicted** if it lies below, and **not shown** otherwise; claims are not corrected
for their number.

`exact` scenes are generated buildings without the virtual scan and its repair. Under `flash` the
agent without a body moves exactly and goes through walls and furniture; CR is the share of walks
that touched anything. No row under `flash` says how a robot would fare.
"""


_CAPTIONS = {
    "rates": "SR of every measured row with its 95 % interval",
    "amount": "SR against the number of paths that were trained on",
    "curves": "Single actions right, given the true steps before, in the course of every training",
}


def page(
    value: Mapping[str, Any],
    tables: Mapping[int, Table],
    figures: Collection[str],
    name: str = NAME,
) -> str:
    """Return the page.

    Tables without a measured row are named only.

    Args:
        value: content of the compact file.
        tables: all of them by number.
        figures: keys of the figures that lie beside the page.
        name: of the page and its files, without ending.
    """
    every = tables.values()
    tables = {n: t for n, t in tables.items() if any(r.cell(0) in value["cells"] for r in t.rows)}
    absent = [f"{t.number}. {t.title}" for t in every if t.number not in tables]
    scenes = sorted({episode[1] for episode in value["episodes"]})
    settings, train = value["settings"], value["settings"]["train"]
    rounds = settings["dagger_rounds"]
    judged = {n: [_judged(value, table, c) for c in table.claims] for n, table in tables.items()}
    measured = _measured(value, tables)
    others = other_collections(value, tables)
    trained = {
        walks
        for table in tables.values()
        for row in table.rows
        if row.cell(0) in value["cells"] and isinstance(row.policy, Training)
        for walks in row.policy.robots
    }
    corrected = (
        f", and {rounds} rounds of DAgger with {settings['dagger_episodes']} walks each, followed "
        "by as many steps"
    )
    parts = [
        _HEAD.format(name=name),
        f"Training scenes: {len(value['training_scenes'])}. Test: {len(value['episodes'])} "
        f"episodes in {len(scenes)} unseen scenes ({scenes[0]} … {scenes[-1]}), one instruction "
        f"each. Every training makes {train['steps']} steps of {train['batch']} episodes (rows "
        f"with more steps say so; with equal passes, {train['steps']} for each robot) on images of "
        f"{train['size_px']} px{corrected if rounds else ''}.\n",
        *(f"{note}\n" for note in value.get("notes", ())),
        "## Summary\n",
        _summary(value, tables, judged),
        *([f"Tables {UNMEASURED}: {' · '.join(absent)}.\n"] if absent else []),
        *(f"![{text}]({name}-{key}.svg)\n" for key, text in _CAPTIONS.items() if key in figures),
        *(
            _section(value, table, judged[n], measured, others.get(n, []), trained)
            for n, table in tables.items()
        ),
        _sources(value, tables),
    ]
    return "\n".join(parts).rstrip() + "\n"


def _summary(
    value: Mapping[str, Any],
    tables: Mapping[int, Table],
    judged: Mapping[int, list[tuple[str, str]]],
) -> str:
    lines = ["| table | measured rows | claims |", "| --- | ---: | --- |"]
    for number, table in tables.items():
        measured = sum(walks_of(value, table, row.label) is not None for row in table.rows)
        verdicts = [found for _, found in judged[number]]
        counts = ", ".join(f"{verdicts.count(v)} {v}" for v in dict.fromkeys(verdicts))
        title = f"[{table.number}. {table.title}](#{_anchor(table)})"
        lines.append(f"| {title} | {measured} of {len(table.rows)} | {counts} |")
    return "\n".join(lines) + "\n"


def _measured(value: Mapping[str, Any], tables: Mapping[int, Table]) -> dict[str, str]:
    """Return the columns of every row that has results, by its cell's name for seed 0."""
    found: dict[str, str] = {}
    for table in tables.values():
        for row in table.rows:
            walks = walks_of(value, table, row.label)
            if walks is not None and row.cell(0) not in found:  # tables share rows
                cells = [
                    "–"
                    if name in PHYSICAL and row.test.controller == "flash"
                    else _cell(name, mean_interval(walks, name))
                    for name in SHOWN
                ]
                found[row.cell(0)] = " | ".join([str(len(walks.seeds)), *cells])
    return found


def _reason(value: Mapping[str, Any], row: Row, trained: Collection[str]) -> str:
    """Return why a row is not measured; empty if other cells were trained on the data it lacks."""
    reason = value["missing"].get(row.cell(0), "")
    return "" if reason in {no_data(walks) for walks in trained} else reason


def _section(
    value: Mapping[str, Any],
    table: Table,
    judged: list[tuple[str, str]],
    measured: Mapping[str, str],
    others: list[str],
    trained: Collection[str],
) -> str:
    heads = [f"{name} [{COLUMNS[name][0]}]" for name in SHOWN]
    rows = [
        f"| {row.label} | {measured[row.cell(0)]} |"
        for row in table.rows
        if row.cell(0) in measured
    ]
    lacking = {
        row.label: _reason(value, row, trained) for row in table.rows if row.cell(0) not in measured
    }
    claims = [
        f"| {claim.text} ({claim.more} − {claim.less}) | {shown} | {found} |"
        for claim, (shown, found) in zip(table.claims, judged, strict=True)
        if found != UNMEASURED
    ]
    untested = {
        claim.text: ""
        for claim, (_, found) in zip(table.claims, judged, strict=True)
        if found == UNMEASURED
    }
    lines = [f"## {table.number}. {table.title}\n"]
    if table.note:
        lines.append(f"{table.note}\n")
    if others:
        lines.append(
            f"Trained on another collection of {', '.join(others)} than the tables before: compare "
            "within this table only.\n"
        )
    if rows:
        head = [f"| row | seeds | {' | '.join(heads)} |", "| --- | ---: |" + " ---: |" * len(SHOWN)]
        lines += [*head, *rows, ""]
    lines += _unmeasured("Rows", lacking)
    if claims:
        lines += ["| claim | difference | verdict |", "| --- | ---: | --- |", *claims, ""]
    lines += _unmeasured("Claims", untested)
    return "\n".join([*lines, f"VLN-PE: {table.paper}", ""])


def _unmeasured(what: str, reasons: Mapping[str, str]) -> list[str]:
    """Return one line that names what was not measured, and why where that is known."""
    by_reason: dict[str, list[str]] = {}
    for name, why in reasons.items():
        by_reason.setdefault(why, []).append(name)
    lines = [
        f"{what} {UNMEASURED}{f' ({why})' if why else ''}: {' · '.join(names)}."
        for why, names in by_reason.items()
    ]
    return [" ".join(lines), ""] if lines else []


def _judged(value: Mapping[str, Any], table: Table, claim: Claim) -> tuple[str, str]:
    """Return a claim's difference, and the verdict, in words."""
    more, less = (walks_of(value, table, label) for label in (claim.more, claim.less))
    if more is None or less is None:
        return "–", UNMEASURED
    found = difference(more, less, claim.metric)
    unit = "points" if COLUMNS[claim.metric][0] == "%" else COLUMNS[claim.metric][0]
    d = decimals(claim.metric)
    shown = f"{claim.metric} {found.mean:+.{d}f} ({found.low:+.{d}f} … {found.high:+.{d}f}) {unit}"
    pairs = ((claim.more, more), (claim.less, less))
    single = [w for label, w in pairs if table.row(label).varies and len(w.seeds) < 2]
    judged = verdict(found, published=claim.published)
    return shown, judged + (", with one seed" if single else "")


def _cell(column: str, found: Difference) -> str:
    if math.isnan(found.mean):
        return "–"
    d = decimals(column)
    return f"{found.mean:.{d}f} ({found.low:.{d}f} … {found.high:.{d}f})"


def _sources(value: Mapping[str, Any], tables: Mapping[int, Table]) -> str:
    again = retrained(value, tables)
    data = data_of_cells(value, tables)
    lines = [
        "## Trainings and result files\n",
        "Digests are SHA-256, their first 12 digits; held-out steps are those of `val_seen`, given "
        "the true steps before. The commonest action alone is right as often as said beside it. "
        "Walks with one digest (BLAKE2b of the episodes' names, labels, lengths and instructions) "
        "are the same.\n",
        *(
            [
                f"Trained again from the same data, recipe and seed for some of their cells, on "
                f"another machine, with losses within {100 * SAME_LOSS:g} %: {', '.join(again)}.\n"
            ]
            if again
            else []
        ),
        "| cell | walks trained on | their episodes | held-out actions right | commonest action | "
        "stops right | checkpoint | results |",
        "| --- | --- | ---: | ---: | ---: | ---: | --- | --- |",
    ]
    for name, cell in sorted(value["cells"].items()):
        last = (cell.get("curve") or [{}])[-1]
        right, constant, stops = (
            f"{100 * last[key]:.1f} %" if key in last else "–"
            for key in ("held action", "held constant", "held stop")
        )
        lines.append(
            f"| {name} | {data.get(name, '–')} | {cell.get('episodes', '–')} | {right} | "
            f"{constant} | {stops} | {cell.get('checkpoint_sha256', '–')[:12]} | "
            f"{cell['results_sha256'][:12]} |"
        )
    return "\n".join(lines) + "\n"


def _anchor(table: Table) -> str:
    kept = "".join(c for c in f"{table.number}. {table.title}".lower() if c.isalnum() or c in " -")
    return kept.replace(" ", "-")
