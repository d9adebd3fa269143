"""One self-contained HTML page of what a server shows."""

import html

import viser

from .panel import HIGHLIGHT
from .player import Player
from .server import NAMES

FRAME = 5  # samples between recorded poses: 20 Hz
_CAPTION = """<style>#vlnpe-caption{position:fixed;z-index:2;top:0;left:0;right:0;margin:0 auto;
max-width:46rem;padding:.5rem .8rem;background:rgba(255,255,255,.9);color:#111;
font:15px/1.4 system-ui,sans-serif;max-height:35vh;overflow:auto;box-sizing:border-box}
#vlnpe-caption small{display:block;opacity:.75;overflow-wrap:anywhere}</style>"""


def saved_page(server: viser.ViserServer, player: Player | None, title: str) -> str:
    """Return a page with the scene, and with the walk that a player shows.

    viser's own page plays it; the caption marks the part of the text that is followed.
    """
    if player is None or player.walk is None:
        return _finished(server.get_scene_serializer().as_html(), html.escape(title), [], "")
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
        f"<span data-from='{at}'>{html.escape(text)}</span>"
        for text, at in zip(walk.all_parts, marks, strict=True)
    )
    events = ", ".join(f"{e.kind} {e.detail} {e.time_s:.1f} s" for e in walk.rollout.events)
    small = f"{walk.name} · {walk.rollout.end_reason} · {events}"
    caption = f"<p style='margin:0'>{spans}</p><small>{html.escape(small)}</small>"
    return _finished(recording.as_html(), html.escape(title), [m for m in marks if m >= 0], caption)


def _finished(page: str, title: str, marks: list[float], caption: str) -> str:
    """Return viser's page with a title, and a caption that follows the time of its slider."""
    page = page.replace("<title>Viser</title>", f"<title>{title}</title>", 1)
    page = page.replace('content="Viser client"', f'content="{title}"', 1)
    page = page.replace("</head>", f"{NAMES}</head>", 1)
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
