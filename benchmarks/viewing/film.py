"""The film of the viewer: python -m benchmarks.viewing.film RUN EPISODE OUT.webp [PICTURE.jpg].

A headless browser draws every frame in full before it is taken.
"""

import io
import sys
import tempfile
from pathlib import Path

from PIL import Image

from tests.support.devtools import Page, chromium
from vlnpe.pipeline.inputs.walks import entries_of, scenes_beside
from vlnpe.viewer.browser import RunBrowser
from vlnpe.viewer.server import LocalServer

WINDOW_PX, FILM_PX = (1180, 720), (720, 439)
EVERY, SPEED, MOST = 20, 1.5, 36  # samples between frames; times life; frames
QUALITY = 45


def main(run: str, episode: str, out: str, picture: str = "") -> None:
    """Write the film, and its middle as a picture."""
    scenes = scenes_beside(Path(run))
    entries = entries_of(Path(run), scenes)
    server = LocalServer("vlnpe")
    shown = RunBrowser(server, entries, scenes)
    shown.show(next(entry for entry in entries if entry.name.endswith(episode)))
    walk = shown.player.walk
    assert walk is not None
    samples = range(0, len(walk), EVERY)[:MOST]
    frames = []
    with tempfile.TemporaryDirectory() as folder, chromium(Path(folder), *WINDOW_PX) as page:
        page.open(server.url)
        page.wait("window.__viserTestpoints?.rendererInfo.render.triangles > 10000", 300)
        # The page would draw fewer pixels while the robot moves.
        page.evaluate("for (let k = 0; k < 10000; k++) clearInterval(k)")
        page.evaluate("__viserTestpoints.devSettings.set({fixedDpr: 1})")
        page.evaluate("document.querySelector('.mantine-Notification-root')?.remove()")
        for sample in samples:
            shown.player.go_to(sample)
            frames.append(taken(page, walk.rollout.time_s[sample]))
    if picture:
        frames[len(frames) // 2].save(picture, quality=85)
    small = [frame.resize(FILM_PX, Image.Resampling.LANCZOS) for frame in frames]
    duration_ms = round(10 * EVERY / SPEED)
    options = {"duration": duration_ms, "loop": 0, "quality": QUALITY, "method": 6}
    small[0].save(out, save_all=True, append_images=small[1:], **options)
    size = Path(out).stat().st_size
    sys.stdout.write(f"{out}: {len(small)} frames, {size / 1e6:.2f} MB\n")


def taken(page: Page, time_s: float) -> Image.Image:
    """Return what the page shows once it has drawn the time that its slider tells."""
    slider = "+document.querySelector('[role=slider]').getAttribute('aria-valuenow')"
    page.wait(f"Math.abs({slider} - {time_s}) < 0.006", 60)
    drawn = page.evaluate("__viserTestpoints.rendererInfo.render.frame")
    # A request makes one frame, and the first may have begun before.
    ask = "__viserMutable.requestRender()"
    page.wait(f"({ask}, __viserTestpoints.rendererInfo.render.frame > {drawn + 1})", 60)
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


if __name__ == "__main__":
    main(*sys.argv[1:])
