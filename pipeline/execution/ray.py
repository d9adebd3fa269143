"""Items as tasks of a Ray cluster, whose machines share the run folder."""

import logging
import os
import socket
import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future
from typing import Any

from ...formats.core.errors import InputError, MissingExtraError
from .base import Executor

log = logging.getLogger(__name__)

SETTLE_S = 30.0  # in which Ray notices that a machine is lost


class RayExecutor(Executor):
    """Runs each item as one Ray task of one core.

    What was running on a lost machine is tried again elsewhere by the stage runner, as what was
    running in a lost process; items write their outputs atomically, so nothing is left half-written
    or counted twice.
    """

    def __init__(self, address: str, workers: int):
        """Connect to a cluster, or start one on this machine.

        Args:
            address: of a running cluster; empty takes `RAY_ADDRESS`, or starts one here.
            workers: most items at a time; 0 takes as many as the cluster has cores.
        """
        try:
            import ray
            from ray._private import worker
        except ImportError as error:
            raise MissingExtraError("--executor ray", "cluster") from error
        # Ray's own messages would tear the progress bars apart.
        quiet = {"log_to_driver": False, "logging_level": "ERROR", "include_dashboard": False}
        where = address or os.environ.get("RAY_ADDRESS") or None
        try:
            _knock(where or "")
            if where:
                quiet.pop("include_dashboard")
                ray.init(address=where, **quiet)
            else:
                ray.init(address="local", num_cpus=workers or None, **quiet)
        except (OSError, ValueError, RuntimeError) as error:
            raise InputError(f"no Ray cluster at {where or 'this machine'}: {error}") from error
        # It has no option for what it prints of a lost machine: 50 lines of its log, on stdout.
        worker._worker_logs_enabled = False
        self._ray = ray
        machines = [node["Resources"].get("CPU", 0) for node in ray.nodes() if node["Alive"]]
        total = int(sum(machines))
        self.count = min(workers or total, total) or 1
        self.cores = max(1, int(min((cpus for cpus in machines if cpus), default=1)))
        self._share = max(1, total // self.count)
        self._waiting: set[Any] = set()
        self._alive = self._machines()

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Run `function(*arguments)` as a task."""
        task = self._ray.remote(num_cpus=self._share, max_retries=0)(function)
        reference = task.remote(*arguments)
        self._waiting.add(reference)
        outcome: Future[Any] = Future()

        def hand_on(done: Future[Any]) -> None:
            self._waiting.discard(reference)
            _hand_on(done, outcome)

        reference.future().add_done_callback(hand_on)
        return outcome

    def restart(self) -> bool:
        """Wait until every machine answers or is known to be lost; Ray goes on with the others.

        A machine whose agent has died takes tasks, and loses them, for some more seconds.
        """
        before = self._alive
        deadline_s = time.monotonic() + SETTLE_S
        while not self._all_answer() and time.monotonic() < deadline_s:
            time.sleep(1.0)
        lost = len(before - self._alive)
        what = f"{lost} of {len(before)} machines" if lost else "a process"
        log.warning("%s of the cluster lost; what ran there runs again", what)
        return lost > 0

    def _all_answer(self) -> bool:
        """Return whether all machines that Ray counts as alive run a task; update `_alive`."""
        from ray.exceptions import RayError
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        self._alive = self._machines()
        task = self._ray.remote(num_cpus=0, max_retries=0)(_answer)
        probes = [
            task.options(scheduling_strategy=NodeAffinitySchedulingStrategy(n, soft=False)).remote()
            for n in self._alive
        ]
        try:
            self._ray.get(probes, timeout=SETTLE_S)
        except RayError:
            return False
        return self._machines() == self._alive

    def _machines(self) -> set[str]:
        return {node["NodeID"] for node in self._ray.nodes() if node["Alive"]}

    def close(self) -> None:
        """Drop waiting tasks and leave the cluster, which ends if it was started here."""
        if self._ray.is_initialized():
            for reference in list(self._waiting):
                self._ray.cancel(reference, force=True)
            self._ray.shutdown()


def _answer() -> None:
    """Do what any machine that works can do."""


def _knock(address: str) -> None:
    """Raise OSError if nothing listens at HOST:PORT; Ray itself would try for minutes."""
    host, colon, port = address.rpartition(":")
    if colon and port.isdecimal() and "/" not in host:
        socket.create_connection((host, int(port)), timeout=5.0).close()


def _hand_on(done: Future[Any], outcome: Future[Any]) -> None:
    from ray.exceptions import RayError, RayTaskError

    error = done.exception()
    if error is None:
        outcome.set_result(done.result())
    elif isinstance(error, RayTaskError):
        outcome.set_exception(error.cause)  # what the item raised
    elif isinstance(error, RayError):
        outcome.set_exception(BrokenExecutor(str(error)))
    else:
        outcome.set_exception(error)
