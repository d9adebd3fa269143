"""The interface of what runs the items of a stage."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any, Self


class Executor:
    """Interface of what runs items for the stage runner; a context manager that closes itself.

    Attributes:
        count: how many items run at a time.
        cores: how many cores a lone item may use.
        chains: whether items of several stages may run as one; not where a lost machine should cost
            as little as possible, or where each stage is submitted by itself.
    """

    count: int
    cores: int
    chains: bool = False

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Run `function(*arguments)` in a worker, at the latest after `flush`.

        The future raises BrokenExecutor if the worker died.
        """
        raise NotImplementedError

    def expect(self, items: int, modules: Sequence[str]) -> None:
        """Say how many items will need some modules; idle workers may import them beforehand."""

    def flush(self) -> None:
        """Start what has been submitted; where items start at once, there is nothing to do."""

    def restart(self) -> bool:
        """Make the executor usable again after a worker died.

        Return whether a whole machine was lost, which is no fault of the items that ran on it.
        """
        return False

    def close(self) -> None:
        """End the workers; waiting items are dropped."""
        raise NotImplementedError

    def kill_processes(self) -> None:
        """End at once what runs; called when this process is about to be ended."""
        self.close()

    def __enter__(self) -> Self:
        """Use as a context manager: the workers end with the block."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *exception: object) -> None:
        """Close."""
        self.close()
