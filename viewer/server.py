"""A viser server for one person on this machine.

viser itself listens to anyone who reaches its port, page or not. Here requests pass a gate first.
"""

import contextlib
import io
import threading
from collections.abc import Iterator
from html import escape
from typing import Any

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection, serve
from websockets.http11 import Request, Response

from .gate import HOST, Gate

_constructing = threading.Lock()
# viser leaves sliders, numbers and symbols without a name for a screen reader: each gets the first
# words of the row that it stands in.
NAMES = """<script>setInterval(()=>{for(const e of document.querySelectorAll(
'[role=slider],input,button')){if(e.ariaLabel||e.labels?.length||(e.innerText||'').trim())continue;
let p=e;while(p&&!/^[A-Z]/.test((p.innerText||'').trim()))p=p.parentElement;
if(p)e.ariaLabel=p.innerText.trim().split('\\n')[0].slice(0,60)}},1000)</script>"""


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
        gate = Gate()
        # viser prints its own address, without a token, to standard output.
        with _guarded(gate, label) as guarded, contextlib.redirect_stdout(io.StringIO()):
            super().__init__(host=HOST, port=port, label=label, verbose=False)
        if not guarded:
            self.stop()
            raise RuntimeError(f"viser {viser.__version__} cannot be guarded; valid: 1.1")
        self.url = gate.url(self.get_port())
        # No node of ours casts shadows; empty shadow maps would be drawn for every frame.
        self.scene.configure_default_lights(cast_shadow=False)
        self.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse: viser would open a tunnel to the internet at the wish of a page."""
        return None

    def stop(self) -> None:
        """Stop the server; viser would print that to standard output."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()


@contextlib.contextmanager
def _guarded(gate: Gate, title: str) -> Iterator[list[bool]]:
    """Have the server that viser starts in this block ask `gate` first; fill the list if it does.

    Its page gets a title and `NAMES`.

    viser passes its own `process_request` to `websockets` and offers no hook before it.
    """
    installed: list[bool] = []

    def guarded_serve(*args: Any, process_request: Any, **options: Any) -> serve:
        def process(connection: ServerConnection, request: Request) -> Response | None:
            if refusal := gate.refusal(request):
                return refusal
            if "Accept-Encoding" in request.headers:  # viser would pack the page
                del request.headers["Accept-Encoding"]
            response = process_request(connection, request)
            if response is None:
                return None
            page = response.body.replace(
                b"<title>Viser</title>", f"<title>{escape(title)}</title>".encode()
            )
            response.body = page.replace(b"</head>", f"{NAMES}</head>".encode(), 1)
            del response.headers["Content-Length"]
            response.headers["Content-Length"] = str(len(response.body))
            return gate.served(response)

        installed.append(True)
        return serve(*args, process_request=process, **options)

    with _constructing:
        websockets.asyncio.server.serve = guarded_serve  # type: ignore[assignment]
        try:
            yield installed
        finally:
            websockets.asyncio.server.serve = serve
