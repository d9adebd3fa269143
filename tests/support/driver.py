"""A person at the controls of `vlnpe drive`, without a browser: a client of its WebSocket."""

import json
import re
import subprocess
import time
from typing import Any
from urllib.parse import urlsplit

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests.support.runs.tiny_run import VLNPE, environment

PATIENCE_S = 180  # on a busy machine
AHEAD, BACK, LEFT, NOTHING = (1.0, 0, 0), (-1.0, 0, 0), (0, 0, 1.0), (0, 0, 0)


def start(*arguments: object) -> tuple[subprocess.Popen[str], str]:
    """Start `vlnpe drive` without opening a page; return the process and the page's address."""
    process = subprocess.Popen(
        [*VLNPE, "drive", *map(str, arguments), "--no-open"],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment(),
    )
    assert process.stderr is not None
    lines = []
    for line in process.stderr:
        lines.append(line)
        if found := re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", line):
            return process, found[0]
    raise AssertionError("".join(lines))


class Page:
    """An open page.

    Attributes:
        state: the last one that it was sent.
        pictures: every JPEG with the time it came.
    """

    def __init__(self, url: str, **options: Any) -> None:
        parts = urlsplit(url)
        options = {"origin": f"http://{parts.netloc}", **options}
        self._socket = connect(
            f"ws://{parts.netloc}/drive?{parts.query}", compression=None, **options
        )
        self.state: dict[str, Any] = {}
        self.pictures: list[tuple[float, bytes]] = []

    def watch(self, seconds: float) -> None:
        """Take what comes for a time."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            try:
                message = self._socket.recv(left)
            except TimeoutError:
                return
            if isinstance(message, str):
                self.state = json.loads(message)
            else:
                self.pictures.append((time.monotonic(), message))

    def hold(self, sticks: tuple[float, float, float], seconds: float) -> None:
        """Hold the sticks for a time, and let go."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.send({"sticks": sticks})
            self.watch(0.05)
        self.send({"sticks": NOTHING})

    def do(self, word: str, until: str = "") -> dict[str, Any]:
        """Say a word; wait until the state is called `until`, if that is given."""
        self.send({"do": word})
        end = time.monotonic() + PATIENCE_S
        while until and time.monotonic() < end:
            self.watch(0.05)
            if self.state.get("state") == until:
                return self.state
        assert not until, self.state
        return self.state

    def until(self, name: str) -> dict[str, Any]:
        """Wait until the state has this name."""
        end = time.monotonic() + PATIENCE_S
        while self.state.get("state") != name:
            assert time.monotonic() < end, self.state
            self.watch(0.05)
        return self.state

    def close(self) -> None:
        """Close the page."""
        self._socket.close()

    def lost(self) -> bool:
        """Return whether the server closed the connection within 5 s."""
        try:
            self.watch(5.0)
        except ConnectionClosed:
            return True
        return False

    def send(self, value: dict[str, Any]) -> None:
        """Send a message of the page."""
        self._socket.send(json.dumps(value))
