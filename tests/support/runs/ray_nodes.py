"""A Ray cluster of two node processes on this machine, and the sudden end of one of them."""

import contextlib
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

AT_WORK = "ray::attempt"  # what a worker process calls itself while it runs an item


@contextlib.contextmanager
def two_nodes() -> Iterator[tuple[Any, Any]]:
    """Start two nodes of one core each; yield the cluster and its second node, without the head."""
    pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    given: dict[str, Any] = {"num_cpus": 1, "object_store_memory": 80 * 2**20}
    cluster = Cluster(initialize_head=True, head_node_args=given)
    try:
        second = cluster.add_node(**given)
        cluster.wait_for_nodes()
        yield cluster, second
    finally:
        cluster.shutdown()


def kill_at_work(cluster: Any, node: Any) -> bool:
    """SIGKILL a node's processes in the middle of an item.

    Returns:
        Whether it was at work; otherwise nothing was killed.
    """
    daemon = node.all_processes["raylet"][0].process.pid
    workers = _at_work(daemon)
    with contextlib.suppress(ProcessLookupError):
        for worker in workers:
            os.kill(worker, signal.SIGSTOP)  # an item cannot end any more while this looks again
    stopped = set(workers) & set(_at_work(daemon))
    if not stopped:
        with contextlib.suppress(ProcessLookupError):
            for worker in workers:
                os.kill(worker, signal.SIGCONT)
        return False
    for process in (daemon, *stopped):  # the daemon first: it must not tell how its worker ended
        os.kill(process, signal.SIGKILL)
    cluster.remove_node(node, allow_graceful=False)
    return True


def kill_agents(node: Any) -> None:
    """SIGKILL the processes that a node's daemon cannot do without."""
    for child in _children(node.all_processes["raylet"][0].process.pid):
        if "agent" in Path(f"/proc/{child}/cmdline").read_bytes().decode():
            os.kill(child, signal.SIGKILL)


def _at_work(daemon: int) -> list[int]:
    """Return the processes that run an item for a node's daemon."""
    return [child for child in _children(daemon) if AT_WORK in _name(child)]


def _children(process: int) -> list[int]:
    tasks = Path(f"/proc/{process}/task").glob("*/children")
    return [int(child) for task in tasks for child in task.read_text().split()]


def _name(process: int) -> str:
    try:
        return Path(f"/proc/{process}/cmdline").read_bytes().partition(b"\0")[0].decode()
    except OSError:  # it has ended meanwhile
        return ""
