"""`make evidence`: train, evaluate, and write a page of results beside their file.

Every cell is a training and an evaluation with one seed; finished ones are reused, so that the
command can be interrupted and repeated, and more tables, seeds or data can be added later. Cells
that the data at hand cannot fill stay unmeasured in the page.
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.dataset import TRAINING, UNSEEN
from benchmarks.evidence import cells, digest
from benchmarks.evidence.figures import figures
from benchmarks.evidence.page import NAME, page
from benchmarks.evidence.plan import tables
from benchmarks.evidence.records import Row, Table
from vlnpe.formats.core.atomic import atomic_file
from vlnpe.formats.core.errors import VlnpeError, check_name
from vlnpe.formats.core.progress import progress_bar
from vlnpe.pipeline.cli import main as vlnpe

RESULTS = Path(__file__).parent / "results"
BENCH = Path("runs/dataset-bench")  # where `make dataset-bench` writes


def main(arguments: list[str] | None = None, call: Callable[[Sequence[str]], int] = vlnpe) -> int:
    """Fill the cells by `call`, the command `vlnpe`, and write the page; return the exit code."""
    parser = argparse.ArgumentParser(prog="make evidence", description=__doc__)
    parser.add_argument("--data", type=Path, default=BENCH / TRAINING, help="folder of runs")
    parser.add_argument(
        "--run", type=Path, default=BENCH / UNSEEN, help="run with the unseen episodes"
    )
    parser.add_argument("--split", default="val_unseen", help="of those episodes")
    parser.add_argument(
        "--out", type=Path, default=Path("runs/evidence"), help="trainings, results"
    )
    parser.add_argument("--tables", default="", help="numbers, comma-separated; default all")
    parser.add_argument("--rows", default="", help="labels, separated by semicolons; default all")
    parser.add_argument("--seeds", default="", help="comma-separated; default of settings.yaml")
    parser.add_argument("--settings", type=Path, default=cells.SETTINGS, help="YAML file")
    parser.add_argument("--workers", type=int, default=0, help="of evaluations; 0: one per core")
    parser.add_argument("--docs", type=Path, default=RESULTS, help="folder of the page")
    parser.add_argument("--name", default=NAME, help="of the page and its files, without ending")
    parser.add_argument("--only-page", action="store_true", help="measure nothing")
    options = parser.parse_args(arguments)
    try:
        return _run(options, call)
    except VlnpeError as error:
        sys.stderr.write(f"make evidence: error: {error}\n")
        return 2


def _run(options: argparse.Namespace, call: Callable[[Sequence[str]], int]) -> int:
    source = options.docs / f"{options.name}.json"
    published = digest.read(source) if source.is_file() else None
    if options.only_page:
        _write_page(source, published or digest.read(source))
        return 0
    settings = cells.read_settings(options.settings)
    bench = cells.Bench(
        options.data,
        options.run,
        options.split,
        options.out,
        settings,
        cells.training_scenes(options.data),
        options.workers,
        call,
    )
    every = tables(len(bench.scenes))
    seeds = [int(seed) for seed in options.seeds.split(",") if seed] or list(settings.seeds)
    numbers = [n.strip() for n in options.tables.split(",") if n.strip()]
    for number in numbers:
        check_name("table", number, map(str, every))
    chosen = [every[int(n)] for n in numbers] or list(every.values())
    labels = [label.strip() for label in options.rows.split(";") if label.strip()]
    for label in labels:
        check_name("row", label, (row.label for table in chosen for row in table.rows))
    reasons = {
        row.cell(0): why
        for t in every.values()
        for row in t.rows
        if (why := cells.missing(bench, row))
    }
    # Seed by seed, so that an interrupted run has whole tables of fewer seeds.
    wanted = [
        (row, seed)
        for seed in seeds
        for row in _distinct(chosen, labels)
        if row.cell(0) not in reasons
        if row.varies or seed == seeds[0]
    ]
    measured = replace(
        bench, settings=replace(settings, seeds=tuple(sorted({*settings.seeds, *seeds})))
    )
    failed: list[str] = []
    try:
        with progress_bar("evidence", len(wanted)) as bar:
            for row, seed in wanted:
                try:
                    cells.measure(bench, row, seed)
                except VlnpeError as error:
                    failed.append(f"{row.cell(seed)}: {error}")
                    sys.stderr.write(f"make evidence: {failed[-1]}\n")
                bar.update()
    finally:  # also when it is interrupted
        value = digest.collect(measured, every, reasons, published)
        digest.write(source, value)
        _write_page(source, value)
    return int(bool(failed))


def _distinct(chosen: Sequence[Table], labels: Sequence[str]) -> list[Row]:
    """Return the rows of tables, of some labels unless there are none, each cell once."""
    rows = [row for table in chosen for row in table.rows if not labels or row.label in labels]
    return list({row.cell(0): row for row in rows}.values())


def _write_page(source: Path, value: Mapping[str, Any]) -> None:
    """Write the page of a compact file and its figures beside it."""
    every = tables(len(value["training_scenes"]))
    drawn = figures(value, every)
    for key, content in drawn.items():
        with atomic_file(source.with_name(f"{source.stem}-{key}.svg")) as temporary:
            temporary.write_bytes(content)
    with atomic_file(source.with_suffix(".md")) as temporary:
        temporary.write_text(page(value, every, drawn, source.stem))


if __name__ == "__main__":
    sys.exit(main())
