"""Fuzz every target for its share of the time and report it."""

import logging
import os
import secrets
from collections.abc import Sequence
from pathlib import Path

from benchmarks.fuzz.engine import Summary, fuzz
from benchmarks.fuzz.targets import TARGETS

MINUTES = 60.0
log = logging.getLogger("benchmarks")


def fuzz_all(
    out: Path, minutes: float | None = None, names: Sequence[str] = (), seed: int | None = None
) -> list[Summary]:
    """Fuzz the named targets, or all; each gets an equal share.

    Args:
        out: folder for the findings, one per target.
        minutes: in total; by default those in `FUZZ_MINUTES`, or an hour.
        names: targets.
        seed: by default another one each time, so that every run looks elsewhere.
    """
    if minutes is None:
        minutes = float(os.environ.get("FUZZ_MINUTES", MINUTES))
    seed = secrets.randbelow(1 << 30) if seed is None else seed
    chosen = list(names) or list(TARGETS)
    summaries = []
    for name in chosen:
        summaries.append(fuzz(name, 60 * minutes / len(chosen), seed, out / name))
        log.info("fuzz %s: %s", name, summaries[-1])
    return summaries


def table(summaries: Sequence[Summary]) -> str:
    """Return a Markdown table."""
    lines = [
        "| reader | seconds | inputs | refused | lines reached | kept | findings |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    lines += [
        f"| {s.target} | {s.seconds:.0f} | {s.runs:,} | {s.refused:,} | {s.lines:,} | {s.corpus} "
        f"| {len(s.findings)} |"
        for s in summaries
    ]
    return "\n".join(lines)


def report(run: Path) -> str:
    """Return the section of the benchmarks' page; findings stay in runs/bench-fuzz."""
    out = run.with_name(f"{run.name}-fuzz")
    summaries = fuzz_all(out)
    seconds, inputs = sum(s.seconds for s in summaries), sum(s.runs for s in summaries)
    found = sum(len(s.findings) for s in summaries)
    return (
        "## Hostile files\n\n"
        f"Coverage-guided fuzzing of every reader, {seconds / 60:.0f} minutes: {inputs:,} inputs, "
        f"{found} that ended in anything but a result or a typed error.\n\n"
        f"{table(summaries)}\n"
    )
