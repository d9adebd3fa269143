"""What the page and the drive exchange, across threads: wishes one way, pictures the other."""

import json
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any

from ...collectors.driving.controls import Controls

WORDS = ("stop", "undo", "reset", "pause", "keep", "close")


@dataclass(frozen=True)
class Shown:
    """What the page shows.

    Attributes:
        number: counts up, so that a page knows what is new to it.
        jpeg: picture of the robot's camera.
        state: JSON values.
    """

    number: int
    jpeg: bytes
    state: Mapping[str, Any]


class Desk:
    """One person's place at the controls.

    Attributes:
        controls: what is held.
        heard: number of the page's last message about sticks, and when it came [s].
    """

    def __init__(self, controls: Controls) -> None:
        self.controls = controls
        self.heard = 0, 0.0
        self._words: SimpleQueue[str] = SimpleQueue()
        self._new = threading.Condition()
        self._shown: Shown | None = None

    def hear(self, message: str) -> None:
        """Take a message of the page: `{"sticks": [ahead, left, turn]}` or `{"do": word}`.

        Raises:
            ValueError: it is neither.
        """
        match json.loads(message):
            case {"sticks": [int() | float(), int() | float(), int() | float()] as sticks, **more}:
                self.controls.hold(*map(float, sticks))
                number = more.get("number")
                self.heard = number if isinstance(number, int) else 0, time.monotonic()
            case {"do": "stop"}:
                self.controls.stop()
            case {"do": str() as word} if word in WORDS:
                self._words.put(word)
            case _:
                raise ValueError(f"message {message!r:.80}; valid: sticks, or do: {WORDS}")

    def words(self) -> Iterator[str]:
        """Return what was asked for since the last call, but what is held."""
        while True:
            try:
                yield self._words.get_nowait()
            except Empty:
                return

    def show(self, jpeg: bytes, state: Mapping[str, Any]) -> None:
        """Show a picture and a state; a page that is slow gets the newest one only."""
        with self._new:
            number = self._shown.number + 1 if self._shown else 1
            self._shown = Shown(number, jpeg, state)
            self._new.notify_all()

    def shown(self, after: int, timeout_s: float) -> Shown | None:
        """Return what is newer than number `after`, once there is something; None if nothing is."""
        with self._new:
            self._new.wait_for(lambda: self._shown and self._shown.number > after, timeout_s)
            return self._shown if self._shown and self._shown.number > after else None
