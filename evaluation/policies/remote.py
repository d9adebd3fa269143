"""The client of a policy server: policies of other environments and machines, by WebSocket.

`server.py` describes the messages and serves any policy; it needs nothing of vlnpe.
"""

from contextlib import ExitStack
from dataclasses import asdict
from typing import Any, NoReturn

from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from ..observation import Observation
from ..policy import Assignment, PolicyError
from ..server import PROTOCOL, decode, encode

LARGEST_ANSWER_BYTES = 1 << 20
LONGEST_TEXT = 2000  # characters of a text that is kept


class RemotePolicy:
    """Asks a policy server; satisfies `Policy`. The connection is opened with the first episode.

    Attributes:
        blind: the server wants no images; known once connected.
        said: the texts that the server sent with its actions.
        version: what the server calls its policy, empty if it does not; known once connected.
    """

    def __init__(self, url: str, timeout_s: float = 30.0) -> None:
        """Name the server.

        Args:
            url: `ws://host:port`.
        """
        self.url, self._timeout_s = url, timeout_s
        self._connection: Any = None
        self._open = ExitStack()
        self.blind, self.version = False, ""
        self.said: list[str] = []

    def reset(self, assignment: Assignment) -> None:
        """Begin an episode; connect first if there is no connection."""
        if self._connection is None:
            self.connect()
        self.said = []
        self._ask({"type": "reset", "episode": asdict(assignment)})

    def act(self, observation: Observation) -> Any:
        """Return the server's action."""
        answer = self._ask({"type": "act", "observation": observation.to_dict()})
        if "action" not in answer:
            self._fail(f"answered without an action: {sorted(map(str, answer))!s:.500}")
        if answer.get("said"):
            self.said.append(f"{answer['said']!s:.{LONGEST_TEXT}}")
        return answer["action"]

    def close(self) -> None:
        """Close the connection, if there is one."""
        self._connection = None
        self._open.close()

    def connect(self) -> None:
        """Open the connection and learn what the server is.

        Raises:
            PolicyError: the server cannot be reached, or speaks another protocol.
        """
        try:
            self._connection = self._open.enter_context(
                connect(
                    self.url,
                    open_timeout=self._timeout_s,
                    max_size=LARGEST_ANSWER_BYTES,
                    compression=None,
                    proxy=None,
                )
            )
            hello = decode(self._connection.recv(timeout=self._timeout_s))
        except (OSError, WebSocketException, ValueError) as error:
            self._fail(f"cannot be reached ({error})", error)
        if not isinstance(hello, dict) or hello.get("protocol") != PROTOCOL:
            self._fail(f"does not speak {PROTOCOL}")
        self.blind = not hello.get("images", True)
        self.version = f"{hello.get('version') or ''!s:.{LONGEST_TEXT}}"

    def _ask(self, message: dict[str, Any]) -> dict[str, Any]:
        try:
            self._connection.send(encode(message))
            answer = decode(self._connection.recv(timeout=self._timeout_s))
        except TimeoutError as error:
            self._fail(f"gave no answer within {self._timeout_s:g} s", error)
        except (OSError, WebSocketException, ValueError) as error:
            self._fail(f"is gone ({type(error).__name__}: {error})", error)
        if not isinstance(answer, dict):
            self._fail(f"answered {type(answer).__name__}; valid: a map")
        if "error" in answer:
            self._fail(f"failed: {answer['error']!s:.500}")
        return answer

    def _fail(self, what: str, cause: BaseException | None = None) -> NoReturn:
        self.close()  # a late answer must not be taken for the next one
        raise PolicyError(f"policy server {self.url} {what}") from cause
