"""A run killed anywhere and started again has the content of one that was never killed.

One point here, and three in a slow test; `make bench ONLY=durability` kills in every stage, several
times.
"""

import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.support.runs import tiny_run
from tests.support.runs.content import content
from tests.support.runs.kills import kill_in
from vlnpe.formats.core.atomic import TEMPORARY_PREFIX

pytestmark = pytest.mark.chain


@pytest.mark.slow
def test_kills_in_three_stages_change_nothing(
    scan: Path, finished: Path, prepared: Path, tmp_path: Path
):
    run = shutil.copytree(prepared, tmp_path / "run")
    rng = np.random.default_rng(14)
    command = tiny_run.command(scan, run, "--workers", 1)
    killed = [
        kill_in(command, run, stage, float(rng.uniform(0.0, 0.5)))
        for stage in ("replay", "mcap", "pictures")
    ]
    assert sum(killed) >= 2
    done = tiny_run.collect(scan, run)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "repair                 100%" in done.stderr and "reused 1" in done.stderr
    assert content(run) == content(finished)
    assert not list(run.rglob(f"{TEMPORARY_PREFIX}*"))


def test_verify_of_a_killed_run_tells_what_is_missing_from_what_is_damaged(
    scan: Path, finished: Path, prepared: Path, tmp_path: Path
):
    run = shutil.copytree(prepared, tmp_path / "run")
    assert kill_in(tiny_run.command(scan, run, "--workers", 1), run, "export", 0.0)
    checked = tiny_run.vlnpe("verify", run)
    assert checked.returncode == 3 and "BAD" not in checked.stdout, checked.stdout
    lines = checked.stdout.splitlines()
    (told,) = [line for line in lines if line.startswith("NOT FINISHED  the run: ")]
    assert sum(line.startswith("NOT FINISHED  ") for line in lines) > 1  # the episode in flight
    floor = next((run / "scenes").rglob("*.usdc"))
    whole = floor.read_bytes()
    floor.write_bytes(whole[:-1] + b"x")
    assert tiny_run.vlnpe("verify", run).returncode == 1
    floor.write_bytes(whole)
    done = tiny_run.printed(told.partition("to finish it: ")[2])
    assert done.returncode == 0, done.stderr[-2000:]
    assert content(run) == content(finished)
    sound = tiny_run.vlnpe("verify", run)
    assert sound.returncode == 0 and sound.stdout.endswith(", bad: 0\n"), sound.stdout


def test_stage_by_stage_is_the_same_as_episode_by_episode(
    scan: Path, finished: Path, prepared: Path, tmp_path: Path
):
    run = shutil.copytree(prepared, tmp_path / "run")
    done = tiny_run.collect(scan, run, "--explain")
    assert done.returncode == 0, done.stderr[-2000:]
    assert "\nepisodes " not in done.stderr
    assert content(run) == content(finished)


@pytest.mark.slow
@pytest.mark.parametrize(("workers", "hash_seed"), [(2, "1"), (4, "2")])
def test_workers_and_hash_seeds_change_nothing(
    scan: Path, finished: Path, prepared: Path, tmp_path: Path, workers: int, hash_seed: str
):
    run = shutil.copytree(prepared, tmp_path / "run")
    command = tiny_run.command(scan, run, "--workers", workers)
    done = tiny_run.run(command, PYTHONHASHSEED=hash_seed)
    assert done.returncode == 0, done.stderr[-2000:]
    assert content(run) == content(finished)
