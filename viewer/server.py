"""A viser server for one person on this machine.

viser itself listens to anyone who reaches its port, page or not. Here a request needs the token of
the printed address, directly or as the cookie that the page leaves, a `Host` of this machine (so
that no foreign name can be pointed at it) and, where a browser tells its `Origin`, the page's own.
"""

import contextlib
import http
import io
import secrets
import threading
from collections.abc import Iterator
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

HOST = "127.0.0.1"
LOCAL_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})
# Nothing is fetched from elsewhere, and no other page shows this one in a frame.
_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
    "connect-src 'self' data: blob:; frame-ancestors 'none'"
)
_constructing = threading.Lock()


class LocalServer(viser.ViserServer):
    """A viser server on 127.0.0.1 that refuses whoever lacks its token.

    Attributes:
        url: address of the page, with the token.
    """

    def __init__(self, label: str, port: int = 0):
        """Start the server; port 0 takes any free one.

        Raises:
            RuntimeError: this version of viser does not start its server as expected.
        """
        gate = _Gate()
        # viser prints its own address, without a token, to standard output.
        with _guarded(gate), contextlib.redirect_stdout(io.StringIO()):
            super().__init__(host=HOST, port=port, label=label, verbose=False)
        if not gate.installed:
            self.stop()
            raise RuntimeError(f"viser {viser.__version__} cannot be guarded; valid: 1.1")
        self.url = f"http://{HOST}:{self.get_port()}/?token={gate.token}"
        self.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse: viser would open a tunnel to the internet at the wish of a page."""
        return None

    def stop(self) -> None:
        """Stop the server; viser would print that to standard output."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()


class _Gate:
    """Who may connect."""

    def __init__(self) -> None:
        self.token = secrets.token_urlsafe(24)
        self.cookie = f"vlnpe-{secrets.token_hex(4)}"  # cookies of all ports are in one jar
        self.installed = False

    def refusal(self, request: Request) -> str:
        """Return why a request is refused; empty if it is not."""
        hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
        if len(hosts) != 1 or _name(f"//{hosts[0]}") not in LOCAL_NAMES:
            return "this page answers to 127.0.0.1 and localhost only"
        if any(origin != f"http://{hosts[0]}" for origin in origins):
            return "another page asks for this one"
        given = parse_qs(urlsplit(request.path).query).get("token", [])
        for line in request.headers.get_all("Cookie"):
            with contextlib.suppress(CookieError):
                given += [c.value for name, c in SimpleCookie(line).items() if name == self.cookie]
        if not any(secrets.compare_digest(g.encode(), self.token.encode()) for g in given):
            return "open the address that vlnpe printed, with its token"
        return ""

    def served(self, response: Response) -> Response:
        """Return a page with the cookie that lets it come back without the token."""
        cookie = f"{self.cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/"
        response.headers["Set-Cookie"] = cookie
        response.headers["Content-Security-Policy"] = _POLICY
        response.headers["Referrer-Policy"] = "no-referrer"
        response.headers["Cache-Control"] = "no-store"
        return response


def _name(url: str) -> str | None:
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None


@contextlib.contextmanager
def _guarded(gate: _Gate) -> Iterator[None]:
    """Have the server that viser starts in this block ask `gate` first.

    viser passes its own `process_request` to `websockets` and offers no hook before it.
    """

    def guarded_serve(*args: Any, process_request: Any, **options: Any) -> serve:
        def process(connection: ServerConnection, request: Request) -> Response | None:
            if reason := gate.refusal(request):
                text = f"vlnpe view: {reason}\n".encode()
                headers = Headers({"Content-Type": "text/plain", "Content-Length": str(len(text))})
                return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", headers, text)
            response = process_request(connection, request)
            return None if response is None else gate.served(response)

        gate.installed = True
        return serve(*args, process_request=process, **options)

    with _constructing:
        websockets.asyncio.server.serve = guarded_serve  # type: ignore[assignment]
        try:
            yield
        finally:
            websockets.asyncio.server.serve = serve
