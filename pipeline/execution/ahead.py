"""Run what is left to do for an episode in one worker, ahead of the stages that ask for it.

A stage waits for the last of its items before the next one starts, and what one item left in memory
(a rollout, rendered depth) another would have to read and decode again. Here a worker goes through
all stages of an episode. Its rows land in the ledger under the very keys that the stages ask for,
so that these find them done. Whatever cannot be done so (an executor that cannot, an item that
kills its worker) is left to the stages, which change nothing about the result.
"""

import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from ...formats.process.progress import progress_bar
from ..engine.files import Records
from ..engine.ledger import Row
from ..engine.work import WorkItem
from .attempts import Link, run_chains
from .record import forget_failure, record
from .runner import BAR_LABEL, Context, check_distinct, counted, drop, why

BAR = "episodes"


def expected_row(
    context: Context, stage: str, item: WorkItem, facts: Callable[[], dict[str, Any]]
) -> Row | None:
    """Return the row that an item has, or will have if it ends well.

    Args:
        facts: Returns those facts of its row that items that read its outputs are made of.

    Returns:
        None if it was quarantined and will not run again.
    """
    ledger = context.ledger
    row = ledger.row(stage, item.name)
    if row is None or why(context, stage, item, row):
        outputs = tuple(ledger.relative(path) for path in item.outputs)
        return Row(stage, item.name, item.key, "done", outputs=outputs, facts=facts())
    return row if row.status == "done" else None


def run_ahead(context: Context, chains: Sequence[Sequence[Link]], label: str) -> None:
    """Run what is left to do of each chain, one worker a chain.

    `--explain` and `--only` speak of one stage after the other, so they leave it to the stages.

    Args:
        context: Ledger and workers; `ahead` is filled.
        chains: Items of several stages, each after those whose outputs it reads.
    """
    if not context.workers.chains or context.explain or context.only:
        return
    started = time.perf_counter()
    stages: dict[str, list[WorkItem]] = {}
    for link in (link for chain in chains for link in chain):
        stages.setdefault(link.stage, []).append(link.item)
    for stage, items in stages.items():
        check_distinct(stage, items)
    waiting = [left for chain in chains if (left := _left_to_do(context, chain))]
    if not waiting:
        return
    context.ledger.begin()
    earlier = _forget(context, (link for chain in waiting for link in chain))
    name = f"{f'{BAR} {label}':<{BAR_LABEL}}"
    done: list[Row] = []
    with progress_bar(
        name, len(chains), initial=len(chains) - len(waiting), show=context.progress
    ) as bar:
        try:
            for outcomes in run_chains(context.workers, waiting):
                for link, outcome in outcomes:
                    if outcome is not None:
                        done.append(
                            record(context.ledger, link.stage, link.item, outcome, context.command)
                        )
                    elif previous := earlier.get(
                        link.item.outputs
                    ):  # of other options, and untouched
                        context.ledger.add(*previous)
                bar.set_postfix_str(_note(done), refresh=False)
                bar.update()
        except BaseException:
            drop(context, (link.item for chain in waiting for link in chain))
            raise
    # A stage's share of the wall time is as its items' share of the workers' time.
    busy_s = sum(row.seconds for row in done)
    share = (time.perf_counter() - started) / busy_s if busy_s else 0.0
    context.ahead.update({(row.stage, row.item): share * row.seconds for row in done})


def _forget(
    context: Context, links: Iterable[Link]
) -> dict[tuple[Path, ...], tuple[Row, dict[str, Records]]]:
    """Forget what is known of items that are about to run; return rows of done ones, by outputs."""
    ledger = context.ledger
    earlier: dict[tuple[Path, ...], tuple[Row, dict[str, Records]]] = {}
    stages: dict[str, list[str]] = {}
    for link in links:
        row = ledger.row(link.stage, link.item.name)
        if row is not None and row.status == "done":
            earlier[link.item.outputs] = row, ledger.records(row)
        forget_failure(ledger, link.stage, link.item)
        stages.setdefault(link.stage, []).append(link.item.name)
    for stage, names in stages.items():
        ledger.forget(stage, names)
    return earlier


def _left_to_do(context: Context, chain: Sequence[Link]) -> list[Link]:
    """Return the links that are to run, up to one whose input will never come."""
    left: list[Link] = []
    failed = False
    for link in chain:
        row = context.ledger.row(link.stage, link.item.name)
        if link.wants_success and failed:
            continue
        if row is None or why(context, link.stage, link.item, row):
            left.append(link)
        elif link.needed and row.status == "quarantined":
            break
        else:
            failed |= row.failed
    return left


def _note(rows: Sequence[Row]) -> str:
    quarantined = sum(row.status != "done" for row in rows)
    failed = sum(row.failed for row in rows)
    return counted({"quarantined": quarantined, "failed": failed})
