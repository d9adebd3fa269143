"""Stages on a Ray cluster of two nodes, and as Slurm arrays."""

import os
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from tests.support.runs import work
from tests.support.runs.ray_nodes import kill_agents, two_nodes
from vlnpe.formats.core.errors import InputError, UnknownNameError
from vlnpe.pipeline.engine.ledger import Ledger
from vlnpe.pipeline.engine.signals import DryRun
from vlnpe.pipeline.engine.work import WorkItem
from vlnpe.pipeline.execution.runner import Context, run_stage
from vlnpe.pipeline.execution.settings import Execution, make_executor
from vlnpe.pipeline.execution.slurm import parse_options

pytestmark = pytest.mark.slow


def items(root: Path, count: int, seconds: float = 0.0) -> list[WorkItem]:
    paths = [root / f"{k:03d}.txt" for k in range(count)]
    return [
        WorkItem(p.stem, "k", (p,), work.Call(work.write_late, (p, p.stem, seconds))) for p in paths
    ]


def bad(root: Path, function) -> WorkItem:
    path = root / "bad.txt"
    return WorkItem("bad", "k", (path,), work.Call(function, (path,)))


def run(root: Path, execution: Execution, todo: list[WorkItem]):
    executor = make_executor(execution, root)
    try:
        return run_stage(Context(Ledger(root), executor, progress=False), "s", todo)
    finally:
        executor.close()


def run_while(action, executor, root, todo):
    """Run items while `action` runs beside them; return the stage's summary."""
    thread = threading.Thread(target=action)
    thread.start()
    try:
        return run_stage(Context(Ledger(root), executor, progress=False), "s", todo)
    finally:
        thread.join()
        executor.close()


class TestRay:
    """On a cluster of two node processes, each with one core."""

    @pytest.fixture
    def cluster(self, monkeypatch):
        # Workers import the tests' jobs, as those of a cluster import the installed package.
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
        with two_nodes() as nodes:
            yield nodes

    def test_a_killed_node_loses_nothing(self, cluster, tmp_path):
        head, second = cluster
        execution = Execution("ray", ray_address=head.address)
        started = tmp_path / "started"
        first = tmp_path / "000.txt"
        late = work.Call(work.write_late, (first, "000", 0.4, started))
        todo = [WorkItem("000", "k", (first,), late), *items(tmp_path, 12, seconds=0.4)[1:]]
        executor = make_executor(execution, tmp_path)
        assert executor.count == 2

        def kill() -> None:
            while not started.exists():
                time.sleep(0.05)
            head.remove_node(second, allow_graceful=False)

        summary = run_while(kill, executor, tmp_path, todo)
        assert (summary.done, summary.quarantined) == (12, 0)
        assert [p.read_text() for p in sorted(tmp_path.glob("*.txt"))] == [i.name for i in todo]

    def test_a_node_whose_agent_dies_is_a_lost_node(self, cluster, tmp_path):
        head, second = cluster
        execution = Execution("ray", ray_address=head.address)
        todo = items(tmp_path, 10, seconds=0.5)
        executor = make_executor(execution, tmp_path)

        def kill() -> None:
            while not any(tmp_path.glob("*.txt")):
                time.sleep(0.05)
            kill_agents(second)

        summary = run_while(kill, executor, tmp_path, todo)
        assert (summary.done, summary.quarantined) == (10, 0)

    def test_errors_and_deaths_are_quarantined_by_name(self, cluster, tmp_path):
        head, _ = cluster
        execution = Execution("ray", ray_address=head.address)
        todo = [*items(tmp_path, 2), bad(tmp_path, work.refuse)]
        dead = tmp_path / "dead.txt"
        todo.append(WorkItem("dead", "k", (dead,), work.Call(work.die, (dead,))))
        summary = run(tmp_path, execution, todo)
        assert (summary.done, summary.quarantined) == (2, 2)
        errors = {row.item: row.error for row in summary.rows if row.error}
        assert errors["bad"]["type"] == "SceneError"
        assert errors["bad"]["reason"] == "bad.txt has no floor"
        assert "worker process died" in errors["dead"]["reason"]

    def test_no_cluster_is_an_input_error(self, tmp_path):
        pytest.importorskip("ray")
        with pytest.raises(InputError, match=r"no Ray cluster at 127\.0\.0\.1:1"):
            make_executor(Execution("ray", ray_address="127.0.0.1:1"), tmp_path)


class TestSlurm:
    """Scripts everywhere; runs where a Slurm answers."""

    def test_a_dry_run_writes_the_script_of_an_array(self, tmp_path):
        options = "partition=cpu,time=90,mem_gb=2.5,tasks=4,account=lab"
        with pytest.raises(DryRun, match="4 tasks for 10 items"):
            run(tmp_path, Execution("slurm", 3, slurm=options, dry_run=True), items(tmp_path, 10))
        script = (
            tmp_path.parent / ".vlnpe" / f"{tmp_path.name}.slurm" / "array.sbatch"
        ).read_text()
        for line in (
            "#SBATCH --array=0-3%3",
            "#SBATCH --partition=cpu",
            "#SBATCH --account=lab",
            "#SBATCH --time=90",
            "#SBATCH --mem=2560MB",
            "#SBATCH --cpus-per-task=1",
            "#SBATCH --requeue",
            f"#SBATCH --job-name=vlnpe-{tmp_path.name}",
        ):
            assert line in script
        assert subprocess.run(["bash", "-n", "-c", script], check=False).returncode == 0

    @pytest.mark.parametrize("text", ["partition", "nodes=2", "time=soon", "tasks=0", "=3"])
    def test_bad_options_name_the_valid_ones(self, text):
        with pytest.raises(InputError, match=r"--slurm"):
            parse_options(text)

    @pytest.mark.skipif(shutil.which("srun") is None, reason="no Slurm on this machine")
    def test_an_array_equals_a_local_run(self, tmp_path, monkeypatch):
        if subprocess.run(["sinfo"], capture_output=True, check=False).returncode:
            pytest.skip("Slurm does not answer")
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
        options = Execution("slurm", 2, slurm="tasks=3,time=5,mem_gb=0.5")
        todo = [*items(tmp_path, 7), bad(tmp_path, work.refuse)]
        summary = run(tmp_path, options, todo)
        assert (summary.done, summary.quarantined) == (7, 1)
        assert [p.read_text() for p in sorted(tmp_path.glob("*.txt"))] == [
            i.name for i in todo[:-1]
        ]


def test_unknown_executors_name_the_valid_ones():
    with pytest.raises(UnknownNameError, match="local, ray, slurm"):
        Execution("cloud")
