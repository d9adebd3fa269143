"""Check that no episode got lost between two stages: each is done or quarantined in the next."""

from collections.abc import Iterator
from dataclasses import replace

from ...formats.core.rollout import EndReason
from ..engine.ledger import Ledger
from .integrity import Check

REPLAY, RENDER, EXPORTS, DATASET = "replay", "render", ("export", "mcap"), "dataset"


def check_coverage(ledger: Ledger) -> list[Check]:
    """Follow every rollout of a run into its datasets.

    A robot that was only replayed has no datasets to be in, and neither has a folder of rollouts.
    """
    gaps = (*_unrendered(ledger), *_unexported(ledger), *_left_out(ledger))
    return [replace(gap, unfinished=True) for gap in gaps]


def _unrendered(ledger: Ledger) -> Iterator[Check]:
    rendered = {row.item for row in ledger.rows(RENDER)}
    views: dict[str, set[str]] = {}
    for item in rendered:
        robot, controller, view, _ = item.split("/", 3)
        views.setdefault(f"{robot}/{controller}", set()).add(view)
    for row in ledger.done(REPLAY):
        crew, episode = row.item.rsplit("/", 1)
        for view in sorted(views.get(crew, ())):
            if f"{crew}/{view}/{episode}" not in rendered:
                yield Check(f"{REPLAY} {row.item}", f"neither rendered in {view} nor quarantined")


def _unexported(ledger: Ledger) -> Iterator[Check]:
    rendered = ledger.done(RENDER)
    failures = {r.item for r in rendered if r.facts.get("end_reason") != str(EndReason.SUCCESS)}
    for stage in EXPORTS:
        exported = {row.item for row in ledger.rows(stage)}
        scopes = {_scope(item) for item in exported}
        # Elsewhere --only-success left the failures out on purpose.
        with_failures = {_scope(item) for item in exported & failures}
        for row in rendered:
            scope = _scope(row.item)
            expected = scope in (with_failures if row.item in failures else scopes)
            if expected and row.item not in exported:
                yield Check(f"{RENDER} {row.item}", f"neither in stage {stage} nor quarantined")


def _left_out(ledger: Ledger) -> Iterator[Check]:
    for row in ledger.done(DATASET):
        units = [r for r in ledger.done("export") if _dataset(r.item) == row.item]
        counts = {
            "episodes": len(units),
            "frames": sum(int(r.facts.get("frames", 0)) for r in units),
        }
        wrong = {what: count for what, count in counts.items() if row.facts.get(what) != count}
        if wrong:
            has = ", ".join(f"{row.facts.get(what)} {what}" for what in wrong)
            units_have = ", ".join(f"{count} {what}" for what, count in wrong.items())
            yield Check(f"{DATASET} {row.item}", f"has {has}; its exported units {units_have}")


def _scope(item: str) -> str:
    return item.rsplit("/", 1)[0]


def _dataset(item: str) -> str:
    return _scope(item).replace("/", "-")
