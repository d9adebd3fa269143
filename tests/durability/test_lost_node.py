"""A run on a cluster that loses a machine has the content of one that was made here."""

import shutil
import subprocess
import time
from pathlib import Path

import pytest

from tests.support.runs import tiny_run
from tests.support.runs.content import content
from tests.support.runs.ray_nodes import kill_at_work, two_nodes
from vlnpe.formats.core.atomic import TEMPORARY_PREFIX
from vlnpe.pipeline.engine.ledger import Ledger

pytestmark = [pytest.mark.slow, pytest.mark.chain]

EPISODES = 6


def test_a_node_killed_while_episodes_are_made_changes_nothing(
    scan: Path, prepared: Path, tmp_path: Path
):
    local = shutil.copytree(prepared, tmp_path / "local" / "run")  # the report has this name
    done = tiny_run.collect(scan, local, "--episodes", EPISODES)
    assert done.returncode == 0, done.stderr[-2000:]
    run = tmp_path / "cluster" / "run"
    with two_nodes() as (cluster, second):
        options = ("--episodes", EPISODES, "--executor", "ray", "--ray-address", cluster.address)
        with subprocess.Popen(
            tiny_run.command(scan, run, *options),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=tiny_run.environment(),
        ) as process:
            try:
                killed = False
                while not killed and process.poll() is None:
                    killed = in_the_middle(run) and kill_at_work(cluster, second)
                    time.sleep(0.02)
                printed, told = process.communicate(timeout=600)
            finally:
                process.kill()
    assert killed, "the second node never worked while episodes were made"
    assert process.returncode == 0, told[-3000:]
    assert "1 of 2 machines of the cluster lost; what ran there runs again" in told
    assert "raylet" not in printed + told
    assert content(run) == content(local)
    rows = Ledger(run).rows()
    assert {row.status for row in rows} == {"done"}
    assert sum(row.stage == "replay" for row in rows) == EPISODES
    assert not list(run.rglob(f"{TEMPORARY_PREFIX}*"))


def in_the_middle(run: Path) -> bool:
    """Return whether the first episode has been walked, and the last is not exported yet."""
    return bool(made(run, "rollouts/*/*/*")) and len(made(run, "units/*/*")) < EPISODES


def made(run: Path, pattern: str) -> list[Path]:
    """Return what episodes have in a run's folder, without what is half-written."""
    return [path for path in run.glob(pattern) if not path.name.startswith(TEMPORARY_PREFIX)]
