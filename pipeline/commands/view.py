"""`vlnpe view`: a run, an evaluation, a repaired scene or a scan in the browser."""

import contextlib
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING

from ...formats.core.atomic import write_bytes
from ...formats.core.errors import UnknownNameError
from ...formats.scene.bundle import INDEX_NAME, load_bundle
from ..inputs.walks import entries_of, scenes_beside
from ..options.viewer import View
from ..summary import has_display, print_result

if TYPE_CHECKING:
    from ...viewer.player import Player
    from ...viewer.server import LocalServer

REPAIRED = Path("runs/view")  # scenes of scans that were looked at


def run(options: View) -> int:
    """Serve the page until interrupted, or write it."""
    from ...viewer.gate import open_page
    from ...viewer.server import LocalServer, saved_page

    scene = _scene_of(options)
    title = (scene or options.what.resolve()).name
    server = LocalServer(f"vlnpe: {title}", options.port)
    with contextlib.ExitStack() as stack:
        stack.callback(server.stop)
        player, what = _shown(options, scene, server)
        if options.save is not None:
            write_bytes(options.save, saved_page(server, player, title).encode())
            size = options.save.stat().st_size
            return print_result(
                options, {"page": str(options.save), "bytes": size}, f"{options.save}: {what}"
            )
        print_result(options, {"url": server.url}, f"{what} at {server.url}")
        sys.stdout.flush()
        if options.open and has_display():
            open_page(server.url)
        with contextlib.suppress(KeyboardInterrupt):
            threading.Event().wait()
    return 0


def _scene_of(options: View) -> Path | None:
    """Return the repaired scene to show, None for a run; a scan is repaired first."""
    what = options.what
    if (what / INDEX_NAME).is_file():
        return what.resolve()
    if what.is_dir() or not what.exists():
        return None
    from ..context import run_single  # with the repair, seconds that only a scan needs
    from ..stages.scenes import items as repair

    out = (options.out or REPAIRED / what.stem).resolve()
    config = options.repair_config(scene_id=out.name, collision="")
    run_single(out, repair.STAGE, repair.item(what, out, config))
    return out


def _shown(options: View, scene: Path | None, server: "LocalServer") -> "tuple[Player | None, str]":
    """Fill the page; return its player, if it has one, and what it shows."""
    if scene is not None:
        from ...viewer.layers import SceneView

        SceneView(server, load_bundle(scene))
        return None, scene.name
    from ...viewer.browser import RunBrowser

    scenes = scenes_beside(options.what, options.scenes)
    entries = entries_of(options.what, scenes)
    first = entries[0]
    if options.episode:
        alike = [e for e in entries if e.name.endswith(options.episode)]
        if not alike:
            raise UnknownNameError("episode", options.episode, [e.name for e in entries])
        first = alike[0]
    page = RunBrowser(server, entries, scenes)
    page.show(first)
    return page.player, f"{len(entries)} walks" if len(entries) > 1 else "1 walk"
