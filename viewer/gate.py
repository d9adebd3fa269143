"""Who may ask a server for one person on this machine.

A request needs the token of the printed address, directly or as the cookie that the page leaves, a
`Host` of this machine (so that no foreign name can be pointed at it) and, where a browser tells its
`Origin`, the page's own.
"""

import atexit
import contextlib
import http
import os
import secrets
import shutil
import tempfile
import threading
import webbrowser
from functools import partial
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

from websockets.datastructures import Headers
from websockets.http11 import Request, Response

HOST = "127.0.0.1"
OPENED_WITHIN_S = 300
LOCAL_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})
# Nothing is fetched from elsewhere, and no other page shows this one in a frame.
_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
    "connect-src 'self' data: blob:; frame-ancestors 'none'"
)


class Gate:
    """Tells those who may connect from the others."""

    def __init__(self) -> None:
        self.token = secrets.token_urlsafe(24)
        self.cookie = f"vlnpe-{secrets.token_hex(4)}"  # cookies of all ports are in one jar

    def url(self, port: int) -> str:
        """Return the address of the page, with the token."""
        return f"http://{HOST}:{port}/?token={self.token}"

    def refusal(self, request: Request) -> Response | None:
        """Return the answer to a request that is refused; None if it is not."""
        reason = self._why_not(request)
        return text_response(http.HTTPStatus.FORBIDDEN, f"vlnpe: {reason}\n") if reason else None

    def served(self, response: Response) -> Response:
        """Return a page with the cookie that lets it come back without the token."""
        cookie = f"{self.cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/"
        response.headers["Set-Cookie"] = cookie
        response.headers["Content-Security-Policy"] = _POLICY
        response.headers["Referrer-Policy"] = "no-referrer"
        response.headers["Cache-Control"] = "no-store"
        return response

    def _why_not(self, request: Request) -> str:
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


def open_page(url: str) -> None:
    """Open a page in the browser; its command line, which all users see, has no token.

    The browser gets a file that only its user can read, which leads on. It lies in the home folder
    for some minutes, because some browsers are kept from temporary and hidden folders.
    """
    home = Path.home()
    folder = tempfile.mkdtemp(prefix="vlnpe-", dir=home if os.access(home, os.W_OK) else None)
    page = Path(folder, "open.html")
    page.touch(0o600)
    page.write_text(
        f"<!doctype html><title>vlnpe</title><script>location.replace({url!r})</script>"
    )
    webbrowser.open(page.as_uri())
    remove = partial(shutil.rmtree, folder, ignore_errors=True)
    atexit.register(remove)
    timer = threading.Timer(OPENED_WITHIN_S, remove)
    timer.daemon = True
    timer.start()


def text_response(status: http.HTTPStatus, text: str, kind: str = "text/plain") -> Response:
    """Return an answer that is a text."""
    body = text.encode()
    headers = {"Content-Type": f"{kind}; charset=utf-8", "Content-Length": str(len(body))}
    return Response(status.value, status.phrase, Headers(headers), body)


def _name(url: str) -> str | None:
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None
