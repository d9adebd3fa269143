"""Fuzz every target for its share of the time, each in a child process, and report it."""

import json
import logging
import multiprocessing
import os
import resource
import secrets
import tempfile
import time
import traceback
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.fuzz.search import search
from benchmarks.fuzz.targets import TARGETS

MINUTES = 60.0
MEMORY_BYTES = 4 << 30  # beyond what the process has when it starts
EXAMPLES = 500  # between two looks at the clock
log = logging.getLogger("benchmarks")


@dataclass(frozen=True)
class Summary:
    """Result of fuzzing one target.

    Attributes:
        target: its name.
        inputs: number of inputs read.
        refused: number of those that ended in a typed error.
        findings: files with a traceback each, the input beside it.
    """

    target: str
    inputs: int
    refused: int
    findings: tuple[str, ...]


def fuzz(name: str, seconds: float, seed: int, folder: Path) -> Summary:
    """Fuzz a target for a time, or until its process dies; findings are left in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    child = multiprocessing.get_context("spawn").Process(
        target=_run, args=(name, seconds, seed, folder)
    )
    child.start()
    child.join()
    current, counts = folder / "current", folder / "counts.json"
    if child.exitcode:
        (folder / "crash.txt").write_text(f"exit status {child.exitcode}\n")
        if current.is_file():
            current.rename(folder / "crash")
    current.unlink(missing_ok=True)
    inputs, refused = json.loads(counts.read_text()) if counts.is_file() else (0, 0)
    return Summary(name, inputs, refused, tuple(sorted(p.name for p in folder.glob("*.txt"))))


def _run(name: str, seconds: float, seed: int, folder: Path) -> None:
    inputs, refused, current = 0, 0, folder / "current"
    with tempfile.TemporaryDirectory(prefix="vlnpe-fuzz-") as scratch:
        target = TARGETS[name](Path(scratch))
        used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_BYTES, used + MEMORY_BYTES))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            try:
                counts = search(target, EXAMPLES, seed, current, end)
                inputs, refused = inputs + counts[0], refused + counts[1]
            except Exception as error:
                frames = traceback.extract_tb(error.__traceback__)
                place = f"{frames[-1].filename}:{frames[-1].lineno}".encode()
                stem = folder / f"{type(error).__name__}-{zlib.crc32(place):08x}"
                stem.write_bytes(current.read_bytes())
                stem.with_suffix(".txt").write_text("".join(traceback.format_exception(error)))
            seed += 1
            (folder / "counts.json").write_text(json.dumps((inputs, refused)))


def fuzz_all(out: Path, minutes: float | None = None, names: Sequence[str] = ()) -> list[Summary]:
    """Fuzz the named targets, or all; each gets an equal share.

    Args:
        out: folder for the findings, one per target.
        minutes: in total; by default those in `FUZZ_MINUTES`, or an hour.
        names: targets.
    """
    if minutes is None:
        minutes = float(os.environ.get("FUZZ_MINUTES", MINUTES))
    chosen = list(names) or list(TARGETS)
    summaries = []
    for name in chosen:
        # Every run looks elsewhere.
        seed = secrets.randbelow(1 << 30)
        summaries.append(fuzz(name, 60 * minutes / len(chosen), seed, out / name))
        log.info("fuzz %s: %s", name, summaries[-1])
    return summaries


def table(summaries: Sequence[Summary]) -> str:
    """Return a Markdown table."""
    lines = ["| reader | inputs | refused | findings |", "| --- | ---: | ---: | ---: |"]
    lines += [
        f"| {s.target} | {s.inputs:,} | {s.refused:,} | {len(s.findings)} |" for s in summaries
    ]
    return "\n".join(lines)


def report(run: Path) -> str:
    """Return the section of the benchmarks' page; findings stay in runs/bench-fuzz."""
    summaries = fuzz_all(run.with_name(f"{run.name}-fuzz"))
    inputs, findings = sum(s.inputs for s in summaries), sum(len(s.findings) for s in summaries)
    return (
        "## Hostile files\n\n"
        f"Fuzzing of every reader with Hypothesis: {inputs:,} inputs, {findings} findings that "
        "ended in anything but a result or a typed error.\n\n"
        f"{table(summaries)}\n"
    )
