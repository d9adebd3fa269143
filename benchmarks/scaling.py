"""Cost of an episode, stage by stage, and growth of a run's shared parts with their number.

`python -m benchmarks scaling` collects with every robot on one worker and reads the costs from the
ledger: CPU seconds as measured inside the workers, bytes and files as recorded in the manifest.
"""

import resource
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks import chain
from vlnpe.pipeline.engine.files import FileRecord
from vlnpe.pipeline.engine.ledger import MANIFEST_NAME, Ledger, Row

EPISODES = 6
ROBOTS = ("aliengo", "h1", "g1", "jetbot")
PER_EPISODE = ("replay", "render", "export", "mcap", "dataset")
ROWS = (10_000, 100_000, 1_000_000)
ADDED = 500  # rows whose journal lines are timed


def report(run: Path) -> str:
    """Measure in `run`'s neighbours; a Markdown section."""
    where = run.with_name("scaling")
    arguments = ["--robot", ",".join(ROBOTS), "--episodes", str(EPISODES), "--workers", "1"]
    chain.collect(where, *arguments)
    ledger = Ledger(where)
    lines = [
        "## Scaling",
        "",
        f"Built-in scene, {EPISODES} paths, one worker. Per episode:",
        "",
        "| robot | " + " | ".join(f"{stage} CPU-s" for stage in PER_EPISODE) + " | MB | files |",
        "| --- |" + " ---: |" * (len(PER_EPISODE) + 2),
        *(_cost_line(ledger, robot) for robot in ROBOTS),
        "",
        "The manifest, with rows as a replay leaves them (one file each):",
        "",
        "| rows | add ms a row | save s | open s | manifest MB | peak MB |",
        "| ---: | ---: | ---: | ---: | ---: | ---: |",
        *(line(*apart(manifest_cost, count)) for count in ROWS),
    ]
    return "\n".join(lines) + "\n"


def _cost_line(ledger: Ledger, robot: str) -> str:
    seconds: dict[str, float] = defaultdict(float)
    stored: Counter[str] = Counter()
    for stage in PER_EPISODE:
        for row in ledger.rows(stage):
            if row.item.startswith(robot):
                seconds[stage] += row.cpu_seconds
                stored.update(_stored_files(ledger, row))
    cells = [f"{seconds[stage] / EPISODES:.2f}" for stage in PER_EPISODE]
    cells += [f"{stored['bytes'] / EPISODES / 1e6:.2f}", f"{stored['files'] / EPISODES:.1f}"]
    return f"| {robot} | " + " | ".join(cells) + " |"


def _stored_files(ledger: Ledger, row: Row) -> dict[str, int]:
    paths = [ledger.root / output for output in row.outputs]
    files = [f for p in paths for f in ([p] if p.is_file() else p.rglob("*")) if f.is_file()]
    return {"bytes": sum(f.stat().st_size for f in files), "files": len(files)}


def manifest_cost(count: int) -> tuple[Any, ...]:
    """Add rows to a fresh ledger, save `count` of them and open it again; a line of the table."""
    record = {".": str(FileRecord(123_456, "0" * 64))}
    metrics = dict.fromkeys(
        ("trajectory_length_m", "navigation_error_m", "success", "spl", "ndtw"), 1.0
    )
    facts = {"episode": "", "scene": "house", "robot": "aliengo", "metrics": metrics}
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        ledger = Ledger(root)
        rows = {
            f"rollouts/aliengo/path/{k:07d}.mcap": Row(
                "replay",
                f"aliengo/path/{k:07d}",
                f"{k:032x}",
                "done",
                outputs=(f"rollouts/aliengo/path/{k:07d}.mcap",),
                seconds=1.0,
                cpu_seconds=1.0,
                facts=facts,
            )
            for k in range(count)
        }
        started = time.perf_counter()
        for out, row in list(rows.items())[:ADDED]:
            ledger.add(row, {out: record})
        added = time.perf_counter()
        for out, row in rows.items():  # without the journal, which costs the same for each row
            ledger._rows[(row.stage, row.item)] = row
            ledger._files[out] = record
        stored = time.perf_counter()
        ledger.save()
        saved = time.perf_counter()
        Ledger(root)
        opened = time.perf_counter()
        size = (root / MANIFEST_NAME).stat().st_size / 1e6
    return (
        f"{count:,}",
        f"{1000 * (added - started) / ADDED:.2f}",
        f"{saved - stored:.1f}",
        f"{opened - saved:.1f}",
        f"{size:.0f}",
        f"{peak_mb():.0f}",
    )


def apart(function: Callable[..., tuple[Any, ...]], *arguments: Any) -> tuple[Any, ...]:
    """Call in a separate process, so that its peak memory is that of the call alone."""
    with get_context("spawn").Pool(1) as pool:
        return pool.apply(function, arguments)


def line(*cells: Any) -> str:
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
