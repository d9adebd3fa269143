"""An episode that waits for its next action: a replay in a thread of its own, one step at a time.

A replay asks its chooser and goes on. An environment is asked for a step and must return. So the
replay runs in a thread that hands over at each question; at any time exactly one of the two runs.
"""

import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any

from ..formats.core.rollout import Rollout
from .observation import Observation


class _Cancelled(BaseException):
    """Raised in the replay's thread to end it; no `except Exception` may catch it."""


class Walk:
    """A replay that is advanced from outside.

    Attributes:
        rollout: the record, once the episode is over.
    """

    def __init__(self, replay: Callable[[Callable[[Observation], Any]], Rollout]) -> None:
        """Prepare a replay.

        Args:
            replay: runs the episode; it calls its argument with each observation and goes on with
                the action that this returns.
        """
        self.rollout: Rollout | None = None
        self._replay = replay
        self._questions: SimpleQueue[Observation | Rollout | BaseException] = SimpleQueue()
        self._answers: SimpleQueue[Any] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="walk", daemon=True)

    def start(self) -> Observation | None:
        """Run to the first question; None when the episode ended before one.

        Raises:
            Exception: whatever the replay raised.
        """
        self._thread.start()
        return self._next()

    def step(self, action: Any) -> Observation | None:
        """Answer the last question and run to the next one; None when the episode is over.

        Raises:
            Exception: whatever the replay raised.
        """
        self._answers.put(action)
        return self._next()

    def cancel(self) -> None:
        """End the replay where it is, and its thread."""
        if self._thread.is_alive():
            self._answers.put(_Cancelled())
        if self._thread.ident is not None:
            self._thread.join()

    def _next(self) -> Observation | None:
        item = self._questions.get()
        if isinstance(item, Observation):
            return item
        self._thread.join()
        if isinstance(item, BaseException):
            raise item
        self.rollout = item
        return None

    def _run(self) -> None:
        try:
            result: Rollout | BaseException = self._replay(self._ask)
        except BaseException as error:  # handed to the caller's thread
            result = error
        self._questions.put(result)

    def _ask(self, observation: Observation) -> Any:
        self._questions.put(observation)
        answer = self._answers.get()
        if isinstance(answer, _Cancelled):
            raise answer
        return answer
