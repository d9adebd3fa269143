"""The page over HTTP and its WebSocket, on 127.0.0.1, for whoever has the token."""

import hmac
import json
import logging
import secrets
import threading
from contextlib import suppress
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from ...formats.core.errors import InputError, MissingExtraError
from .desk import Desk

try:
    from websockets.datastructures import Headers
    from websockets.exceptions import ConnectionClosed
    from websockets.http11 import Request, Response
    from websockets.sync.server import Server, ServerConnection, serve
except ModuleNotFoundError as missing:
    raise MissingExtraError("vlnpe drive", "evaluate") from missing

log = logging.getLogger(__name__)

HOST = "127.0.0.1"
PAGE = Path(__file__).with_name("page.html")
LARGEST_MESSAGE_BYTES = 1024
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src blob:; "
    "connect-src 'self'; frame-ancestors 'none'"
)


class PageServer:
    """Serves the page of a desk until it is closed.

    Attributes:
        url: of the page, with its token.
    """

    def __init__(self, desk: Desk, port: int = 0) -> None:
        """Listen.

        Raises:
            InputError: the port cannot be used.
        """
        self._desk, self._token = desk, secrets.token_urlsafe(24)
        self._current: ServerConnection | None = None
        self._seat = threading.Lock()
        logging.getLogger("websockets").setLevel(logging.CRITICAL)  # refusals are no errors
        try:
            self._server: Server = serve(
                self._drive,
                HOST,
                port,
                process_request=self._answer,
                compression=None,
                max_size=LARGEST_MESSAGE_BYTES,
            )
        except OSError as error:
            raise InputError(f"--port {port}: {error.strerror or error}") from error
        self.port = int(self._server.socket.getsockname()[1])
        self.url = f"http://{HOST}:{self.port}/?token={self._token}"
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop listening, and close the open page's connection."""
        self._server.shutdown()
        if self._current is not None:
            self._current.close(4001, "the session is closed")
        self._thread.join()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the page, a refusal, or None for the WebSocket of our own page."""
        own = f"{HOST}:{self.port}", f"localhost:{self.port}"
        target = urlsplit(request.path)
        token = parse_qs(target.query).get("token", [""])[0]
        if request.headers.get_all("Host") not in ([own[0]], [own[1]]):
            return _response(HTTPStatus.FORBIDDEN, "another host")
        if not hmac.compare_digest(token.encode(), self._token.encode()):
            return _response(HTTPStatus.FORBIDDEN, "a wrong token; use the address as printed")
        if target.path == "/":
            return _response(HTTPStatus.OK, PAGE.read_text(encoding="utf-8"), "text/html")
        if target.path != "/drive":
            return _response(HTTPStatus.NOT_FOUND, "no such page")
        if request.headers.get("Origin") not in [f"http://{host}" for host in own]:
            return _response(HTTPStatus.FORBIDDEN, "another origin")
        return None

    def _drive(self, connection: ServerConnection) -> None:
        """Serve a page; a second one takes the place of the first."""
        before, self._current = self._current, connection
        if before is not None:
            before.close(4000, "driven from another page")
        with self._seat:
            desk = self._desk
            desk.drivers += 1
            sender = threading.Thread(target=self._show, args=(connection,), daemon=True)
            sender.start()
            try:
                for message in connection:
                    desk.hear(message if isinstance(message, str) else "")
            except (ValueError, ConnectionClosed) as error:
                connection.close(1008, str(error)[:100])
            finally:
                # A lost page stops the robot.
                desk.controls.release()
                desk.drivers -= 1
                sender.join()

    def _show(self, connection: ServerConnection) -> None:
        """Send what the desk shows, as fast as the page takes it."""
        number = 0
        with suppress(ConnectionClosed):
            while connection.state.name == "OPEN":
                shown = self._desk.shown(number, 0.5)
                if shown is None:
                    continue
                number = shown.number
                connection.send(json.dumps(shown.state))
                connection.send(shown.jpeg)


def _response(status: HTTPStatus, text: str, kind: str = "text/plain") -> Response:
    body = text.encode()
    headers: dict[str, Any] = {
        "Content-Type": f"{kind}; charset=utf-8",
        "Content-Length": str(len(body)),
        "Content-Security-Policy": POLICY,
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
        "Connection": "close",
    }
    return Response(status.value, status.phrase, Headers(headers), body)
