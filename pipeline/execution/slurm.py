"""Items as arrays of Slurm jobs, through submitit; the machines share the run folder."""

import getpass
import shlex
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Future
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from ...formats.core.errors import InputError, MissingExtraError
from ..engine.signals import DryRun
from .base import Executor

FOLDER = ".vlnpe"  # beside the run folder; holds scripts, logs and pickled calls
# Tasks of one array; clusters commonly refuse arrays above 1,001.
TASKS = 256
TIME_MIN, MEM_GB = 240, 3.0
POLL_S = 2.0
# Time left to put a task back into the queue when its limit nears.
NOTICE_S = 60
# How often a task may reach its time limit.
REQUEUES = 20
# What --slurm takes, and how it is read.
OPTIONS: dict[str, Callable[[str], Any]] = {
    "partition": str,
    "account": str,
    "qos": str,
    "constraint": str,
    "exclude": str,
    "nodelist": str,
    "dependency": str,
    "time": int,
    "mem_gb": float,
    "cpus": int,
    "tasks": int,
}

Call = tuple[Callable[..., Any], tuple[Any, ...]]


@dataclass
class Share:
    """The calls of one task, in order; a task that is requeued goes on where it was.

    Attributes:
        outcomes: of the calls made so far: (result, None) or (None, exception).
    """

    calls: Sequence[Call]
    outcomes: list[tuple[Any, Exception | None]] = field(default_factory=list)

    def __call__(self) -> list[tuple[Any, Exception | None]]:
        """Make the calls that are left and return all outcomes."""
        for function, arguments in self.calls[len(self.outcomes) :]:
            try:
                self.outcomes.append((function(*arguments), None))
            except Exception as error:
                self.outcomes.append((None, error))
        return self.outcomes

    def checkpoint(self, *_: Any, **__: Any) -> Any:
        """Return what to submit when the task is preempted or near its time limit."""
        from submitit.helpers import DelayedSubmission

        return DelayedSubmission(self)


class SlurmExecutor(Executor):
    """Runs a stage's items as one array of single-core jobs and waits for it.

    A stage starts when the one before has ended, so arrays need no dependencies of their own. Tasks
    that are preempted or reach their time limit are requeued and go on with the item they were at.
    """

    def __init__(self, root: Path, options: str, workers: int, dry_run: bool):
        """Prepare the batch options.

        Args:
            root: run folder, on a file system that all nodes see.
            options: `name=value` with commas; see `--slurm`.
            workers: most tasks that run at a time; 0 leaves it to Slurm.
            dry_run: only write the batch script of the first array.
        """
        try:
            import submitit
            from submitit.slurm import slurm
        except ImportError as error:
            raise MissingExtraError("--executor slurm", "cluster") from error
        given = parse_options(options)
        self._tasks = int(given.pop("tasks", TASKS))
        self._settings: dict[str, Any] = {
            "job_name": f"vlnpe-{root.name}",
            "time": int(given.pop("time", TIME_MIN)),
            "mem": f"{round(1024 * given.pop('mem_gb', MEM_GB))}MB",
            "cpus_per_task": int(given.pop("cpus", 1)),
            "ntasks_per_node": 1,
            "signal_delay_s": NOTICE_S,
            "array_parallelism": workers or self._tasks,
            "additional_parameters": {"requeue": True},
            **given,
        }
        self.count = workers or self._tasks
        self.cores = self._settings["cpus_per_task"]
        self._folder = root.parent / FOLDER / f"{root.name}.slurm"
        self._lost = False
        self._waiting: list[tuple[Call, Future[Any]]] = []
        self._running: dict[Any, list[Future[Any]]] = {}
        self._lock = threading.Lock()
        self._watcher: threading.Thread | None = None
        self._closed = threading.Event()
        self._script = partial(slurm._make_sbatch_string, **self._settings)
        self._cluster: Any = None
        if not dry_run:
            if not submitit.SlurmExecutor.affinity() > 0:
                raise InputError(
                    "--executor slurm: srun is not on the PATH; run this on a machine that can "
                    "submit jobs, or add --dry-run to see the batch script"
                )
            self._folder.mkdir(parents=True, exist_ok=True)
            self._cluster = submitit.SlurmExecutor(self._folder, max_num_timeout=REQUEUES)
            self._cluster.update_parameters(**self._settings)

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Keep a call for the next array; see `flush`."""
        future: Future[Any] = Future()
        self._waiting.append(((function, arguments), future))
        return future

    def flush(self) -> None:
        """Submit what waits as one array of at most `tasks` tasks.

        Raises:
            DryRun: nothing was to be submitted; the message names the script.
        """
        if not self._waiting:
            return
        waiting, self._waiting = self._waiting, []
        # Every n-th item, so that the robots' and scenes' slow ones are spread over the tasks.
        shares = [waiting[k :: self._tasks] for k in range(min(self._tasks, len(waiting)))]
        if self._cluster is None:
            raise DryRun(self._written(len(shares), len(waiting)))
        from submitit.core.utils import FailedJobError

        try:
            with self._cluster.batch():
                jobs = [
                    self._cluster.submit(Share([call for call, _ in share])) for share in shares
                ]
        except FailedJobError as error:
            raise InputError(f"Slurm refused the jobs: {error}") from error
        with self._lock:
            for job, share in zip(jobs, shares, strict=True):
                self._running[job] = [future for _, future in share]
        if self._watcher is None:
            self._watcher = threading.Thread(target=self._watch, daemon=True)
            self._watcher.start()

    def _written(self, tasks: int, items: int) -> str:
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / "array.sbatch"
        run = f"{shlex.quote(sys.executable)} -u -m submitit.core._submit {self._folder}"
        count = tasks if tasks > 1 else None
        path.write_text(self._script(command=run, folder=self._folder, map_count=count))
        what = f"{tasks} task{'s' * (tasks > 1)} for {items} item{'s' * (items > 1)}"
        return f"{path}: {what} of the first stage that has work; not submitted (--dry-run)"

    def _watch(self) -> None:
        # Not through the jobs' own `done`, which needs Slurm's accounting.
        missing: set[Any] = set()
        while not self._closed.wait(POLL_S):
            with self._lock:
                running = list(self._running)
            ended = [job for job in running if job.paths.result_pickle.exists()]
            queued = _queued()
            gone = {job for job in running if queued is not None and job.job_id not in queued}
            # Twice, because the result of a task that has just ended may not be seen here yet.
            lost = [job for job in gone & missing if job not in ended]
            missing = gone
            for job in (*ended, *lost):
                with self._lock:
                    futures = self._running.pop(job)
                if job in lost:
                    _lose(job, futures, "left the queue without a result")
                self._lost |= job in lost or not _settle(job, futures)

    def close(self) -> None:
        """Cancel what is submitted and drop what waits."""
        self._closed.set()
        if self._watcher is not None:
            self._watcher.join()
        for job in self._running:
            job.cancel(check=False)
        self._running.clear()
        self._waiting.clear()
        if self._cluster is not None and not self._lost:
            shutil.rmtree(self._folder, ignore_errors=True)  # logs of lost tasks are worth keeping


def _settle(job: Any, futures: Sequence[Future[Any]]) -> bool:
    """Hand the outcomes of a task to the futures of its items; return whether it ended well."""
    from submitit.core.utils import FailedJobError, UncompletedJobError

    try:
        outcomes = job.result()
    except (FailedJobError, UncompletedJobError) as error:
        _lose(job, futures, str(error))
        return False
    for future, (result, error) in zip(futures, outcomes, strict=True):
        if error is None:
            future.set_result(result)
        else:
            future.set_exception(error)
    return True


def _lose(job: Any, futures: Sequence[Future[Any]], reason: str) -> None:
    for future in futures:
        future.set_exception(BrokenExecutor(f"Slurm task {job.job_id}: {reason}"))


def _queued() -> set[str] | None:
    """Return the ids of this user's tasks that wait or run; None if Slurm does not answer."""
    command = ["squeue", "--noheader", "--array", "--format=%i", f"--user={getpass.getuser()}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return set(done.stdout.split()) if done.returncode == 0 else None


def parse_options(text: str) -> dict[str, Any]:
    """Return the options of `--slurm`, numbers as numbers."""
    options: dict[str, Any] = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        name, _, value = (side.strip() for side in part.partition("="))
        if name not in OPTIONS or not value:
            raise InputError(f"--slurm {part}: valid: name=value with {', '.join(OPTIONS)}")
        try:
            options[name] = OPTIONS[name](value)
        except ValueError as error:
            raise InputError(f"--slurm {part}: not a number") from error
        if isinstance(options[name], int | float) and not options[name] > 0:
            raise InputError(f"--slurm {part}: valid: above 0")
    return options
