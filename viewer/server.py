"""A viser server for one person on this machine, and one page of what it shows.

viser itself listens to anyone who reaches its port, page or not. Here requests pass a gate first.
"""

import contextlib
import io
import threading
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection, serve
from websockets.http11 import Request, Response

from .gate import HOST, Gate
from .panel import HIGHLIGHT

if TYPE_CHECKING:
    from .player import Player

_constructing = threading.Lock()
# Names for screen readers, and what a browser without a graphics card needs.
SCRIPT = f"<script>{Path(__file__).with_name('page.js').read_text(encoding='utf-8')}</script>"
FRAME = 5  # samples between recorded poses: 20 Hz
_CAPTION = """<style>#vlnpe-caption{position:fixed;z-index:2;top:0;left:0;right:0;margin:0 auto;
max-width:46rem;padding:.5rem .8rem;background:rgba(255,255,255,.9);color:#111;
font:15px/1.4 system-ui,sans-serif;max-height:35vh;overflow:auto;box-sizing:border-box}
#vlnpe-caption small{display:block;opacity:.75;overflow-wrap:anywhere}</style>"""


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
        # No node of ours casts shadows; empty shadow maps would be drawn for every frame. A scene
        # and its robots have their light in their colours.
        self.scene.configure_default_lights(cast_shadow=False)
        self.scene.configure_environment_map(None)
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

    Its page gets a title and `SCRIPT`.

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
            response.body = page.replace(b"</head>", f"{SCRIPT}</head>".encode(), 1)
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


def saved_page(server: viser.ViserServer, player: "Player | None", title: str) -> str:
    """Return a page with the scene, and with the walk that a player shows.

    viser's own page plays it; the caption marks the part of the text that is followed.
    """
    if player is None or player.walk is None:
        return _finished(server.get_scene_serializer().as_html(), escape(title), [], "")
    walk = player.walk
    player.pause()
    player.go_to(0)
    recording = server.get_scene_serializer()
    for sample in range(0, len(walk), FRAME):
        player.go_to(sample)
        recording.insert_sleep(FRAME / 100)
    parts, since = walk.parts
    marks = [since[parts.index(p)] if p in parts else -1.0 for p in walk.all_parts]
    spans = " ".join(
        f"<span data-from='{at}'>{escape(text)}</span>"
        for text, at in zip(walk.all_parts, marks, strict=True)
    )
    events = ", ".join(f"{e.kind} {e.detail} {e.time_s:.1f} s" for e in walk.rollout.events)
    small = f"{walk.name} · {walk.rollout.end_reason} · {events}"
    caption = f"<p style='margin:0'>{spans}</p><small>{escape(small)}</small>"
    return _finished(recording.as_html(), escape(title), [m for m in marks if m >= 0], caption)


def _finished(page: str, title: str, marks: list[float], caption: str) -> str:
    """Return viser's page with a title, and a caption that follows the time of its slider."""
    page = page.replace("<title>Viser</title>", f"<title>{title}</title>", 1)
    page = page.replace('content="Viser client"', f'content="{title}"', 1)
    page = page.replace("</head>", f"{SCRIPT}</head>", 1)
    if not caption:
        return page
    script = f"""<script>setInterval(()=>{{const s=document.querySelector('[role=slider]');
const t=s?+s.getAttribute('aria-valuenow'):0;let on=null;
for(const e of document.querySelectorAll('#vlnpe-caption span')){{e.style.cssText='';
const f=+e.dataset.from;if(f>=0&&f<=t+.001)on=e}}
if(on)on.style.cssText='{HIGHLIGHT}'}},100)</script>"""
    end = page.rindex("</body>")
    box = f"<div id='vlnpe-caption' role='status'>{caption}</div>"
    return page[:end] + _CAPTION + box + (script if marks else "") + page[end:]
