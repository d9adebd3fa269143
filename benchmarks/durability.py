"""SIGKILL at seeded moments of every stage, and what hashing and verifying cost."""

import shutil
import tempfile
import time
from pathlib import Path

import numpy as np

from tests.support.runs import tiny_run
from tests.support.runs.content import content
from tests.support.runs.kills import kill_in
from vlnpe.pipeline.engine.files import all_records
from vlnpe.pipeline.engine.ledger import Ledger

CHAINS = 4  # runs, each killed once in every stage
LONGEST_S = 1.0  # after a stage's start
SEED = 14


def report(run: Path, chains: int = CHAINS) -> str:
    """Return the section of the page; `run` is what hashing and verifying are measured on."""
    with tempfile.TemporaryDirectory() as folder:
        kills, equal = kill_everywhere(Path(folder), chains)
    hashed_ms = 1000 * hashing_s(run)
    started = time.perf_counter()
    checked = tiny_run.vlnpe("verify", run)
    lines = [
        "## Durability",
        "",
        f"{kills} kills (SIGKILL) spread over the {len(tiny_run.STAGES)} stages of {chains} runs, "
        f"each continued by the same command: {equal} of {chains} runs have exactly the decoded "
        "content of a run that was never killed, and no temporary files.",
        "",
        f"Hashing every output of an episode costs {hashed_ms:.1f} ms; `vlnpe verify` of "
        f"{len(Ledger(run).files())} files took {time.perf_counter() - started:.1f} s "
        f"({checked.stdout.strip().splitlines()[-1]}).",
    ]
    return "\n".join(lines)


def kill_everywhere(folder: Path, chains: int) -> tuple[int, int]:
    """Return how often a run was killed, and how many of the runs ended equal to an untouched one.

    Args:
        folder: Where the runs are made.
        chains: How many runs to kill in every stage.
    """
    rng = np.random.default_rng(SEED)
    scan = tiny_run.write_scan(folder / "scan.glb")
    whole = folder / "whole" / "run"
    done = tiny_run.collect(scan, whole)
    if done.returncode:
        raise RuntimeError(done.stderr)
    expected, kills, equal = content(whole), 0, 0
    for chain in range(chains):
        run = folder / str(chain) / "run"
        command = tiny_run.command(scan, run, "--workers", 1 + chain % 2)
        for stage in tiny_run.STAGES:
            longest_s = LONGEST_S * (8 if stage == "repair" else 1)
            kills += kill_in(command, run, stage, float(rng.uniform(0.0, longest_s)))
        again = tiny_run.run(command)
        leftovers = list(run.rglob(".vlnpe-tmp-*"))
        equal += again.returncode == 0 and not leftovers and content(run) == expected
        shutil.rmtree(run)
    return kills, equal


def hashing_s(run: Path) -> float:
    """Return the time that records of the files of one episode take, on average [s]."""
    rows = [r for r in Ledger(run).rows() if r.stage in ("replay", "render", "export", "mcap")]
    episodes = sum(row.stage == "replay" for row in rows)
    started = time.perf_counter()
    for row in rows:
        all_records(run / path for path in row.outputs)
    return (time.perf_counter() - started) / max(1, episodes)
