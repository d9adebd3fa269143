"""The review page's server: on this machine only, protected by a token."""

import json
import secrets
import sys
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import SplitResult, parse_qs, urlsplit

from ...formats.core.errors import VlnpeError

_PAGES = {"/": ("index.html", "text/html"), "/review.js": ("review.js", "text/javascript")}
_PAGES["/review.css"] = ("review.css", "text/css")
_LONGEST_BODY = 20_000
# What values of other types, nested JSON and numbers beyond limits raise.
_MALFORMED = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)


class ReviewSource(Protocol):
    """What the page shows: paths with their texts, and what becomes of those."""

    @property
    def names(self) -> list[str]:
        """Names of the paths, in order."""
        ...

    @property
    def films(self) -> Mapping[str, Path]:
        """Film (MP4) of a path, by name."""
        ...

    def path(self, name: str, annotator: str) -> dict[str, Any]:
        """Return all that the page shows of a path."""
        ...

    def check(self, name: str, number: int, text: str) -> dict[str, Any]:
        """Return the verdict on a text in place of a path's text `number`."""
        ...

    def decide(self, annotator: str, body: dict[str, Any]) -> None:
        """Keep a decision."""
        ...


def make_server(review: ReviewSource, port: int = 0) -> tuple[ThreadingHTTPServer, str]:
    """Return a server on 127.0.0.1 and the address, with its token, to open."""
    token = secrets.token_urlsafe(18)

    class Handler(_Handler):
        pass

    Handler.review, Handler.token = review, token
    server = _Server(("127.0.0.1", port), Handler)
    Handler.port = server.server_address[1]
    return server, f"http://127.0.0.1:{Handler.port}/?token={token}"


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a client that has left or is too slow."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    timeout = 30  # in seconds, for a client that sends less than it announces
    review: ReviewSource
    token: str
    port: int

    def do_GET(self) -> None:
        """Serve pages, paths and films."""
        self._answer(self._get)

    def do_POST(self) -> None:
        """Handle checks while typing, and decisions."""
        self._answer(self._post)

    def _answer(self, answer: Callable[[SplitResult], None]) -> None:
        """Answer a request of our own page; 400 where it is malformed, 409 where it is refused."""
        try:
            parts = urlsplit(self.path)
            if self._allowed(parts.query):
                answer(parts)
        except VlnpeError as error:
            self._json({"ok": False, "error": str(error)}, HTTPStatus.CONFLICT)
        except _MALFORMED:
            self._send(HTTPStatus.BAD_REQUEST, b"", "text/plain")

    def _get(self, parts: SplitResult) -> None:
        if parts.path in _PAGES:
            name, kind = _PAGES[parts.path]
            page = (files(__package__) / "page" / name).read_bytes()
            page = page.replace(b'"review.js"', f'"review.js?token={self.token}"'.encode())
            self._send(HTTPStatus.OK, page, f"{kind}; charset=utf-8")
        elif parts.path == "/api/path":
            query = parse_qs(parts.query)
            names = self.review.names
            number = int(query["number"][0])
            if not 0 <= number < len(names):
                raise IndexError(number)
            annotator = query.get("annotator", [""])[0]
            self._json(self.review.path(names[number], annotator))
        elif parts.path == "/api/film":
            film = self.review.films.get(parse_qs(parts.query).get("name", [""])[0])
            if film is None or not film.is_file():
                self._send(HTTPStatus.NOT_FOUND, b"", "text/plain")
            else:
                self._send(HTTPStatus.OK, film.read_bytes(), "video/mp4")
        else:
            self._send(HTTPStatus.NOT_FOUND, b"", "text/plain")

    def _post(self, parts: SplitResult) -> None:
        size = int(self.headers.get("Content-Length", ""))
        if size > _LONGEST_BODY:
            self._send(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, b"", "text/plain")
            return
        body = json.loads(self.rfile.read(max(size, 0)))
        if parts.path == "/api/check":
            name, number = str(body["path"]), int(body["number"])
            self._json(self.review.check(name, number, str(body["text"])))
        elif parts.path == "/api/decide":
            self.review.decide(str(body["annotator"]).strip()[:60], body)
            self._json({"ok": True})
        else:
            self._send(HTTPStatus.NOT_FOUND, b"", "text/plain")

    def _allowed(self, query: str) -> bool:
        """Return whether the token is right and the request comes from our own page."""
        own = {f"127.0.0.1:{self.port}", f"localhost:{self.port}"}
        given = parse_qs(query).get("token", [""])[0]
        origin = self.headers.get("Origin")
        host_ok = self.headers.get("Host") in own
        origin_ok = origin is None or origin in {f"http://{host}" for host in own}
        if secrets.compare_digest(given.encode(), self.token.encode()) and host_ok and origin_ok:
            return True
        self._send(HTTPStatus.FORBIDDEN, b"", "text/plain")
        return False

    def _json(self, value: Any, status: HTTPStatus = HTTPStatus.OK) -> None:
        self._send(status, json.dumps(value).encode(), "application/json")

    def _send(self, status: HTTPStatus, data: bytes, kind: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        policy = "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
        self.send_header("Content-Security-Policy", policy)
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: addresses hold the token."""
