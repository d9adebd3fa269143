"""Options of where a run's items are executed."""

from __future__ import annotations

from dataclasses import dataclass

from ..engine.executors import LOCAL, Execution


@dataclass(frozen=True, kw_only=True)
class Executed:
    """Options of the commands whose run folder several machines can share."""

    workers: int = 0
    """Number of worker processes; 0 uses one per core, or all that a cluster has."""
    executor: str = LOCAL
    """Where to run: local (processes of this machine), ray (a Ray cluster), or slurm (batch jobs).
    The machines share the run folder; see docs/scaling.md."""
    ray_address: str = ""
    """Address of a running Ray cluster; defaults to RAY_ADDRESS, else one is started here."""
    slurm: str = ""
    """Options of the Slurm jobs, name=value with commas: partition, account, qos, constraint,
    exclude, nodelist, dependency, time (240 minutes), mem_gb (3), cpus (1 per task), tasks (256 at
    most in one array)."""
    dry_run: bool = False
    """With --executor slurm: write the batch script of the first stage that has work, and stop."""

    def execution(self) -> Execution:
        """Return where the items run.

        Raises:
            UnknownNameError: no such executor.
            InputError: a negative number of workers.
        """
        return Execution(self.executor, self.workers, self.ray_address, self.slurm, self.dry_run)
