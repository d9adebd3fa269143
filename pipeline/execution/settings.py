"""The executor of a run: processes of this machine, or a cluster."""

from dataclasses import dataclass
from pathlib import Path

from ...formats.core.errors import InputError, check_name
from ...formats.process.threads import available_cores
from .base import Executor
from .processes import Workers

LOCAL, RAY, SLURM = "local", "ray", "slurm"
EXECUTORS = (LOCAL, RAY, SLURM)


@dataclass(frozen=True)
class Execution:
    """The choice of an executor.

    Attributes:
        executor: `local`, `ray` or `slurm`.
        workers: how many items run at a time; 0 takes one per core, or what the cluster has.
        ray_address: of a running Ray cluster; empty takes `RAY_ADDRESS`, or starts one here.
        slurm: options of the batch jobs, `name=value` with commas.
        dry_run: write the batch scripts of the first stage that has work and end.
    """

    executor: str = LOCAL
    workers: int = 0
    ray_address: str = ""
    slurm: str = ""
    dry_run: bool = False

    def __post_init__(self) -> None:
        check_name("executor", self.executor, EXECUTORS)
        if self.workers < 0:
            raise InputError(f"--workers {self.workers}: valid: 0 (one per core) and above")
        if self.dry_run and self.executor != SLURM:
            raise InputError(f"--dry-run with --executor {self.executor}; valid: with {SLURM}")


def make_executor(execution: Execution, root: Path) -> Executor:
    """Return the executor that `execution` asks for.

    Args:
        root: run folder, shared by all machines of a cluster.
    """
    if execution.executor == RAY:
        from .ray import RayExecutor

        return RayExecutor(execution.ray_address, execution.workers)
    if execution.executor == SLURM:
        from .slurm import SlurmExecutor

        return SlurmExecutor(root, execution.slurm, execution.workers, execution.dry_run)
    return Workers(execution.workers or available_cores())
