"""Options of the commands that run many items."""

from dataclasses import dataclass

from ..execution.settings import LOCAL, Execution
from .shared import Parallel


@dataclass(frozen=True, kw_only=True)
class Running(Parallel):
    """Execution."""

    max_failed: int = 0
    """Maximum number of quarantined items; exit with code 1 above it."""
    wait: bool = False
    """If another process uses the output folder, wait until it ends instead of failing."""
    explain: bool = False
    """Print to stderr why each item runs or is reused."""
    retry_quarantined: bool = False
    """Run quarantined items again even if their inputs are unchanged. Items that failed for lack of
    memory, disk space or a server are always run again."""
    only: str = ""
    """Run a single item in this process and print its traceback if it fails: STAGE:ITEM, as listed
    in quarantine.json. The items that it depends on must be done."""
    executor: str = LOCAL
    """Where to run: local (processes of this machine), ray (a Ray cluster), or slurm (batch jobs).
    The machines share the run folder; see docs/guides/scaling.md."""
    ray_address: str = ""
    """Address of a running Ray cluster; defaults to RAY_ADDRESS. Without one, a local cluster is
    started."""
    slurm: str = ""
    """Options of the Slurm jobs, comma-separated name=value pairs: partition, account, qos,
    constraint, exclude, nodelist, dependency, time (240 minutes), mem_gb (3), cpus (1 per task),
    tasks (256 at most in one array)."""
    dry_run: bool = False
    """With --executor slurm: write the batch script of the first stage that has work, and stop."""

    def execution(self) -> Execution:
        """Return where the items run."""
        return Execution(self.executor, self.workers, self.ray_address, self.slurm, self.dry_run)
