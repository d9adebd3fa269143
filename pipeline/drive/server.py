"""The page over HTTP and its WebSocket, on 127.0.0.1, for whoever has the token."""

import json
import logging
import threading
from contextlib import suppress
from http import HTTPStatus
from pathlib import Path
from urllib.parse import urlsplit

from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve

from ...formats.core.errors import InputError
from ...viewer.gate import HOST, Gate, text_response
from .desk import Desk

PAGE = Path(__file__).with_name("page.html")
LARGEST_MESSAGE_BYTES = 1024


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
        self._desk, self._gate = desk, Gate()
        self._current: ServerConnection | None = None
        self._seat = threading.Lock()
        logging.getLogger("websockets").setLevel(logging.CRITICAL)  # refusals are no errors
        try:
            self._server = serve(
                self._drive,
                HOST,
                port,
                process_request=self._answer,
                compression=None,
                max_size=LARGEST_MESSAGE_BYTES,
            )
        except OSError as error:
            raise InputError(f"--port {port}: {error.strerror or error}") from error
        self.url = self._gate.url(self._server.socket.getsockname()[1])
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop listening, and close the open page's connection."""
        self._server.shutdown()
        if self._current is not None:
            self._current.close(4001, "the session is closed")
        self._thread.join()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the page, a refusal, or None for the page's WebSocket."""
        if refusal := self._gate.refusal(request):
            return refusal
        match urlsplit(request.path).path:
            case "/":
                page = PAGE.read_text(encoding="utf-8")
                return self._gate.served(text_response(HTTPStatus.OK, page, "text/html"))
            case "/drive":
                return None
        return text_response(HTTPStatus.NOT_FOUND, "no such page\n")

    def _drive(self, connection: ServerConnection) -> None:
        """Serve a page; a second one takes the place of the first."""
        before, self._current = self._current, connection
        if before is not None:
            before.close(4000, "driven from another page")
        with self._seat:
            desk = self._desk
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
