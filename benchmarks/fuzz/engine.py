"""Fuzz one reader in a child process: inputs that reach new lines of the code are built upon.

An input must end in a result or in a typed error of one short line. Anything else is a finding:
another exception, a crash, more than `SECONDS` or more memory than `MEMORY_BYTES`.
"""

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FrameType

import numpy as np

from benchmarks.fuzz.mutate import mutated
from benchmarks.fuzz.targets import TARGETS, Target
from vlnpe.formats.core.errors import VlnpeError

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 20
# Beyond what the process has when it starts.
MEMORY_BYTES = 4 << 30
MAX_BYTES = 200_000
MAX_MESSAGE = 2000
CURRENT, SUMMARY = "current", "summary.json"


class TooSlowError(Exception):
    """An input took too long."""


@dataclass
class Summary:
    """What fuzzing one target gave.

    Attributes:
        target: its name.
        seconds: wall time.
        runs: inputs tried.
        refused: those that ended in a typed error.
        lines: lines of the code that were reached.
        corpus: inputs kept because they reached new ones.
        findings: files with an input each, the traceback beside it.
    """

    target: str
    seconds: float = 0.0
    runs: int = 0
    refused: int = 0
    lines: int = 0
    corpus: int = 0
    findings: tuple[str, ...] = ()


class Coverage:
    """Lines of this repository that were executed, each reported once."""

    def __init__(self) -> None:
        self.lines: set[tuple[str, int]] = set()
        self._prefix = str(ROOT)
        monitoring = sys.monitoring
        monitoring.use_tool_id(monitoring.COVERAGE_ID, "vlnpe-fuzz")
        monitoring.register_callback(monitoring.COVERAGE_ID, monitoring.events.LINE, self._line)
        monitoring.set_events(monitoring.COVERAGE_ID, monitoring.events.LINE)

    def _line(self, code: CodeType, line: int) -> object:
        if code.co_filename.startswith(self._prefix) and ".venv" not in code.co_filename:
            self.lines.add((code.co_filename, line))
        return sys.monitoring.DISABLE


def fuzz(name: str, seconds: float, seed: int, folder: Path) -> Summary:
    """Fuzz a target for a time in child processes; findings are left in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    total, end, round_ = Summary(name), time.monotonic() + seconds, 0
    while (left := end - time.monotonic()) > 1:
        command = [
            sys.executable,
            "-m",
            __name__,
            name,
            f"{left:.1f}",
            str(seed + round_),
            str(folder),
        ]
        child = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        summary = folder / SUMMARY
        if summary.is_file():
            part = json.loads(summary.read_text())
            summary.unlink()
            for key in ("seconds", "runs", "refused"):
                setattr(total, key, getattr(total, key) + part[key])
            total.lines, total.corpus = max(total.lines, part["lines"]), part["corpus"]
        if child.returncode == 0:
            break
        current = folder / CURRENT
        if not current.is_file():
            raise RuntimeError(f"{name}: the child did not start: {child.stderr[-2000:]}")
        finding = folder / f"crash-{seed + round_}"
        current.rename(finding)
        finding.with_suffix(".txt").write_text(f"status {child.returncode}\n{child.stderr[-4000:]}")
        round_ += 1
    (folder / CURRENT).unlink(missing_ok=True)
    total.findings = tuple(sorted(p.name for p in folder.glob("*.txt")))
    return total


def run(name: str, seconds: float, seed: int, folder: Path) -> None:
    """Run as the child process."""
    signal.signal(signal.SIGALRM, _too_slow)
    with tempfile.TemporaryDirectory(prefix="vlnpe-fuzz-") as scratch:
        target = TARGETS[name](Path(scratch))
        used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_BYTES, used + MEMORY_BYTES))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        summary = _loop(name, target, seconds, np.random.default_rng(seed), folder)
    (folder / SUMMARY).write_text(json.dumps(vars(summary)))


def _loop(
    name: str, target: Target, seconds: float, rng: np.random.Generator, folder: Path
) -> Summary:
    coverage, summary = Coverage(), Summary(name)
    corpus = list(target.seeds)
    seen: set[str] = set()
    started = time.monotonic()
    for number in range(10**9):
        if (spent := time.monotonic() - started) > seconds:
            break
        seeding = number < len(corpus) and number < len(target.seeds)
        # New finds are tried more often.
        pick = -1 - int(min(rng.geometric(0.2) - 1, len(corpus) - 1))
        base = corpus[pick] if rng.random() < 0.5 else corpus[int(rng.integers(len(corpus)))]
        data = corpus[number] if seeding else mutated(base, corpus, rng)[:MAX_BYTES]
        (folder / CURRENT).write_bytes(data)
        before = len(coverage.lines)
        refused, fault = _try(target, data)
        summary.refused += refused
        summary.runs += 1
        if fault is not None:
            place, text = fault
            if place not in seen:
                seen.add(place)
                stem = folder / f"{name}-{len(seen)}-{int(rng.integers(10**9))}"
                stem.write_bytes(data)
                stem.with_suffix(".txt").write_text(text)
        elif len(coverage.lines) > before and not seeding:
            corpus.append(data)
        summary.seconds = spent
    summary.lines, summary.corpus = len(coverage.lines), len(corpus)
    return summary


def _try(target: Target, data: bytes) -> tuple[bool, tuple[str, str] | None]:
    """Read an input; return whether it was refused, and place and text of a fault."""
    signal.alarm(SECONDS)
    try:
        target.read(data)
        return False, None
    except VlnpeError as error:
        text = str(error)
        if len(text) > MAX_MESSAGE or "\n" in text:
            return True, ("message", f"a message of {len(text)} characters: {text[:500]!r}")
        return True, None
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        frames = traceback.extract_tb(error.__traceback__)
        ours = [f for f in frames if f.filename.startswith(str(ROOT)) and ".venv" not in f.filename]
        place = f"{type(error).__name__} {ours[-1].filename}:{ours[-1].lineno}" if ours else "?"
        return False, (place, "".join(traceback.format_exception(error))[-6000:])
    finally:
        signal.alarm(0)


def _too_slow(number: int, frame: FrameType | None) -> None:
    raise TooSlowError(f"more than {SECONDS} s")


if __name__ == "__main__":
    run(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]))
